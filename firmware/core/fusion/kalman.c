// SPDX-License-Identifier: MIT
// See kalman.h.
#include "core/fusion/kalman.h"

#include <string.h>

#define SPREAD_MAX INT32_C(1073741823)

// row * v, as sums that are rounded once each.
static int32_t dot(const int32_t v[KALMAN_STATES], const q2_14_t row[KALMAN_STATES]) {
    const int32_t last = fixed_mul_q30(v[6], row[6] * INT32_C(65536));
    return fixed_dot3_q14(v, row) + fixed_dot3_q14(v + 3, row + 3) + last;
}

int32_t kalman_share(const int32_t covariance[], uint8_t states, const q2_14_t row[],
                     int32_t shared[]) {
    // |shared| <= 1.8 * 2^28 by Cauchy and Schwarz.
    int32_t line[KALMAN_STATES];
    memset(line, 0, sizeof line);
    memset(shared, 0, sizeof line);
    const int32_t *row_of_pairs = covariance;
    for (uint8_t a = 0; a < states; ++a) {
        // A row of the whole matrix: along the triangle's row, then down its column.
        const int32_t *pair = row_of_pairs;
        for (uint8_t b = 0; b < states; ++b) {
            line[b] = *pair;
            pair += b < a ? 1 : b + 1;
        }
        row_of_pairs += a + 1;
        shared[a] = dot(line, row);
    }
    return dot(shared, row);
}

void kalman_read(int32_t covariance[], uint8_t states, const q2_14_t row[],
                 int32_t noise, q2_30_t gain[]) {
    int32_t shared[KALMAN_STATES];
    memset(gain, 0, sizeof shared);
    const int32_t known =
        fixed_clamp(kalman_share(covariance, states, row, shared), SPREAD_MAX - noise);
    const int32_t spread = known > 0 ? known + noise : noise;
    // In [2^30, 2^31), so that its inverse has all its bits.
    const uint8_t up = (uint8_t)(fixed_leading_zeros((uint32_t)spread) - 1);
    const q2_30_t inverse =
        fixed_ratio(UINT32_C(1073741824), (uint32_t)fixed_scale_up(spread, up));
    for (uint8_t a = 0; a < states; ++a) {
        shared[a] = fixed_clamp(shared[a], spread);
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
