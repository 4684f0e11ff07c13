// SPDX-License-Identifier: MIT
// Adafruit's module 4517: an LSM6DSOX and a LIS3MDL, as a joined sensor.
#ifndef ADAFRUIT_4517_H
#define ADAFRUIT_4517_H

#include "core/drivers/joined.h"

enum {
    // Half a measurement, and half a period of the samples until the next one reads it.
    ADAFRUIT_4517_MAG_LAG_US = 5629,
    LSM6DSV16X_MAG_LAG_US = 5726,
};

// Also for its modules of an LSM6DSO or ISM330DHCX with a LIS3MDL.
extern const IN_FLASH struct joined_config adafruit_4517;
// An LSM6DSV16X and a LIS3MDL on boards of their own, or else the module above.
extern const IN_FLASH struct joined_config lsm6dsv16x_lis3mdl;

#endif
