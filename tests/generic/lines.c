// SPDX-License-Identifier: MIT
#include "lines.h"

struct lines lines;

bool bus_line_is_high(enum bus_line line) {
    return !lines.pulled[line] &&
           (line == BUS_SDA ? lines.sda_clocks == 0 : lines.scl_waits == 0);
}

void bus_line_pull_low(enum bus_line line) {
    lines.pulled[line] = true;
    lines.half_clocks++;
}

void bus_line_let_go(enum bus_line line) {
    const bool was_pulled = lines.pulled[line];
    lines.pulled[line] = false;
    lines.half_clocks++;
    if (line == BUS_SCL && lines.scl_waits > 0) {
        lines.scl_waits--;
    }
    if (line == BUS_SCL && was_pulled && bus_line_is_high(BUS_SCL)) {
        lines.clocks++;
        if (lines.sda_clocks > 0) {
            lines.sda_clocks--;
        }
    }
    if (line == BUS_SDA && was_pulled && bus_line_is_high(BUS_SDA) &&
        bus_line_is_high(BUS_SCL)) {
        lines.stops++;
    }
}
