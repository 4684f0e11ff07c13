// SPDX-License-Identifier: MIT
// Readings between the interrupts that fill them and the main loop that takes them: a
// few slots in turn, so that one fills while the main loop is late with another. What
// was not read is counted.
//
// The handlers write `filled` and the main loop `taken`, a byte each. All else the main
// loop touches with interrupts off. Inline, so that a handler saves few registers.
#ifndef SLOTS_H
#define SLOTS_H

#include <stdbool.h>
#include <stdint.h>

#include "core/probe/acquisition.h"

struct slots {
    volatile uint8_t filled;  // slots completed
    volatile uint8_t taken;   // slots handed over
    // Bursts are on the bus, into the slot after those filled; after a failure it stays
    // so until slots_restart(), which keeps others away.
    bool is_running;
    bool is_reported;         // the failure
    enum bus_result failure;  // of those bursts
    uint16_t missed;          // edges without a reading since the last that had one
};

// Counts an edge that gets no reading; stays at 65535.
static inline void slots_miss_one(struct slots *slots) {
    if (slots->missed != UINT16_MAX) {
        slots->missed++;
    }
}

// The same for several.
static inline void slots_miss(struct slots *slots, uint16_t edges) {
    const uint16_t sum = (uint16_t)(slots->missed + edges);
    slots->missed = sum < edges ? UINT16_MAX : sum;
}

// True while none of `count` slots is free for the handlers.
static inline bool slots_are_full(const struct slots *slots, uint8_t count) {
    return (uint8_t)(slots->filled - slots->taken) == count;
}

// Stamps the slot that is filled next, with what was missed before it.
static inline void slots_stamp(struct slots *slots, struct reading *slot,
                               uint32_t time_us) {
    slot->time_us = time_us;
    slot->missed = slots->missed;
    slots->missed = 0;
}

// Starts over, after the edges stopped. `lost`: missed before a reading that failed.
static inline void slots_restart(struct slots *slots, uint16_t lost) {
    slots_miss(slots, lost);
    slots_miss(slots, (uint8_t)(slots->filled - slots->taken));  // nobody takes them
    slots->taken = slots->filled;
    slots->failure = BUS_OK;
    slots->is_running = false;
    slots->is_reported = false;
}

// The oldest reading, if there is one.
static inline bool slots_take(struct slots *slots, const struct reading *readings,
                              uint8_t count, struct reading *out) {
    if (slots->filled == slots->taken) {
        return false;
    }
    *out = readings[slots->taken % count];
    slots->taken++;
    return true;
}

// The failure, told once and after all that was read before it; or READING_NONE.
static inline enum reading_result slots_failure(struct slots *slots) {
    if (slots->failure == BUS_OK || slots->is_reported ||
        slots->filled != slots->taken) {
        return READING_NONE;
    }
    slots->is_reported = true;
    return (enum reading_result)slots->failure;
}

#endif
