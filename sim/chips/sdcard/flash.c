// SPDX-License-Identifier: MIT
// Flash: the file, blocks on their way into it, busy, and what a loss of power leaves.
#define _GNU_SOURCE  // NOLINT(bugprone-reserved-identifier): it names fallocate()
#include "chip.h"

#include <fcntl.h>
#include <string.h>
#include <unistd.h>

enum { LONG_AFTER = 200 };  // of so many busy times one is long

void sdcard_chip_read_bytes(struct sdcard_chip *chip, uint64_t at, uint8_t *bytes,
                            size_t count) {
    memset(bytes, 0, count);
    if (pread(chip->file, bytes, count, (off_t)at) < 0) {
        sdcard_chip_complain(chip, "SD card: its image can't be read");
    }
}

static void write_block(struct sdcard_chip *chip, uint64_t block,
                        const uint8_t bytes[BLOCK]) {
    if (pwrite(chip->file, bytes, BLOCK, (off_t)(block * BLOCK)) != BLOCK) {
        sdcard_chip_complain(chip, "SD card: its image can't be written");
    }
}

// Erased blocks read as zeros: DATA_STAT_AFTER_ERASE of the SCR is 0.
static void wipe(struct sdcard_chip *chip, uint64_t block, uint64_t count) {
    static const uint8_t zeros[BLOCK];
    if (count == 0 || fallocate(chip->file, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
                                (off_t)(block * BLOCK), (off_t)(count * BLOCK)) == 0) {
        return;
    }
    for (uint64_t i = 0; i < count; i++) {
        write_block(chip, block + i, zeros);
    }
}

void sdcard_chip_forget_pending(struct sdcard_chip *chip) {
    chip->pending_count = 0;
    chip->wipe_count = 0;
    chip->due = DUE_NOTHING;
    chip->is_closing = false;
    chip->busy_until_ns = 0;
}

static void program(struct sdcard_chip *chip, const struct pending *pending) {
    if (!pending->is_lost) {
        write_block(chip, pending->block, pending->data);
    }
}

void sdcard_chip_program_pending(struct sdcard_chip *chip) {
    for (unsigned i = 0; i < chip->pending_count; i++) {
        program(chip, &chip->pending[i]);
    }
    wipe(chip, chip->wipe_from, chip->wipe_count);
    sdcard_chip_forget_pending(chip);
}

bool sdcard_chip_is_busy(const struct sdcard_chip *chip) {
    return chip->now_ns < chip->busy_until_ns;
}

void sdcard_chip_settle(struct sdcard_chip *chip) {
    if (chip->is_closing && !sdcard_chip_is_busy(chip)) {
        sdcard_chip_program_pending(chip);
    }
}

static uint64_t busy_ns(struct sdcard_chip *chip) {
    const bool is_long = sdcard_chip_draw(chip) % LONG_AFTER == 0;
    if (chip->due == DUE_REST) {
        return sdcard_chip_between(chip, 20 * US, 200 * US);
    }
    const struct sdcard_chip_fault *slow =
        sdcard_chip_find_fault(chip, SDCARD_CHIP_SLOW);
    if (slow != NULL) {
        return slow->ms * MS;
    }
    if (chip->due == DUE_ERASE) {
        return sdcard_chip_between(chip, 1 * MS, 50 * MS);
    }
    if (is_long) {
        return sdcard_chip_between(chip, 4 * MS, 40 * MS);
    }
    return chip->due == DUE_BLOCK ? sdcard_chip_between(chip, 5 * US, 60 * US)
                                  : sdcard_chip_between(chip, 300 * US, 2000 * US);
}

void sdcard_chip_begin_busy(struct sdcard_chip *chip) {
    const uint64_t ns = busy_ns(chip);
    const bool is_block = chip->due == DUE_BLOCK || chip->due == DUE_SINGLE;
    chip->is_closing = chip->due != DUE_BLOCK && chip->due != DUE_REST;
    chip->due = DUE_NOTHING;
    chip->busy_until_ns = chip->now_ns + ns;
    chip->has_seen_ready = false;
    if (ns > chip->busy_worst_ns) {
        chip->busy_worst_ns = ns;
    }
    if (is_block) {
        sdcard_chip_begin_spans(chip);
        if (chip->config.on_block != NULL) {
            chip->config.on_block(chip->config.context, chip->came);
        }
    }
}

void sdcard_chip_put_pending(struct sdcard_chip *chip) {
    if (chip->pending_count == BUFFER) {
        program(chip, &chip->pending[0]);
        chip->pending_count--;
        memmove(&chip->pending[0], &chip->pending[1],
                chip->pending_count * sizeof chip->pending[0]);
    }
    struct pending *pending = &chip->pending[chip->pending_count++];
    pending->block = chip->at / BLOCK;
    pending->is_lost = sdcard_chip_is_worn(chip, pending->block, SDCARD_CHIP_KEEPS);
    memcpy(pending->data, chip->data, BLOCK);
}

// The block that power left amid: how much of it is new, and what follows.
static void tear(struct sdcard_chip *chip, const struct pending *pending) {
    enum { OLD, OLD_REST, ERASED_REST, NOISE_REST, OUTCOMES };
    const uint64_t outcome = sdcard_chip_draw(chip) % OUTCOMES;
    const size_t kept = (size_t)sdcard_chip_between(chip, 0, BLOCK - 1);
    if (outcome == OLD || pending->is_lost) {
        return;
    }
    uint8_t bytes[BLOCK];
    sdcard_chip_read_bytes(chip, pending->block * BLOCK, bytes, BLOCK);
    memcpy(bytes, pending->data, kept);
    for (size_t i = kept; outcome != OLD_REST && i < BLOCK; i++) {
        bytes[i] = outcome == ERASED_REST ? 0xFF : (uint8_t)sdcard_chip_draw(chip);
    }
    write_block(chip, pending->block, bytes);
}

void sdcard_chip_break_off(struct sdcard_chip *chip) {
    const bool is_ordered = sdcard_chip_draw(chip) % 2 == 0;
    const uint64_t torn = sdcard_chip_between(chip, 0, chip->pending_count);
    for (unsigned i = 0; i < chip->pending_count; i++) {
        const bool is_done = is_ordered ? i < torn : sdcard_chip_draw(chip) % 2 == 0;
        if (i == torn) {
            tear(chip, &chip->pending[i]);
        } else if (is_done) {
            program(chip, &chip->pending[i]);
        }
    }
    wipe(chip, chip->wipe_from, sdcard_chip_between(chip, 0, chip->wipe_count));
    sdcard_chip_forget_pending(chip);
}
