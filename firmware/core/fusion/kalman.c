// SPDX-License-Identifier: MIT
// See kalman.h.
#include "core/fusion/kalman.h"

#define SPREAD_MAX INT32_C(1073741823)

// Adds value * element to a sum. Many rows have only a few elements.
static void add_product(int32_t value, q2_14_t element, int32_t *sum) {
    if (element != 0) {
        fixed_add(fixed_mul_q30(value, element * INT32_C(65536)), sum);
    }
}

int32_t kalman_share(const int32_t covariance[], uint8_t states, const q2_14_t row[],
                     int32_t shared[]) {
    int32_t known = 0;
    const int32_t *row_of_pairs = covariance;
    for (uint8_t a = 0; a < states; ++a) {
        // A row of the whole matrix: along the triangle's row, then down its column.
        const int32_t *pair = row_of_pairs;
        shared[a] = 0;
        for (uint8_t b = 0; b < states; ++b) {
            add_product(*pair, row[b], &shared[a]);
            pair += b < a ? 1 : b + 1;
        }
        row_of_pairs += a + 1;
        add_product(shared[a], row[a], &known);
    }
    return known;
}

void kalman_forget(int32_t covariance[], uint8_t states, uint8_t state) {
    for (uint8_t a = 0; a < states; ++a) {
        for (uint8_t b = 0; b < a; ++b) {
            if (a == state || b == state) {
                *covariance = 0;
            }
            ++covariance;
        }
        ++covariance;
    }
}

void kalman_read(int32_t covariance[], uint8_t states, const q2_14_t row[],
                 int32_t noise, q2_30_t gain[]) {
    int32_t shared[KALMAN_STATES];
    const int32_t known =
        fixed_clamp(kalman_share(covariance, states, row, shared), SPREAD_MAX - noise);
    const int32_t spread = known > 0 ? known + noise : noise;
    // In [2^30, 2^31), so that its inverse has all its bits.
    const uint8_t up = (uint8_t)(fixed_leading_zeros((uint32_t)spread) - 1);
    const q2_30_t inverse =
        fixed_ratio(UINT32_C(1073741824), (uint32_t)fixed_scale_up(spread, up));
    for (uint8_t a = 0; a < states; ++a) {
        if (fixed_magnitude(shared[a]) > (uint32_t)spread) {
            kalman_forget(covariance, states, a);
            shared[a] = 0;
        }
        // shared / spread, a half of it in the product.
        const int32_t scaled = fixed_scale_up(shared[a], (uint8_t)(up - 1));
        gain[a] = 2 * fixed_mul_q30(scaled, inverse);
    }
    int32_t *pair = covariance;
    for (uint8_t a = 0; a < states; ++a) {
        for (uint8_t b = 0; b <= a; ++b) {
            *pair -= fixed_mul_at(&gain[a], &shared[b]);
            ++pair;
        }
        if (pair[-1] < 1) {
            pair[-1] = 1;
        }
    }
}
