// SPDX-License-Identifier: MIT
// How a held I2C bus is freed, by hand: for the time being its pins are no longer the
// bus hardware's. The board moves the lines, this file knows the order.
#ifndef BUS_RECOVERY_H
#define BUS_RECOVERY_H

#include <stdbool.h>

#include "core/drivers/bus.h"

enum {
    // Half a clock at 100 kHz, which every device follows.
    BUS_HALF_CLOCK_US = 5,
};

enum bus_line { BUS_SDA, BUS_SCL };

// From the board. The first two return half a clock later.
void bus_line_pull_low(enum bus_line line);
void bus_line_let_go(enum bus_line line);
bool bus_line_is_high(enum bus_line line);

// Clocks until SDA is high, then makes a STOP. BUS_OK when both lines are high, else
// BUS_STUCK. At most 600 half clocks, 20 where nobody holds SCL.
enum bus_result bus_recovery_run(void) MUST_CHECK;

#endif
