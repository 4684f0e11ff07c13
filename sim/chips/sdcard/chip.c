// SPDX-License-Identifier: MIT
// The model's life, time, power and counters.
#include "chip.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LARGEST_SDSC = 1 << 22 };  // blocks: 2 GB

void sdcard_chip_complain(struct sdcard_chip *chip, const char *what) {
    if (chip->complaint == NULL && !chip->is_unexpected) {
        chip->complaint = what;
    }
}

uint64_t sdcard_chip_draw(struct sdcard_chip *chip) {
    chip->random += UINT64_C(0x9E3779B97F4A7C15);
    uint64_t z = chip->random;
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

uint64_t sdcard_chip_between(struct sdcard_chip *chip, uint64_t low, uint64_t high) {
    return low + sdcard_chip_draw(chip) % (high - low + 1);
}

static void lose_power(struct sdcard_chip *chip) {
    if (chip->transfer == WRITING && chip->is_run) {
        sdcard_chip_end_run(chip);
    }
    sdcard_chip_break_off(chip);
    sdcard_chip_reset_interface(chip);
    chip->mode = MODE_SD;
    chip->clocks = 0;
    chip->has_power = false;
    chip->is_unexpected = false;
}

static void follow_socket(struct sdcard_chip *chip) {
    const bool is_in =
        !chip->is_cut && sdcard_chip_find_fault(chip, SDCARD_CHIP_PULLED) == NULL;
    if (chip->has_power && !is_in) {
        lose_power(chip);
    } else if (!chip->has_power && is_in) {
        chip->has_power = true;
        chip->power_ns = chip->now_ns;
    }
}

void sdcard_chip_advance(struct sdcard_chip *chip, uint64_t now_ns) {
    for (uint64_t next = sdcard_chip_next_pull(chip); next <= now_ns;
         next = sdcard_chip_next_pull(chip)) {
        chip->now_ns = next;
        sdcard_chip_settle(chip);
        follow_socket(chip);
        if (chip->has_power && chip->power_ns == next) {
            chip->is_unexpected = true;
        }
    }
    if (now_ns > chip->now_ns) {
        chip->now_ns = now_ns;
    }
    sdcard_chip_settle(chip);
}

void sdcard_chip_power_cycle(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    if (chip->has_power) {
        lose_power(chip);
    }
    follow_socket(chip);
}

void sdcard_chip_cut(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    chip->is_cut = true;
    follow_socket(chip);
}

void sdcard_chip_finish(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    sdcard_chip_program_pending(chip);
}

// Null, or the error.
static const char *open_image(struct sdcard_chip *chip) {
    struct stat status;
    if (fstat(chip->file, &status) != 0 || !S_ISREG(status.st_mode)) {
        return "is no file that can be read and written";
    }
    if (status.st_size == 0 || status.st_size % BLOCK != 0) {
        return "is no image of a card: its size is no multiple of 512 bytes";
    }
    chip->blocks = (uint64_t)status.st_size / BLOCK;
    const bool is_large = chip->blocks > LARGEST_SDSC;
    const enum sdcard_chip_kind kind = chip->config.kind;
    chip->is_high_capacity =
        kind == SDCARD_CHIP_SDHC || (kind == SDCARD_CHIP_BY_SIZE && is_large);
    if (chip->is_high_capacity) {
        return sdcard_chip_fill_csd_2(chip)
                   ? NULL
                   : "is no SDHC card: 512 KB, or so many, to 2 TB";
    }
    return !is_large && sdcard_chip_fill_csd_1(chip)
               ? NULL
               : "is no SDSC card: a multiple of 512 KB, or less, to 2 GB";
}

struct sdcard_chip *sdcard_chip_new(const struct sdcard_chip_config *config,
                                    const char **problem) {
    struct sdcard_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        *problem = "does not fit into memory";
        return NULL;
    }
    chip->config = *config;
    chip->random = config->seed;
    chip->file = open(config->image, O_RDWR | O_CLOEXEC);
    *problem = open_image(chip);
    if (*problem != NULL) {
        sdcard_chip_free(chip);
        return NULL;
    }
    sdcard_chip_fill_cid(chip);
    sdcard_chip_reset_interface(chip);
    chip->mode = MODE_SD;
    chip->has_power = true;
    return chip;
}

void sdcard_chip_free(struct sdcard_chip *chip) {
    if (chip != NULL) {
        if (chip->file >= 0) {
            (void)close(chip->file);
        }
        free(chip);
    }
}

bool sdcard_chip_add_fault(struct sdcard_chip *chip,
                           const struct sdcard_chip_fault *fault) {
    if (chip->fault_count == SDCARD_CHIP_FAULTS_MAX) {
        return false;
    }
    chip->faults[chip->fault_count++] = *fault;
    follow_socket(chip);
    return true;
}

void sdcard_chip_clear_faults(struct sdcard_chip *chip) {
    chip->fault_count = 0;
    follow_socket(chip);
}

uint64_t sdcard_chip_blocks(const struct sdcard_chip *chip) {
    return chip->blocks;
}

uint64_t sdcard_chip_written(const struct sdcard_chip *chip) {
    return chip->written;
}

uint64_t sdcard_chip_bad_crc(const struct sdcard_chip *chip) {
    return chip->bad_crc;
}

uint64_t sdcard_chip_busy_worst_ns(const struct sdcard_chip *chip) {
    return chip->busy_worst_ns;
}

const char *sdcard_chip_complaint(const struct sdcard_chip *chip) {
    return chip->complaint;
}
