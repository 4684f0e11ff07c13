// SPDX-License-Identifier: MIT
// What the card is asked for, what is told of it, and how a recording ends; see
// logbook_state.h.
#include "core/storage/logbook_state.h"

#include <string.h>

// Microseconds.
#define LOOK_EVERY UINT32_C(1000000)   // for a card, and whether it is still there
#define FAILED_FOR UINT32_C(10000000)  // before a card that failed is looked at again

enum { RESTARTS_MAX = 3 };

void logbook_begin_sum(struct logbook *book) {
    book->is_summing = true;
    book->place = 0;
    book->crc = UINT32_MAX;
}

// What nobody has taken since the last step is out of date.
void logbook_tell(struct logbook *book, enum event event, enum cause cause,
                  uint32_t detail) {
    if (book->changes_count == LOGBOOK_CHANGES) {
        book->changes_count--;
        memmove(book->changes, book->changes + 1,
                (LOGBOOK_CHANGES - 1) * sizeof *book->changes);
    }
    book->changes[book->changes_count] = (struct logbook_change){
        .event = (uint8_t)event, .cause = (uint8_t)cause, .detail = (int32_t)detail};
    book->changes_count++;
}

static enum cause cause_of(enum sdcard_result failure) {
    switch (failure) {
    case SDCARD_ABSENT:
        return CAUSE_ABSENT;
    case SDCARD_TIMEOUT:
        return CAUSE_TIMEOUT;
    case SDCARD_FAILED:
        return CAUSE_WORN;
    default:
        return CAUSE_REJECTED;
    }
}

static void wait(struct logbook *book, enum logbook_phase phase, uint32_t wait_us) {
    book->phase = (uint8_t)phase;
    book->since_us = book->now_us;
    book->wait_us = wait_us;
}

void logbook_rest(struct logbook *book) {
    wait(book, LOGBOOK_RESTING, LOOK_EVERY);
}

void logbook_read(struct logbook *book, enum logbook_phase phase, uint32_t block) {
    book->phase = (uint8_t)phase;
    sdcard_read(&book->card, block);
}

void logbook_identify(struct logbook *book) {
    book->phase = LOGBOOK_IDENTIFY;
    sdcard_identify(&book->card);
}

void logbook_end_recording(struct logbook *book, enum cause cause) {
    if (book->is_recording) {
        logbook_tell(book, EVENT_LOG_ENDED, cause, book->recording);
    }
    book->is_recording = false;
    book->is_closing = false;
    book->used = 0;
    book->cut = 0;
}

void logbook_refuse(struct logbook *book, enum card state, enum cause cause) {
    logbook_end_recording(book, cause);
    book->state = (uint8_t)state;
    if (book->told_cause != cause) {
        book->told_cause = (uint8_t)cause;
        logbook_tell(book, state == CARD_FULL ? EVENT_CARD_FULL : EVENT_CARD_FAULT,
                     cause, book->next);
    }
    if (state == CARD_ABSENT) {
        book->next = 0;
        book->file_blocks = 0;
        wait(book, LOGBOOK_WAITING, LOOK_EVERY);
    } else if (state == CARD_FAILED) {
        wait(book, LOGBOOK_WAITING, FAILED_FOR);
    } else {
        logbook_rest(book);
    }
}

void logbook_refuse_unprepared(struct logbook *book) {
    book->next = 0;
    book->file_blocks = 0;
    logbook_refuse(book, CARD_UNPREPARED, CAUSE_UNPREPARED);
}

void logbook_fail(struct logbook *book, enum sdcard_result failure) {
    logbook_refuse(book, failure == SDCARD_ABSENT ? CARD_ABSENT : CARD_FAILED,
                   cause_of(failure));
}

void logbook_restart(struct logbook *book, enum sdcard_result failure) {
    book->restarts++;
    if (book->restarts > RESTARTS_MAX) {
        logbook_refuse(book, CARD_FAILED, cause_of(failure));
        return;
    }
    logbook_tell(book, EVENT_CARD_FAULT, cause_of(failure), book->next);
    logbook_identify(book);
}

void logbook_settle(struct logbook *book) {
    if (book->next >= book->file_blocks) {
        logbook_refuse(book, CARD_FULL, CAUSE_FULL);
        return;
    }
    book->told_cause = CAUSE_NONE;
    book->state = CARD_READY;
    logbook_rest(book);
}
