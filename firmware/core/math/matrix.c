// SPDX-License-Identifier: MIT
// Rotation matrices of 16 bits; see matrix.h for bounds.
#include "core/math/matrix.h"

void matrix_turn(const struct matrix *matrix, const int32_t v[3], int32_t out[3]) {
    for (uint8_t row = 0; row < 3; ++row) {
        out[row] = fixed_dot3_q14(v, matrix->row[row]);
    }
}
