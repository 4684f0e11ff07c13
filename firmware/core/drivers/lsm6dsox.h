// SPDX-License-Identifier: MIT
// The LSM6DSOX or LSM6DSO, and relatives with its registers (accelerometer and
// gyroscope), as a part of a joined sensor.
#ifndef LSM6DSOX_H
#define LSM6DSOX_H

#include "core/drivers/joined.h"

enum {
    LSM6DSOX_RATE_HZ = 208,
    // The data sheet has none: gyro_group_delay at 208 Hz of ST's driver of the LSM6DSO
    // for Qualcomm's sensor core. Two poles at its 66.8 Hz alone would have 3.4 ms.
    LSM6DSOX_GYR_DELAY_US = 4860,
    LSM6DSV16X_RATE_HZ = 200,
    // A guess: one period, as above. No document that was at hand has it at this rate;
    // at 7.68 kHz it is 1.2 ms. It may be off by 2.5 ms: 0.25 degrees at 100 deg/s.
    LSM6DSV16X_GYR_DELAY_US = 5000,
};

// Set-up takes 0.8 s (0.2 s once it has been tested). Data-ready of the gyroscope is on
// INT1, high until the rates are read. The accelerometer has the same rate and clock.
extern const IN_FLASH struct joined_inertial lsm6dsox;
// The LSM6DSV16X or LSM6DSV, which nobody has tried on hardware.
extern const IN_FLASH struct joined_inertial lsm6dsv16x;

#endif
