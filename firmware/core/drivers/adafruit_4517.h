// SPDX-License-Identifier: MIT
// Adafruit's module 4517: an LSM6DSOX and a LIS3MDL, as a joined sensor.
#ifndef ADAFRUIT_4517_H
#define ADAFRUIT_4517_H

#include "core/drivers/joined.h"

enum {
    // Half a measurement, and half a period of the samples until the next one reads it.
    ADAFRUIT_4517_MAG_LAG_US = 5629,
};

// Also for its modules of an LSM6DSO or ISM330DHCX with a LIS3MDL.
extern const IN_FLASH struct joined_config adafruit_4517;

#endif
