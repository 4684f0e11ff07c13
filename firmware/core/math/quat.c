// SPDX-License-Identifier: MIT
// Quaternion arithmetic; see quat.h for formats and bounds.
#include "core/math/quat.h"

void quat_conjugate(const struct quat *q, struct quat *out) {
    const q2_30_t *part = &q->w;  // four in a row
    q2_30_t *opposite = &out->w;
    opposite[0] = part[0];
    for (uint8_t i = 1; i < 4; ++i) {
        opposite[i] = -part[i];
    }
}

void quat_renormalise(struct quat *q) {
    q2_30_t *const part = &q->w;  // four in a row
    q2_30_t square = 0;
    for (uint8_t i = 0; i < 4; ++i) {
        square += fixed_mul_q30(part[i], part[i]);
    }
    // (3 - |q|^2) / 2 = 1 + (1 - |q|^2) / 2
    const q2_30_t gain = Q2_30_ONE + fixed_half_floor(Q2_30_ONE - square);
    for (uint8_t i = 0; i < 4; ++i) {
        part[i] = fixed_mul_q30(part[i], gain);
    }
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

void quat_from_heading(turn32_t heading, struct quat *out) {
    out->x = 0;
    out->y = 0;
    fixed_sincos(fixed_half_floor(heading), &out->z, &out->w);
}

void quat_about_z(int32_t cosine, int32_t sine, struct quat *out) {
    struct vector unit = {.x = cosine, .y = sine, .z = 0};
    int32_t norm;
    *out = QUAT_IDENTITY;
    if (!vector_normalise(&unit, &unit, &norm)) {
        return;
    }
    // The tangent of half the angle is sine / (1 + cosine) or (1 - cosine) / sine: that
    // whose terms do not cancel.
    const q2_30_t half_cosine = fixed_half_floor(unit.x);
    const q2_30_t half_sine = fixed_half_floor(unit.y);
    unit =
        half_cosine >= 0
            ? (struct vector){.x = Q2_30_ONE / 2 + half_cosine, .y = half_sine, .z = 0}
            : (struct vector){.x = half_sine, .y = Q2_30_ONE / 2 - half_cosine, .z = 0};
    (void)vector_normalise(&unit, &unit, &norm);
    out->w = unit.x;
    out->z = unit.y;
}

void quat_to_no_heading(const struct quat *q, struct quat *out) {
    const q2_30_t sine = fixed_mul_q30(q->w, q->z) + fixed_mul_q30(q->x, q->y);
    const q2_30_t cosine =
        Q2_30_ONE / 2 - fixed_mul_q30(q->y, q->y) - fixed_mul_q30(q->z, q->z);
    quat_about_z(cosine, -sine, out);
}
