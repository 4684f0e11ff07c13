// SPDX-License-Identifier: MIT
#include "lines.h"

struct lines lines;

static uint8_t high(void) {
    return (uint8_t)(((lines.pulled & BUS_SDA) == 0 && lines.sda_clocks == 0 ? BUS_SDA
                                                                            : 0) |
                     ((lines.pulled & BUS_SCL) == 0 && lines.scl_waits == 0 ? BUS_SCL
                                                                           : 0));
}

uint8_t bus_lines(uint8_t pulled) {
    const uint8_t before = high();
    const uint8_t let_go = lines.pulled & (uint8_t)~pulled;
    lines.pulled = pulled;
    lines.half_clocks++;
    if ((pulled & BUS_SCL) == 0 && lines.scl_waits > 0) {
        lines.scl_waits--;
    }
    if ((let_go & BUS_SCL) != 0 && (high() & BUS_SCL) != 0) {
        lines.clocks++;
        if (lines.sda_clocks > 0) {
            lines.sda_clocks--;
        }
    }
    if ((let_go & BUS_SDA) != 0 && before == BUS_SCL && high() == BUS_BOTH) {
        lines.stops++;
    }
    return high();
}
