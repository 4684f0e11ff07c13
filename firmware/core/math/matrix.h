// SPDX-License-Identifier: MIT
// Rotation matrices of 16 bits: coarser than a quaternion and three times as quick to
// turn a vector with.
#ifndef MATRIX_H
#define MATRIX_H

#include "core/math/quat.h"

struct matrix {
    q2_14_t row[3][3];
};

// The rotation of a unit quaternion (within 1e-6); each element within 1.2e-4.
void matrix_from_quat(const struct quat *q, struct matrix *out);

// v turned, in v's format; `out` may not be v. Needs |v| <= 2.1e9.
void matrix_turn(const struct matrix *matrix, const int32_t v[3], int32_t out[3]);

#endif
