// SPDX-License-Identifier: MIT
// Quaternion arithmetic; see quat.h for formats and bounds.
#include "quat.h"

void quat_multiply(const struct quat *a, const struct quat *b, struct quat *out) {
    const struct quat product = {
        fixed_mul_q30(a->w, b->w) - fixed_mul_q30(a->x, b->x) -
            fixed_mul_q30(a->y, b->y) - fixed_mul_q30(a->z, b->z),
        fixed_mul_q30(a->w, b->x) + fixed_mul_q30(a->x, b->w) +
            fixed_mul_q30(a->y, b->z) - fixed_mul_q30(a->z, b->y),
        fixed_mul_q30(a->w, b->y) - fixed_mul_q30(a->x, b->z) +
            fixed_mul_q30(a->y, b->w) + fixed_mul_q30(a->z, b->x),
        fixed_mul_q30(a->w, b->z) + fixed_mul_q30(a->x, b->y) -
            fixed_mul_q30(a->y, b->x) + fixed_mul_q30(a->z, b->w),
    };
    *out = product;
}

void quat_conjugate(const struct quat *q, struct quat *out) {
    out->w = q->w;
    out->x = -q->x;
    out->y = -q->y;
    out->z = -q->z;
}

void quat_renormalise(struct quat *q) {
    const q2_30_t square = fixed_mul_q30(q->w, q->w) + fixed_mul_q30(q->x, q->x) +
                           fixed_mul_q30(q->y, q->y) + fixed_mul_q30(q->z, q->z);
    // (3 - |q|^2) / 2 = 1 + (1 - |q|^2) / 2
    const q2_30_t gain = Q2_30_ONE + fixed_half_floor(Q2_30_ONE - square);
    q->w = fixed_mul_q30(q->w, gain);
    q->x = fixed_mul_q30(q->x, gain);
    q->y = fixed_mul_q30(q->y, gain);
    q->z = fixed_mul_q30(q->z, gain);
}

#define ONE_48TH INT32_C(22369621)  // 1/48 as q2_30

void quat_from_small_angle(const struct vector *angle_rad_q30, struct quat *out) {
    // cos(a/2) = 1 - a^2/8 + a^4/384, sin(a/2)/a = 1/2 - a^2/48 + ..., and what is
    // missing of the norm's square is a^6/9216: there is no need to renormalise often.
    const q2_30_t square = vector_square_q30(angle_rad_q30);
    const q2_30_t eighth = fixed_scale_down(square, 3);
    const q2_30_t gain = Q2_30_ONE / 2 - fixed_mul_q30(square, ONE_48TH);
    out->w =
        Q2_30_ONE - eighth + fixed_mul_q30(fixed_mul_q30(square, eighth), ONE_48TH);
    out->x = fixed_mul_q30(angle_rad_q30->x, gain);
    out->y = fixed_mul_q30(angle_rad_q30->y, gain);
    out->z = fixed_mul_q30(angle_rad_q30->z, gain);
}

// The vector part of q times v, in v's format.
static void cross(const struct quat *q, const struct vector *v, struct vector *out) {
    out->x = fixed_mul_q30(q->y, v->z) - fixed_mul_q30(q->z, v->y);
    out->y = fixed_mul_q30(q->z, v->x) - fixed_mul_q30(q->x, v->z);
    out->z = fixed_mul_q30(q->x, v->y) - fixed_mul_q30(q->y, v->x);
}

void quat_rotate(const struct quat *q, const struct vector *v, struct vector *out) {
    // v + w t + u x t with u the vector part and t = 2 u x v; |t| <= 2 |v| < 2^31.
    struct vector t;
    struct vector turned;
    cross(q, v, &t);
    t.x *= 2;
    t.y *= 2;
    t.z *= 2;
    cross(q, &t, &turned);
    out->x = v->x + fixed_mul_q30(t.x, q->w) + turned.x;
    out->y = v->y + fixed_mul_q30(t.y, q->w) + turned.y;
    out->z = v->z + fixed_mul_q30(t.z, q->w) + turned.z;
}

void quat_from_heading(turn32_t heading, struct quat *out) {
    out->x = 0;
    out->y = 0;
    fixed_sincos(heading / 2, &out->z, &out->w);
}

turn32_t quat_heading(const struct quat *q) {
    const q2_30_t sine = fixed_mul_q30(q->w, q->z) + fixed_mul_q30(q->x, q->y);
    const q2_30_t cosine =
        Q2_30_ONE / 2 - fixed_mul_q30(q->y, q->y) - fixed_mul_q30(q->z, q->z);
    return fixed_atan2(sine, cosine);
}
