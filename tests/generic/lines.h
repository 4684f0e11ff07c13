// SPDX-License-Identifier: MIT
// The two lines of a bus, and a device that holds them for a while.
#ifndef LINES_H
#define LINES_H

#include "generic/bus_recovery.h"

struct lines {
    uint8_t pulled;  // by us
    int sda_clocks;  // rising edges of SCL until the device lets SDA go; -1: never
    int scl_waits;   // half clocks that it holds SCL down, once; -1: for ever
    int clocks;      // rising edges of SCL
    int half_clocks;
    int stops;  // rising edges of SDA while SCL is high
};

extern struct lines lines;

#endif
