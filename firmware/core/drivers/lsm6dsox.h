// SPDX-License-Identifier: MIT
// The LSM6DSOX, LSM6DSO or ISM330DHCX (accelerometer and gyroscope) as a part of a
// joined sensor.
#ifndef LSM6DSOX_H
#define LSM6DSOX_H

#include "core/drivers/joined.h"

enum {
    LSM6DSOX_RATE_HZ = 208,
    // Its last low-pass is at 66.8 Hz and has no delay in the document: that of two
    // poles (Butterworth, far below the cut-off), sqrt(2) / (2 pi 66.8 Hz).
    LSM6DSOX_GYR_DELAY_US = 3370,
};

// Set-up takes 0.8 s (0.2 s once it has been tested). Data-ready of the gyroscope is on
// INT1, high until the rates are read. The accelerometer has the same rate and clock.
extern const IN_FLASH struct joined_inertial lsm6dsox;

#endif
