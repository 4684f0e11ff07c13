// SPDX-License-Identifier: MIT
// The update of a small Kalman filter with one scalar reading: the new covariance, and
// the gain of each state.
#ifndef KALMAN_H
#define KALMAN_H

#include "core/math/fixed.h"

enum {
    KALMAN_STATES = 7,  // at most
    // A covariance is its lower triangle by rows: (a, b), a >= b, at a (a + 1) / 2 + b.
    KALMAN_PAIRS = KALMAN_STATES * (KALMAN_STATES + 1) / 2,
};

// The index of a state's variance.
static inline uint8_t kalman_variance(uint8_t state) {
    return (uint8_t)((uint8_t)(state * (state + 3)) / 2);
}

// Gives the covariance of each state with row * states, in the format of the
// covariance; returns the variance of row * states. Needs |row| <= 2.8 and variances
// whose sum is at most 2^28, or deviations whose products with |row| add up to less
// than 2^15.5.
int32_t kalman_share(const int32_t covariance[], uint8_t states, const q2_14_t row[],
                     int32_t shared[]);

// Nothing that is known of other states tells of this one any more; its variance, whose
// address is returned, stays.
int32_t *kalman_forget(int32_t covariance[], uint8_t states, uint8_t state);

// Adds a step to the variances of three states from `first` on, which are held within
// limit_high * 2^16.
void kalman_wander(int32_t covariance[], uint8_t first, int32_t step,
                   int16_t limit_high);

// The reading is modelled as row * states + noise; finds the gain of each of the
// states. The covariance and the variance `noise` have the same Q format. Where a gain
// would be above 1, that state is forgotten, and its gain is 0. A variance never falls
// below one step. Needs what kalman_share needs, and noise in [1, 2^30 - 2]. The
// variance of the reading, with noise, is limited to less than 2^30.
void kalman_read(int32_t covariance[], uint8_t states, const q2_14_t row[],
                 int32_t noise, q2_30_t gain[]);

#endif
