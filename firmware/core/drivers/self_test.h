// SPDX-License-Identifier: MIT
// The self-test of a sensor whose driver judges it: a run of samples without the chip's
// stimulus, then one with it, and a verdict on the difference.
#ifndef SELF_TEST_H
#define SELF_TEST_H

#include "core/drivers/sensor.h"

_Static_assert(SELF_TEST_ACC_FAILED == SELF_TEST_ACC_PASSED * 16 &&
                   SELF_TEST_GYR_FAILED == SELF_TEST_GYR_PASSED * 16,
               "a sensor's flags are four bits apart");

enum {
    SELF_TEST_GYR = 3,  // the gyroscope's axes come after the accelerometer's
    SELF_TEST_AXES = 6,
};

// Starts zeroed.
struct self_test {
    bool is_moving;
    uint8_t failed;  // flags SELF_TEST_..._PASSED of sensors that did not pass
    struct self_test_axis {
        int32_t sum;         // of this run, less that of the run before
        int16_t first;       // of this run, to tell motion
    } axes[SELF_TEST_AXES];  // counts
};

// Adds a reading of one axis, counts, to a run of at most 65535. A rate that strays
// more than `moving` counts from the first of its run shows motion. How far is taken
// modulo 2^16: none gets from one end of the range to the other between two samples.
static inline void self_test_add(struct self_test *test, uint8_t axis, int16_t value,
                                 bool is_first, uint16_t moving) {
    struct self_test_axis *sums = &test->axes[axis];
    if (is_first) {
        sums->sum = -sums->sum;
        sums->first = value;
    }
    sums->sum += value;
    const uint16_t strays =
        (uint16_t)((uint16_t)value - (uint16_t)sums->first + moving);
    if (axis >= SELF_TEST_GYR && strays > 2 * moving) {
        test->is_moving = true;
    }
}

// Notes the verdicts on the inertial sensors. A failure while moving is no verdict.
static inline void self_test_end(const struct self_test *test,
                                 struct sensor_identity *identity) {
    const uint8_t inertial = SELF_TEST_ACC_PASSED | SELF_TEST_GYR_PASSED;
    uint8_t flags = identity->self_test | (inertial & (uint8_t)~test->failed);
    if (!test->is_moving) {
        flags |= (uint8_t)(test->failed * 16);
    }
    identity->self_test = flags;
}

#endif
