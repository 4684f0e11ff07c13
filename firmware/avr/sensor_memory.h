// SPDX-License-Identifier: MIT
// The sensor's memory: the state of its driver, which ends with the sums of a
// self-test, and the readings of samples. They share bytes, because no sample is read
// during a self-test.
#ifndef SENSOR_MEMORY_H
#define SENSOR_MEMORY_H

#include <stddef.h>

#include "core/drivers/mpu9250.h"
#include "core/probe/acquisition.h"

enum { READING_SLOTS = 2 };

union sensor_memory {
    struct mpu9250 chip;
    struct {
        uint8_t before_test[offsetof(struct mpu9250, test)];
        struct reading readings[READING_SLOTS];
    };
};

_Static_assert(offsetof(struct mpu9250, test) + sizeof(struct self_test) ==
                   sizeof(struct mpu9250),
               "nothing of the state lies behind the sums");

extern union sensor_memory sensor_memory;

#endif
