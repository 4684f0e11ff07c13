// SPDX-License-Identifier: MIT
// Rotation matrices of 16 bits; see matrix.h for bounds.
#include "core/math/matrix.h"

// One copy each: inlined, they are three times the size.
#define NOINLINE __attribute__((noinline))

// A component as q1_15, 1 and -1 held a step short of them.
NOINLINE static int16_t coarse(q2_30_t value) {
    const int16_t rounded =
        (int16_t)fixed_high_half((uint32_t)value * 2 + UINT32_C(32768));
    if (rounded == INT16_MIN) {
        return value < 0 ? (int16_t)-INT16_MAX : INT16_MAX;
    }
    return rounded;
}

// Twice a b + c d of q1_15 as q2_14. Of a unit quaternion it is at most 2, and modulo 4
// even 2 is enough for what it is taken from.
NOINLINE static q2_14_t twice(int16_t a, int16_t b, int16_t c, int16_t d) {
    const int32_t sum = (int32_t)a * b + (int32_t)c * d;
    return (q2_14_t)fixed_high_half((uint32_t)sum * 2 + UINT32_C(32768));
}

void matrix_from_quat(const struct quat *q, struct matrix *out) {
    enum { ONE = 16384 };
    const int16_t w = coarse(q->w);
    const int16_t x = coarse(q->x);
    const int16_t y = coarse(q->y);
    const int16_t z = coarse(q->z);
    const int16_t minus_w = (int16_t)-w;
    out->row[0][0] = (q2_14_t)(ONE - twice(y, y, z, z));
    out->row[0][1] = twice(x, y, minus_w, z);
    out->row[0][2] = twice(x, z, w, y);
    out->row[1][0] = twice(x, y, w, z);
    out->row[1][1] = (q2_14_t)(ONE - twice(x, x, z, z));
    out->row[1][2] = twice(y, z, minus_w, x);
    out->row[2][0] = twice(x, z, minus_w, y);
    out->row[2][1] = twice(y, z, w, x);
    out->row[2][2] = (q2_14_t)(ONE - twice(x, x, y, y));
}

void matrix_turn(const struct matrix *matrix, const int32_t v[3], int32_t out[3]) {
    for (uint8_t row = 0; row < 3; ++row) {
        out[row] = fixed_dot3_q14(v, matrix->row[row]);
    }
}
