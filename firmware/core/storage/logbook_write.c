// SPDX-License-Identifier: MIT
// From the ring to the card: blocks in short runs, which the card confirms as a whole,
// and what is done where it does not.
#include "core/storage/logbook_write.h"

#include <string.h>

#include "core/storage/logbook_state.h"

#define TOLD_SLOW_EVERY UINT32_C(1000000)  // us
#define PROVED_EVERY UINT32_C(1000000)     // us

enum {
    TRIES = 3,
    FLAG_FIRST = 1,
    FLAG_LAST = 2,
};

_Static_assert(LOGBOOK_CONTENT_AT + LOGBOOK_CONTENT == LOGBOOK_CRC_AT,
               "a block is full");

// The length of the whole frames in it: the last block of the file must end with one.
static uint16_t whole_frames(const struct logbook *book, uint16_t length) {
    uint32_t at = book->tail + book->cut + length;
    for (; length > 0; length--) {
        at--;
        if (book->ring[at % book->size] == 0) {
            break;
        }
    }
    return length;
}

void logbook_cut_block(struct logbook *book) {
    uint8_t *block = sdcard_block(&book->card);
    const uint32_t number = book->next + book->run;
    const uint32_t left = book->used - book->cut;
    const bool ends_file = number == book->file_blocks - 1;
    uint16_t length = left < LOGBOOK_CONTENT ? (uint16_t)left : LOGBOOK_CONTENT;
    if (ends_file) {
        length = whole_frames(book, length);
    }
    book->is_drained = left == length;
    book->is_last = ends_file || (book->is_closing && book->is_drained);
    book->cut_length = length;
    book->cut_us = book->now_us;

    logbook_put_u32(block, book->card_id);
    logbook_put_u32(block + 4, number);
    block[8] = (uint8_t)(book->recording % 256);
    block[9] = (uint8_t)(book->recording / 256);
    block[10] = (uint8_t)((book->is_first && book->run == 0 ? FLAG_FIRST : 0) |
                          (book->is_last ? FLAG_LAST : 0));
    block[11] = 0;
    // tail < size and cut <= used <= size.
    const uint32_t sum = book->tail + book->cut;
    const uint32_t from = sum < book->size ? sum : sum - book->size;
    const uint32_t to_end = book->size - from;
    const uint16_t piece = length < to_end ? length : (uint16_t)to_end;
    uint8_t *content = block + LOGBOOK_CONTENT_AT;
    memcpy(content, book->ring + from, piece);
    memcpy(content + piece, book->ring, (uint16_t)(length - piece));
    memset(content + length, 0, (uint16_t)(LOGBOOK_CONTENT - length));
    book->phase = LOGBOOK_CUTTING;
    logbook_begin_sum(book);
}

static void note_busy(struct logbook *book) {
    const uint32_t busy_us = book->card.busy_us;
    if (busy_us > book->busy_worst_us) {
        book->busy_worst_us = busy_us;
    }
    const bool is_told =
        book->has_told_slow && book->now_us - book->told_slow_us < TOLD_SLOW_EVERY;
    if (busy_us >= SDCARD_SLOW_US && !is_told) {
        book->has_told_slow = true;
        book->told_slow_us = book->now_us;
        logbook_tell(book, EVENT_CARD_FAULT, CAUSE_LATE, book->next);
    }
}

// Cards exist that accept what they do not keep.
void logbook_end_run(struct logbook *book) {
    note_busy(book);
    if (book->is_first || book->singles > 0 ||
        book->now_us - book->proved_us >= PROVED_EVERY) {
        logbook_read(book, LOGBOOK_PROVING, book->file + book->next);
    } else {
        logbook_confirm_run(book);
    }
}

void logbook_take_proof(struct logbook *book, bool is_good) {
    const bool is_older = book->phase == LOGBOOK_PROVING_OLDER;
    if (!is_good || book->crc != (is_older ? book->proved_crc : book->proof)) {
        if (is_older) {  // it is no longer in the ring
            logbook_refuse(book, CARD_FAILED, CAUSE_WORN);
        } else {
            logbook_survive_run(book, SDCARD_FAILED);
        }
    } else if (!is_older && book->proved_next > 0) {
        logbook_read(book, LOGBOOK_PROVING_OLDER, book->file + book->proved_next);
    } else {
        book->proved_us = book->now_us;
        book->proved_next = book->next;
        book->proved_crc = book->proof;
        logbook_read(book, LOGBOOK_PROVING_TABLE, 0);
    }
}

void logbook_confirm_run(struct logbook *book) {
    const uint32_t tail = book->tail + book->cut;
    book->tail = tail < book->size ? tail : tail - book->size;
    book->used -= book->cut;
    book->cut = 0;
    book->next += book->run;
    book->is_first = false;
    book->tries = 0;
    book->left_out = 0;
    book->restarts = 0;
    if (book->singles > 0) {
        book->singles--;
    }
    if (book->is_drained) {
        book->oldest_us = book->cut_us;
    }
    logbook_rest(book);
    if (book->is_last) {
        const bool is_closed = book->is_closing && book->is_drained;
        logbook_end_recording(book,
                              is_closed ? (enum cause)book->end_cause : CAUSE_FULL);
        logbook_settle(book);
    }
}

// Leaves out a worn block. Only too many of them in a row end the recording.
static void leave_out(struct logbook *book) {
    logbook_tell(book, EVENT_CARD_FAULT, CAUSE_WORN, book->next);
    book->left_out++;
    book->next++;
    if (book->left_out > LOGBOOK_BAD_MAX) {
        logbook_refuse(book, CARD_FAILED, CAUSE_WORN);
    } else if (book->next >= book->file_blocks) {
        logbook_settle(book);
    }
}

void logbook_survive_run(struct logbook *book, enum sdcard_result failure) {
    book->cut = 0;
    if (failure != SDCARD_FAILED && failure != SDCARD_GARBLED) {
        logbook_restart(book, failure);
        return;
    }
    logbook_rest(book);
    if (book->singles == 0) {
        book->singles = LOGBOOK_RUN_MAX;
        book->tries = 0;
        return;
    }
    book->tries++;
    if (book->tries < TRIES) {
        return;
    }
    book->tries = 0;
    if (failure == SDCARD_FAILED) {
        leave_out(book);
    } else {
        logbook_restart(book, failure);
    }
}

void logbook_take_written(struct logbook *book) {
    note_busy(book);
    book->cut += book->cut_length;
    book->run++;
    const uint8_t limit = book->singles > 0 ? 1 : LOGBOOK_RUN_MAX;
    if (book->is_drained || book->is_last || book->run == limit) {
        book->phase = LOGBOOK_STOPPING;
        sdcard_close(&book->card);
    } else {
        logbook_cut_block(book);
    }
}
