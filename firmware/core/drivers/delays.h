// SPDX-License-Identifier: MIT
// The delays of each kind of sensor, for code that knows the kind alone: no message
// carries them.
#ifndef DELAYS_H
#define DELAYS_H

#include <stdbool.h>

#include "core/drivers/adafruit_4517.h"
#include "core/drivers/lsm6dsox.h"
#include "core/drivers/lsm9ds0.h"
#include "core/drivers/mpu9250.h"

// Fills them in by `kind`; false where no driver is known for it.
static inline bool delays_of_kind(struct sensor_identity *identity) {
    switch (identity->kind) {
    case SENSOR_MPU9250:
    case SENSOR_MPU6500:
        identity->gyr_delay_us = MPU9250_GYR_DELAY_US;
        return true;
    case SENSOR_LSM9DS0:
        identity->gyr_delay_us = LSM9DS0_GYR_DELAY_US;
        identity->mag_lag_us = LSM9DS0_MAG_LAG_US;
        return true;
    case SENSOR_LSM6DSOX:
        identity->gyr_delay_us = LSM6DSOX_GYR_DELAY_US;
        identity->mag_lag_us = ADAFRUIT_4517_MAG_LAG_US;
        return true;
    default:
        return false;
    }
}

#endif
