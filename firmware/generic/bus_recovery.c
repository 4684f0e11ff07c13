// SPDX-License-Identifier: MIT
// A device that was interrupted while it sent a 0 holds SDA until it has seen the rest
// of its byte clocked (UM10204, "Bus clear").
#include "generic/bus_recovery.h"

#include <stdint.h>

enum {
    CLOCKS = 9,        // eight bits and their acknowledge
    STRETCH_MAX = 50,  // half clocks that a device may hold SCL down
};

// False where a device holds the clock for longer than it may.
static bool clock_rises(void) {
    for (uint8_t tries = 0; tries <= STRETCH_MAX; tries++) {
        bus_line_let_go(BUS_SCL);
        if (bus_line_is_high(BUS_SCL)) {
            return true;
        }
    }
    return false;
}

enum bus_result bus_recovery_run(void) {
    bool is_free = clock_rises();
    for (uint8_t clocks = 0; is_free && clocks < CLOCKS; clocks++) {
        if (bus_line_is_high(BUS_SDA)) {
            break;
        }
        bus_line_pull_low(BUS_SCL);
        is_free = clock_rises();
    }
    if (is_free) {  // STOP: SDA rises while SCL is high
        bus_line_pull_low(BUS_SCL);
        bus_line_pull_low(BUS_SDA);
        is_free = clock_rises();
    }
    bus_line_let_go(BUS_SDA);
    return is_free && bus_line_is_high(BUS_SDA) && bus_line_is_high(BUS_SCL)
               ? BUS_OK
               : BUS_STUCK;
}
