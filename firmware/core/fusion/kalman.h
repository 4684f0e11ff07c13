// SPDX-License-Identifier: MIT
// One scalar reading of a small Kalman filter: what it does to the covariance, and how
// much of the reading's surprise each state takes.
#ifndef KALMAN_H
#define KALMAN_H

#include "core/math/fixed.h"

enum {
    KALMAN_STATES = 6,  // at most
    // A covariance is its lower triangle by rows: (a, b), a >= b, at a (a + 1) / 2 + b.
    KALMAN_PAIRS = KALMAN_STATES * (KALMAN_STATES + 1) / 2,
};

// The place of a state's variance.
static inline uint8_t kalman_variance(uint8_t state) {
    return (uint8_t)(state * (state + 3) / 2);
}

// A reading is row * states + noise. `row` has KALMAN_STATES elements, zeros after
// those of the `states` there are; covariance and the noise's variance are in one
// format. The gains are held within +-1, and a variance never falls below one step.
// Needs |row| <= 1.8, noise in [1, 2^30 - 2] and variances whose sum is at most 2^28;
// the variance of the reading, noise included, is held below 2^30.
void kalman_read(int32_t covariance[], uint8_t states, const q2_14_t row[],
                 int32_t noise, q2_30_t gain[]);

#endif
