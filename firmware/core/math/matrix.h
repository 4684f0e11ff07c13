// SPDX-License-Identifier: MIT
// Rotation matrices of 16 bits: less precise than a quaternion, but three times as fast
// to rotate a vector.
#ifndef MATRIX_H
#define MATRIX_H

#include "core/math/quat.h"

struct matrix {
    q2_14_t row[3][3];
};

// The matrix of a unit quaternion (norm within 1e-6 of 1); elements within 1.2e-4.
void matrix_from_quat(const struct quat *q, struct matrix *out);

// Rotates v; `out` has the format of v and may be v. Needs |v| <= 2.1e9.
void matrix_turn(const struct matrix *matrix, const int32_t v[3], int32_t out[3]);

#endif
