// SPDX-License-Identifier: MIT
// Shared by the files of the logbook: its phases, the bytes of a block (docs/f405.md),
// what the card is asked for and what is told of it. Private to the logbook.
#ifndef LOGBOOK_STATE_H
#define LOGBOOK_STATE_H

#include "core/storage/logbook.h"

enum {
    // After a run that is cut short any of its blocks may be missing or there: with
    // more of them, some could lie beyond what the search for the end looks over.
    LOGBOOK_RUN_MAX = 8,
    // Bad blocks in a row that do not end the recordings: worn, or such a run.
    LOGBOOK_BAD_MAX = 8,

    // Bytes of a block of the file.
    LOGBOOK_CONTENT_AT = 12,
    LOGBOOK_CRC_AT = 508,
};

// The current phase; each one but WAITING and RESTING is one operation of the card.
enum logbook_phase {
    LOGBOOK_WAITING,  // for the time to look for a card
    LOGBOOK_IDENTIFY,
    LOGBOOK_PARTITION,
    LOGBOOK_VOLUME,
    LOGBOOK_ROOT,
    LOGBOOK_ROOT_CHAIN,
    LOGBOOK_FILE_CHAIN,
    LOGBOOK_HEAD,
    LOGBOOK_SEARCH,
    LOGBOOK_RESTING,  // idle
    LOGBOOK_CHECKING,
    LOGBOOK_OPENING,
    LOGBOOK_CUTTING,
    LOGBOOK_WRITING,
    LOGBOOK_STOPPING,
    LOGBOOK_PROVING,
    LOGBOOK_PROVING_OLDER,
    LOGBOOK_PROVING_TABLE,
};

// Numbers of a block, little-endian.
static inline uint16_t logbook_u16(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static inline uint32_t logbook_u32(const uint8_t *bytes) {
    return logbook_u16(bytes) | (uint32_t)logbook_u16(bytes + 2) << 16;
}

static inline void logbook_put_u32(uint8_t *bytes, uint32_t value) {
    for (uint8_t i = 0; i < 4; i++, value >>= 8) {
        bytes[i] = (uint8_t)value;
    }
}

// Keeps a change for logbook_take_change(); a step makes three at most.
void logbook_tell(struct logbook *book, enum event event, enum cause cause,
                  uint32_t detail);
// Has the card say what it is.
void logbook_identify(struct logbook *book);
// Has the card read a block; logbook_step() acts on it by the phase.
void logbook_read(struct logbook *book, enum logbook_phase phase, uint32_t block);
// Nothing to do until a run is due, or the card is to be checked.
void logbook_rest(struct logbook *book);
// Begins the checksum of the card's block, which takes several steps.
void logbook_begin_sum(struct logbook *book);
void logbook_end_recording(struct logbook *book, enum cause cause);
// The card can't be used as it is; told once.
void logbook_refuse(struct logbook *book, enum card state, enum cause cause);
// The card has no prepared file.
void logbook_refuse_unprepared(struct logbook *book);
// The card failed.
void logbook_fail(struct logbook *book, enum sdcard_result failure);
// Identifies a card that failed amid a recording once more; the recording continues
// from what the card has confirmed.
void logbook_restart(struct logbook *book, enum sdcard_result failure);
// Ready for a recording, or full.
void logbook_settle(struct logbook *book);

#endif
