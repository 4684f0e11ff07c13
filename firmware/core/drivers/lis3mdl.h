// SPDX-License-Identifier: MIT
// The LIS3MDL (magnetometer) as a part of a joined sensor.
#ifndef LIS3MDL_H
#define LIS3MDL_H

#include "core/drivers/joined.h"

enum {
    // From the middle of a measurement to its end. In ultra-high performance it takes
    // a period of its fastest rate, 155 Hz.
    LIS3MDL_LAG_US = 3226,
};

// 80 fields a second in ultra-high performance, +-4 gauss. At 155 a second each field
// is as noisy, and ArduPilot went back from that to these 80.
extern const IN_FLASH struct joined_magnetic lis3mdl;

#endif
