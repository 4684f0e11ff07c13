// SPDX-License-Identifier: MIT
// A device that was interrupted while it sent a 0 holds SDA until it has seen the rest
// of its byte clocked (UM10204, "Bus clear").
#include "generic/bus_recovery.h"

enum {
    CLOCKS = 9,        // eight bits and their acknowledge
    STRETCH_MAX = 50,  // half clocks that a device may hold SCL down
};

// Lets SCL go and returns which lines are high then; without SCL where a device holds
// the clock for longer than it may.
static uint8_t raise_clock(uint8_t pulled) {
    uint8_t high = 0;
    for (uint8_t tries = 0; tries <= STRETCH_MAX && (high & BUS_SCL) == 0; tries++) {
        high = bus_lines(pulled);
    }
    return high;
}

enum bus_result bus_recovery_run(void) {
    uint8_t high = raise_clock(0);
    for (uint8_t clocks = 0; high == BUS_SCL && clocks < CLOCKS; clocks++) {
        (void)bus_lines(BUS_SCL);
        high = raise_clock(0);
    }
    if ((high & BUS_SCL) == 0) {
        return BUS_STUCK;
    }
    // STOP: SDA rises while SCL is high.
    (void)bus_lines(BUS_SCL);
    (void)bus_lines(BUS_BOTH);
    (void)raise_clock(BUS_SDA);
    return bus_lines(0) == BUS_BOTH ? BUS_OK : BUS_STUCK;
}
