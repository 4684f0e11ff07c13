// SPDX-License-Identifier: MIT
// The steps of the logbook, the end of the recordings on a card, and frames into the
// ring. Calls go one way: from here to logbook_file.c, which finds the file, and
// logbook_write.c, which writes blocks, and from all three to logbook_state.c.
#include "core/storage/logbook.h"

#include <string.h>

#include "core/storage/logbook_file.h"
#include "core/storage/logbook_state.h"
#include "core/storage/logbook_write.h"

// us: a byte that waits for its block to fill
#define PARTIAL_AFTER UINT32_C(100000)

enum {
    // The first block of the file.
    HEAD_LENGTH = 24,  // what follows is zero
    HEAD_VERSION = 1,

    SUM_PART = LOGBOOK_CRC_AT / 4,  // bytes of a checksum in one step: 12 us
};

_Static_assert(LOGBOOK_CRC_AT % SUM_PART == 0, "its checksum ends with a part");

// IEEE 802.3, reflected, four bits at a time.
static uint32_t crc32(uint32_t crc, const uint8_t *bytes, uint16_t length) {
    static const uint32_t table[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
        0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
        0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    for (; length > 0; length--, bytes++) {
        crc = table[(crc ^ *bytes) & 0x0F] ^ crc >> 4;
        crc = table[(crc ^ *bytes >> 4) & 0x0F] ^ crc >> 4;
    }
    return crc;
}

// Takes a part, or ends the sum: it is then in `crc`.
static bool sum_is_complete(struct logbook *book) {
    if (book->place == LOGBOOK_CRC_AT) {
        book->crc = ~book->crc;
        book->is_summing = false;
        return true;
    }
    book->crc = crc32(book->crc, sdcard_block(&book->card) + book->place, SUM_PART);
    book->place = (uint16_t)(book->place + SUM_PART);
    return false;
}

static bool sum_fits(struct logbook *book) {
    return book->crc == logbook_u32(sdcard_block(&book->card) + LOGBOOK_CRC_AT);
}

bool logbook_take_change(struct logbook *book, struct logbook_change *out) {
    if (book->changes_count == 0) {
        return false;
    }
    *out = book->changes[0];
    book->changes_count--;
    memmove(book->changes, book->changes + 1,
            book->changes_count * sizeof *book->changes);
    return true;
}

static bool is_head(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    for (uint16_t i = HEAD_LENGTH; i < LOGBOOK_CRC_AT; i++) {
        if (block[i] != 0) {
            return false;
        }
    }
    return sum_fits(book) && memcmp(block, "IMUPROBE", 8) == 0 &&
           logbook_u16(block + 8) == HEAD_VERSION &&
           logbook_u16(block + 10) == SDCARD_BLOCK && logbook_u32(block + 12) != 0 &&
           logbook_u32(block + 16) == book->file &&
           logbook_u32(block + 20) == book->file_blocks;
}

// Looks at the middle, and at the blocks behind it for as long as none is good.
static void search(struct logbook *book) {
    if (book->high - book->low > 1) {
        book->probe = book->low + (book->high - book->low) / 2;
        book->probes_end = book->high - book->probe > LOGBOOK_BAD_MAX + 1
                               ? book->probe + LOGBOOK_BAD_MAX + 1
                               : book->high;
        logbook_read(book, LOGBOOK_SEARCH, book->file + book->probe);
        return;
    }
    book->next = book->high;
    logbook_settle(book);
    if (book->state == CARD_READY) {
        logbook_tell(book, EVENT_CARD_READY, CAUSE_NONE, book->next);
    }
}

static void take_probe(struct logbook *book, bool is_good) {
    if (is_good) {
        book->low = book->probe;
        book->recording = logbook_u16(sdcard_block(&book->card) + 8);
        search(book);
        return;
    }
    book->probe++;
    if (book->probe < book->probes_end) {
        logbook_read(book, LOGBOOK_SEARCH, book->file + book->probe);
        return;
    }
    book->high = book->low + (book->high - book->low) / 2;
    search(book);
}

static bool is_good_block(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    return sum_fits(book) && logbook_u32(block) == book->card_id &&
           logbook_u32(block + 4) == book->probe;
}

static void take_head(struct logbook *book) {
    const uint32_t card_id = logbook_u32(sdcard_block(&book->card) + 12);
    const bool is_ours = is_head(book);
    if (book->is_recording) {
        if (is_ours && card_id == book->card_id) {
            logbook_rest(book);
            return;
        }
        logbook_end_recording(book,
                              CAUSE_ABSENT);  // another card is there in its place
        book->state = CARD_STARTING;
        logbook_read(book, LOGBOOK_PARTITION, 0);
        return;
    }
    if (!is_ours) {
        logbook_refuse_unprepared(book);
        return;
    }
    book->card_id = card_id;
    book->recording = 0;
    book->low = 0;
    book->high = book->file_blocks;
    search(book);
}

static void take_identity(struct logbook *book, enum sdcard_result result) {
    if (result != SDCARD_OK && result != SDCARD_ABSENT && book->is_recording) {
        logbook_restart(book, result);
    } else if (result != SDCARD_OK) {
        logbook_fail(book, result);
    } else if (book->card.is_read_only) {
        logbook_refuse(book, CARD_FAILED, CAUSE_REJECTED);
    } else if (book->is_recording) {
        logbook_read(book, LOGBOOK_HEAD, book->file);
    } else {
        book->state = CARD_STARTING;
        logbook_read(book, LOGBOOK_PARTITION, 0);
    }
}

// A run that has not taken all is followed by another: what it left is older.
static bool is_run_due(const struct logbook *book) {
    return book->is_recording &&
           (book->is_closing ||
            (book->used > 0 && book->now_us - book->oldest_us >= PARTIAL_AFTER));
}

static void leave_rest(struct logbook *book) {
    if (is_run_due(book)) {
        book->phase = LOGBOOK_OPENING;
        book->run = 0;
        book->cut = 0;
        sdcard_open(&book->card, book->file + book->next);
    } else if (book->now_us - book->since_us >= book->wait_us) {
        book->phase = LOGBOOK_CHECKING;
        sdcard_check(&book->card);
    }
}

// Where failures are no business of a run's.
static void act_on_failure(struct logbook *book, enum sdcard_result failure) {
    switch ((enum logbook_phase)book->phase) {
    case LOGBOOK_SEARCH:
        if (failure == SDCARD_FAILED) {  // what a cut tore may be unreadable
            take_probe(book, false);
            return;
        }
        break;
    case LOGBOOK_CHECKING:
        if (!book->is_recording) {
            logbook_identify(book);
            return;
        }
        break;
    case LOGBOOK_OPENING:
    case LOGBOOK_WRITING:
    case LOGBOOK_STOPPING:
    case LOGBOOK_PROVING:
    case LOGBOOK_PROVING_OLDER:
    case LOGBOOK_PROVING_TABLE:
        logbook_survive_run(book, failure);
        return;
    default:
        break;
    }
    if (book->is_recording) {
        logbook_restart(book, failure);
    } else {
        logbook_fail(book, failure);
    }
}

static void act(struct logbook *book) {
    switch ((enum logbook_phase)book->phase) {
    case LOGBOOK_WAITING:
        if (book->now_us - book->since_us >= book->wait_us) {
            logbook_identify(book);
        }
        break;
    case LOGBOOK_PARTITION:
        logbook_take_partitions(book);
        break;
    case LOGBOOK_VOLUME:
        logbook_take_volume(book);
        break;
    case LOGBOOK_ROOT:
        logbook_take_root(book);
        break;
    case LOGBOOK_ROOT_CHAIN:
        logbook_take_root_link(book);
        break;
    case LOGBOOK_FILE_CHAIN:
        logbook_take_file_chain(book);
        break;
    case LOGBOOK_HEAD:
    case LOGBOOK_SEARCH:
    case LOGBOOK_PROVING:
    case LOGBOOK_PROVING_OLDER:
        logbook_begin_sum(book);
        break;
    case LOGBOOK_RESTING:
        leave_rest(book);
        break;
    case LOGBOOK_CHECKING:
        logbook_rest(book);
        break;
    case LOGBOOK_OPENING:
        logbook_cut_block(book);
        break;
    case LOGBOOK_WRITING:
        logbook_take_written(book);
        break;
    case LOGBOOK_STOPPING:
        logbook_end_run(book);
        break;
    default:  // PROVING_TABLE
        if (logbook_is_table(book)) {
            logbook_confirm_run(book);
        } else {
            logbook_refuse(book, CARD_FAILED, CAUSE_WORN);
        }
        break;
    }
}

static void act_on_sum(struct logbook *book) {
    switch ((enum logbook_phase)book->phase) {
    case LOGBOOK_HEAD:
        take_head(book);
        break;
    case LOGBOOK_SEARCH:
        take_probe(book, is_good_block(book));
        break;
    case LOGBOOK_PROVING:
    case LOGBOOK_PROVING_OLDER:
        logbook_take_proof(book, sum_fits(book));
        break;
    default:  // CUTTING
        if (book->run == 0) {
            book->proof = book->crc;
        }
        logbook_put_u32(sdcard_block(&book->card) + LOGBOOK_CRC_AT, book->crc);
        book->phase = LOGBOOK_WRITING;
        sdcard_write(&book->card);
        break;
    }
}

// NOLINTNEXTLINE(readability-non-const-parameter): logbook_put() writes into the ring
void logbook_init(struct logbook *book, const struct spi_device *spi, uint8_t *ring,
                  uint32_t size) {
    *book = (struct logbook){.ring = ring, .size = size, .state = CARD_STARTING};
    sdcard_init(&book->card, spi);
}

bool logbook_step(struct logbook *book, uint32_t now_us) {
    book->now_us = now_us;
    if (book->is_summing) {
        if (sum_is_complete(book)) {
            act_on_sum(book);
        }
        return true;
    }
    const enum sdcard_result result = sdcard_step(&book->card, now_us);
    if (result > 0) {
        return result == SDCARD_GOES_ON;
    }
    if (book->phase == LOGBOOK_IDENTIFY) {
        take_identity(book, result);
    } else if (result < 0) {
        act_on_failure(book, result);
    } else {
        act(book);
    }
    return !sdcard_is_idle(&book->card);
}

bool logbook_open(struct logbook *book) {
    if (book->state != CARD_READY || book->is_recording) {
        return false;
    }
    book->recording =
        book->recording == UINT16_MAX ? 1 : (uint16_t)(book->recording + 1);
    book->state = CARD_LOGGING;
    book->is_recording = true;
    book->is_first = true;
    book->tail = 0;
    book->used = 0;
    book->singles = 0;
    book->tries = 0;
    book->left_out = 0;
    book->restarts = 0;
    book->proved_next = 0;
    logbook_tell(book, EVENT_LOG_STARTED, CAUSE_NONE, book->recording);
    return true;
}

void logbook_close(struct logbook *book, enum cause cause) {
    if (book->is_recording && !book->is_closing) {
        book->is_closing = true;
        book->end_cause = (uint8_t)cause;
    }
}

bool logbook_put(struct logbook *book, const uint8_t *frame, uint8_t length) {
    if (!book->is_recording || book->is_closing || length > book->size - book->used) {
        return false;
    }
    if (book->used == 0) {
        book->oldest_us = book->now_us;
    }
    const uint32_t sum = book->tail + book->used;  // tail < size, used <= size
    const uint32_t head = sum < book->size ? sum : sum - book->size;
    const uint32_t to_end = book->size - head;
    const uint8_t piece = length < to_end ? length : (uint8_t)to_end;
    memcpy(book->ring + head, frame, piece);
    memcpy(book->ring, frame + piece, (uint8_t)(length - piece));
    book->used += length;
    return true;
}

bool logbook_is_idle(const struct logbook *book) {
    return !book->is_recording && sdcard_is_idle(&book->card);
}

void logbook_describe(const struct logbook *book, struct message_equipment *out) {
    const uint32_t busy_ms = book->busy_worst_us / 1000;
    out->card = book->state;
    out->card_block = book->next;
    out->card_blocks = book->file_blocks;
    out->card_faults = book->card.faults;
    out->card_busy = busy_ms > UINT16_MAX ? UINT16_MAX : (uint16_t)busy_ms;
    out->recording = book->recording;
}
