// SPDX-License-Identifier: MIT
// Unit quaternions, Hamilton, w x y z, as q2_30.
#ifndef QUAT_H
#define QUAT_H

#include "core/math/vector.h"

struct quat {
    q2_30_t w, x, y, z;
};

#define QUAT_IDENTITY ((struct quat){Q2_30_ONE, 0, 0, 0})

// Writes QUAT_IDENTITY, in less code than an assignment.
void quat_set_identity(struct quat *out);

// a * b; `out` may be either. Needs norms whose product is at most 1.2: then no
// component leaves q2_30 and each is within 1 step.
void quat_multiply(const struct quat *a, const struct quat *b, struct quat *out);

// The opposite rotation.
void quat_conjugate(const struct quat *q, struct quat *out);

// Scales q to norm 1 by one Newton step: an error e of |q| becomes at most 1.65 e^2 and
// 3 steps. For |e| <= 0.3.
void quat_renormalise(struct quat *q);

// The rotation by the vector `angle_rad_q30`, |angle| <= 0.55, to fourth order of its
// half: error below |angle|^5 / 3840 and 2 steps.
void quat_from_small_angle(const struct vector *angle_rad_q30, struct quat *out);

// v turned by q, in v's format; `out` may be v. Needs |v| <= 1.07e9 and |q| <= 1.
void quat_rotate(const struct quat *q, const struct vector *v, struct vector *out);

// The rotation about z by an angle.
void quat_from_heading(turn32_t heading, struct quat *out);

// The rotation about z by the angle of the point (cosine, sine), whose length may be
// any; none where both are zero. Neither may be INT32_MIN.
void quat_about_z(int32_t cosine, int32_t sine, struct quat *out);

// The rotation about z that turns q's own away: after it the image of x has heading 0.
// None where x points up or down.
void quat_to_no_heading(const struct quat *q, struct quat *out);

// Half of q + q * (0, angle / 2), a rotation step to first order. `quarter_rad_q30` is
// a quarter of the angle, at most 1.3 long, and |q| <= 1 + 1e-6: then no component
// leaves q2_30. `out` may be q.
void quat_half_step(const struct quat *q, const struct vector *quarter_rad_q30,
                    struct quat *out);

// q / |q| of any length, its norm within 1e-7 of 1. Returns false and leaves q where it
// is zero. No component may be INT32_MIN.
bool quat_normalise(struct quat *q);

// The rows of q's rotation matrix, q2_30: the axes of the world in the body, where q is
// world_from_body. Its norm must be within 1e-6 of 1.
void quat_to_rows(const struct quat *q, struct vector rows[3]);

// The unit quaternion of such rows, which must be orthogonal within 0.1 and of norms
// within 0.1 of 1 and not above it by more than 1e-6.
void quat_from_rows(const struct vector rows[3], struct quat *out);

#endif
