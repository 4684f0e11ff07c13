// SPDX-License-Identifier: MIT
// How a held I2C bus is freed, by hand: for the time being its pins are no longer the
// bus hardware's. The board moves the lines, this file knows the order.
#ifndef BUS_RECOVERY_H
#define BUS_RECOVERY_H

#include <stdint.h>

#include "core/drivers/bus.h"

enum {
    // Half a clock at 100 kHz, which every device follows.
    BUS_HALF_CLOCK_US = 5,
};

// Flags.
enum bus_lines { BUS_SDA = 1, BUS_SCL = 2, BUS_BOTH = BUS_SDA | BUS_SCL };

// From the board: pulls these lines low, lets the others go, and returns half a clock
// later which of them are high.
uint8_t bus_lines(uint8_t pulled);

// Clocks until SDA is high, then makes a STOP. BUS_OK when both lines are high, else
// BUS_STUCK. At most 600 half clocks, 20 where nobody holds SCL.
enum bus_result bus_recovery_run(void) MUST_CHECK;

#endif
