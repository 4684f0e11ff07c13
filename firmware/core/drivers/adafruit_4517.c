// SPDX-License-Identifier: MIT
// See adafruit_4517.h.
#include "core/drivers/adafruit_4517.h"

#include "core/drivers/lis3mdl.h"
#include "core/drivers/lsm6dsox.h"

_Static_assert(ADAFRUIT_4517_MAG_LAG_US == LIS3MDL_LAG_US + 500000 / LSM6DSOX_RATE_HZ,
               "half of each");

// The axes printed on the module are those of both chips: Adafruit turns the LIS3MDL by
// half a turn against the LSM6DSOX so that they are (board file of its FeatherWing with
// these two; that of the 4517 was not at hand), and its library passes both on as they
// are (Adafruit_AHRS, LSM6DS_LIS3MDL.h).
const IN_FLASH struct joined_config adafruit_4517 = {
    .inertial = &lsm6dsox,
    .magnetic = &lis3mdl,
    .inertial_axes = {1, 2, 3},
    .mag_axes = {1, 2, 3},
    .mag_lag_us = ADAFRUIT_4517_MAG_LAG_US,
};

#ifndef PART_WITHOUT_SELF_TEST
_Static_assert(LSM6DSV16X_MAG_LAG_US == LIS3MDL_LAG_US + 500000 / LSM6DSV16X_RATE_HZ,
               "half of each");

// The chips' own axes: no board with both is known. Two boards must lie so that the
// arrows printed on them point the same way.
const IN_FLASH struct joined_config lsm6dsv16x_lis3mdl = {
    .inertial = &lsm6dsv16x,
    .magnetic = &lis3mdl,
    .inertial_axes = {1, 2, 3},
    .mag_axes = {1, 2, 3},
    .mag_lag_us = LSM6DSV16X_MAG_LAG_US,
    .or_else = &adafruit_4517,
};
#endif
