// SPDX-License-Identifier: MIT
// See kalman.h.
#include "core/fusion/kalman.h"

// One copy, whose numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

#define SPREAD_MAX INT32_C(1073741823)

int32_t kalman_share(const int32_t covariance[], uint8_t states, const q2_14_t row[],
                     int32_t shared[]) {
    int32_t known = 0;
    const int32_t *row_of_pairs = covariance;
    for (uint8_t a = 0; a < states; ++a) {
        // A row of the whole matrix: along the triangle's row, then down its column.
        const int32_t *pair = row_of_pairs;
        shared[a] = 0;
        for (uint8_t b = 0; b < states; ++b) {
            fixed_add_product(*pair, row[b], &shared[a]);
            pair += b < a ? 1 : b + 1;
        }
        row_of_pairs += a + 1;
        fixed_add_product(shared[a], row[a], &known);
    }
    return known;
}

int32_t *kalman_forget(int32_t covariance[], uint8_t states, uint8_t state) {
    int32_t *variance = covariance;
    for (uint8_t a = 0; a < states; ++a) {
        for (uint8_t b = 0; b < a; ++b) {
            if (a == state || b == state) {
                *covariance = 0;
            }
            ++covariance;
        }
        if (a == state) {
            variance = covariance;
        }
        ++covariance;
    }
    return variance;
}

void kalman_wander(int32_t covariance[], uint8_t first, int32_t step,
                   int16_t limit_high) {
    int32_t *variance = covariance + kalman_variance(first);
    for (uint8_t i = 0; i < 3; ++i) {
        fixed_add_clamped_high(step, limit_high, variance);
        variance += (uint8_t)(first + i + 2);
    }
}

// Takes found * shared off the pairs of a row, whose last is a variance.
NOINLINE static void subtract_row(int32_t *pair, q2_30_t found, const int32_t *shared,
                                  const int32_t *last) {
    for (; shared <= last; ++shared) {
        fixed_subtract(fixed_mul_q30(found, *shared), pair);
        ++pair;
    }
    if (pair[-1] < 1) {
        pair[-1] = 1;
    }
}

void kalman_read(int32_t covariance[], uint8_t states, const q2_14_t row[],
                 int32_t noise, q2_30_t gain[]) {
    // A gain takes the place of what its state shares with the reading: from the last
    // state on, so that those before it still find what they need.
    int32_t *const shared = gain;
    const int32_t known =
        fixed_clamp(kalman_share(covariance, states, row, shared), SPREAD_MAX - noise);
    const int32_t spread = known > 0 ? known + noise : noise;
    // In [2^30, 2^31), so that its inverse has all its bits.
    const uint8_t up = (uint8_t)(fixed_leading_zeros((uint32_t)spread) - 1);
    const q2_30_t inverse =
        fixed_ratio(UINT32_C(1073741824), (uint32_t)fixed_scale_up(spread, up));
    for (uint8_t a = 0; a < states; ++a) {
        if (fixed_magnitude(shared[a]) > (uint32_t)spread) {
            (void)kalman_forget(covariance, states, a);
            shared[a] = 0;
        }
    }
    int32_t *row_of_pairs = covariance + (uint8_t)(states * (states + 1)) / 2;
    int32_t *last = gain + states;
    do {
        --last;
        // shared / spread, a half of it in the product.
        const int32_t scaled = fixed_scale_up(*last, (uint8_t)(up - 1));
        const q2_30_t found = 2 * fixed_mul_q30(scaled, inverse);
        row_of_pairs -= states;
        --states;
        subtract_row(row_of_pairs, found, gain, last);
        *last = found;
    } while (states > 0);
}
