// SPDX-License-Identifier: MIT
// What the self-tests of both sensor drivers share: a run of samples without the chip's
// stimulus, then one with it, and a verdict on the difference.
#ifndef SELF_TEST_H
#define SELF_TEST_H

#include "core/drivers/sensor.h"
#include "core/math/fixed.h"
#include "core/wire/messages.h"

_Static_assert(SELF_TEST_ACC_FAILED == SELF_TEST_ACC_PASSED * 16 &&
                   SELF_TEST_GYR_FAILED == SELF_TEST_GYR_PASSED * 16 &&
                   SELF_TEST_MAG_FAILED == SELF_TEST_MAG_PASSED * 16,
               "a sensor's flags are four bits apart");

struct self_test {
    int32_t response[6];   // sums in counts, stimulus on less off: acc, gyr
    int16_t gyr_first[3];  // counts, first of a run, to tell motion
    bool is_moving;
};

// Adds one axis of a sample, counts, to a run of at most 65535 samples. A rate that
// strays more than `moving` counts from the first of its run tells motion.
static inline void self_test_add(struct self_test *test, uint8_t axis, int16_t acc,
                                 int16_t gyr, bool is_first, uint16_t moving) {
    test->response[axis] += acc;
    test->response[axis + 3] += gyr;
    if (is_first) {
        test->gyr_first[axis] = gyr;
    }
    if (fixed_magnitude((int32_t)gyr - test->gyr_first[axis]) > moving) {
        test->is_moving = true;
    }
}

// Between the runs: the one without stimulus counts against the other.
static inline void self_test_turn(struct self_test *test) {
    for (uint8_t i = 0; i < 6; ++i) {
        test->response[i] = -test->response[i];
    }
}

// Notes the verdict on a sensor; `passed` is its flag SELF_TEST_..._PASSED.
static inline void self_test_note(struct sensor_identity *identity, uint8_t passed,
                                  bool passes) {
    const uint8_t flag = passes ? passed : (uint8_t)(passed * 16);
    identity->self_test = (uint8_t)(identity->self_test | flag);
}

// Notes the verdicts on the inertial sensors. A failure while moving is no verdict.
static inline void self_test_end(const struct self_test *test,
                                 struct sensor_identity *identity, bool acc_passes,
                                 bool gyr_passes) {
    if (acc_passes || !test->is_moving) {
        self_test_note(identity, SELF_TEST_ACC_PASSED, acc_passes);
    }
    if (gyr_passes || !test->is_moving) {
        self_test_note(identity, SELF_TEST_GYR_PASSED, gyr_passes);
    }
}

#endif
