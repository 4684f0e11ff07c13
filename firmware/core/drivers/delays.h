// SPDX-License-Identifier: MIT
// The delays of each kind of sensor, for code that has its hello alone: no message
// carries them.
#ifndef DELAYS_H
#define DELAYS_H

#include <stdbool.h>

#include "core/drivers/adafruit_4517.h"
#include "core/drivers/lsm6dsox.h"
#include "core/drivers/lsm9ds0.h"
#include "core/drivers/mpu9250.h"

// Fills them in by `kind` and who_am_i[0]; false where no driver is known for it.
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
    case SENSOR_LSM6DSOX: {
        const IN_FLASH struct part_chip *chip = lsm6dsox.chip;
        const IN_FLASH struct sensor_identity *kind =
            part_kind(chip, identity->who_am_i[0]);
        identity->gyr_delay_us = (kind != 0 ? kind : chip->kinds)->gyr_delay_us;
        identity->mag_lag_us = ADAFRUIT_4517_MAG_LAG_US;
        return true;
    }
    case SENSOR_LSM6DSV16X:
        identity->gyr_delay_us = LSM6DSV16X_GYR_DELAY_US;
        identity->mag_lag_us = LSM6DSV16X_MAG_LAG_US;
        return true;
    default:
        return false;
    }
}

#endif
