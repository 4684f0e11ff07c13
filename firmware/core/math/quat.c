// SPDX-License-Identifier: MIT
// Quaternion arithmetic; see quat.h for formats and bounds.
#include "core/math/quat.h"

void quat_set_identity(struct quat *out) {
    *out = QUAT_IDENTITY;
}

void quat_conjugate(const struct quat *q, struct quat *out) {
    const q2_30_t *part = &q->w;  // four in a row
    q2_30_t *opposite = &out->w;
    opposite[0] = part[0];
    for (uint8_t i = 1; i < 4; ++i) {
        opposite[i] = -part[i];
    }
}

// x, y and z as a vector.
static struct vector *vector_of(struct quat *q) {
    _Static_assert(sizeof(struct quat) == 4 * sizeof(q2_30_t), "four in a row");
    return (struct vector *)&q->x;
}

void quat_renormalise(struct quat *q) {
    struct vector *const vector = vector_of(q);
    const q2_30_t square = vector_square_q30(vector) + fixed_square_q30(q->w);
    const q2_30_t gain = 3 * (Q2_30_ONE / 2) - fixed_scale_down(square, 1);
    q->w = fixed_mul_q30(q->w, gain);
    vector_scale(vector, gain, vector);
}

#define ONE_48TH (Q2_30_ONE / 48)

void quat_from_small_angle(const struct vector *angle_rad_q30, struct quat *out) {
    // cos(a/2) = 1 - a^2/8 + a^4/384, sin(a/2)/a = 1/2 - a^2/48 + ..., and what is
    // missing of the norm's square is a^6/9216: there is no need to renormalise often.
    const q2_30_t square = vector_square_q30(angle_rad_q30);
    const q2_30_t eighth = fixed_scale_down(square, 3);
    const q2_30_t gain = Q2_30_ONE / 2 - fixed_mul_q30(square, ONE_48TH);
    out->w =
        Q2_30_ONE - eighth + fixed_mul_q30(fixed_mul_q30(square, eighth), ONE_48TH);
    vector_scale(angle_rad_q30, gain, vector_of(out));
}

void quat_from_heading(turn32_t heading, struct quat *out) {
    out->x = 0;
    out->y = 0;
    fixed_sincos(fixed_half_floor(heading), &out->z, &out->w);
}

void quat_about_z(int32_t cosine, int32_t sine, struct quat *out) {
    // In two of the components first the angle's, then those of its half.
    struct vector *const unit = (struct vector *)out;
    *out = (struct quat){cosine, sine, 0, 0};
    if (vector_normalise(unit) == 0) {
        out->w = Q2_30_ONE;
        return;
    }
    // The tangent of half the angle is sine / (1 + cosine) or (1 - cosine) / sine: that
    // whose terms do not cancel.
    const q2_30_t half_cosine = fixed_half_floor(out->w);
    const q2_30_t half_sine = fixed_half_floor(out->x);
    q2_30_t *longer = &out->w;
    q2_30_t *other = &out->x;
    if (half_cosine < 0) {
        longer = &out->x;
        other = &out->w;
    }
    *longer = Q2_30_ONE / 2 + (q2_30_t)fixed_magnitude(half_cosine);
    *other = half_sine;
    (void)vector_normalise(unit);
    out->z = out->x;
    out->x = 0;
}

void quat_to_no_heading(const struct quat *q, struct quat *out) {
    const q2_30_t sine = fixed_mul_at(&q->w, &q->z) + fixed_mul_at(&q->x, &q->y);
    const q2_30_t cosine =
        Q2_30_ONE / 2 - fixed_mul_at(&q->y, &q->y) - fixed_mul_at(&q->z, &q->z);
    quat_about_z(cosine, -sine, out);
}

bool quat_normalise(struct quat *q) {
    const uint32_t bits = fixed_magnitude(q->w) | fixed_magnitude(q->x) |
                          fixed_magnitude(q->y) | fixed_magnitude(q->z);
    if (bits == 0) {
        return false;
    }
    // As vector_normalise(): the largest component comes into [2^30, 2^31), the sum of
    // squares over 2^32 into [2^28, 2^32).
    const uint8_t up = (uint8_t)(fixed_leading_zeros(bits) - 1);
    q->w = fixed_scale_up(q->w, up);
    q->x = fixed_scale_up(q->x, up);
    q->y = fixed_scale_up(q->y, up);
    q->z = fixed_scale_up(q->z, up);
    const uint32_t w = fixed_magnitude(q->w);
    const uint32_t square =
        fixed_umul_q32(w, w) +
        vector_square_q32(&(struct vector){.x = q->x, .y = q->y, .z = q->z});
    const bool is_low = square < UINT32_C(0x40000000);
    const q2_30_t inverse = fixed_rsqrt(is_low ? square * 4 : square);
    const int32_t once = is_low ? 2 : 1;
    q->w = fixed_mul_q32(q->w, inverse) * once;
    q->x = fixed_mul_q32(q->x, inverse) * once;
    q->y = fixed_mul_q32(q->y, inverse) * once;
    q->z = fixed_mul_q32(q->z, inverse) * once;
    return true;
}

void quat_half_step(const struct quat *q, const struct vector *quarter_rad_q30,
                    struct quat *out) {
    // With u the quarter: a sum of products is at most |q| |u| <= 1.3, and 0.5 + 1.3
    // fit.
    const struct vector *u = quarter_rad_q30;
    const struct quat half = {
        fixed_half_floor(q->w) - fixed_mul_q30(q->x, u->x) - fixed_mul_q30(q->y, u->y) -
            fixed_mul_q30(q->z, u->z),
        fixed_half_floor(q->x) + fixed_mul_q30(q->w, u->x) + fixed_mul_q30(q->y, u->z) -
            fixed_mul_q30(q->z, u->y),
        fixed_half_floor(q->y) + fixed_mul_q30(q->w, u->y) + fixed_mul_q30(q->z, u->x) -
            fixed_mul_q30(q->x, u->z),
        fixed_half_floor(q->z) + fixed_mul_q30(q->w, u->z) + fixed_mul_q30(q->x, u->y) -
            fixed_mul_q30(q->y, u->x),
    };
    *out = half;
}

void quat_to_rows(const struct quat *q, struct vector rows[3]) {
    // A product is at most a half, and so is the sum of two; 1/2 less the sum of two
    // squares is within 1/2: twice that fits.
    const q2_30_t xx = fixed_mul_q30(q->x, q->x);
    const q2_30_t yy = fixed_mul_q30(q->y, q->y);
    const q2_30_t zz = fixed_mul_q30(q->z, q->z);
    const q2_30_t xy = fixed_mul_q30(q->x, q->y);
    const q2_30_t xz = fixed_mul_q30(q->x, q->z);
    const q2_30_t yz = fixed_mul_q30(q->y, q->z);
    const q2_30_t wx = fixed_mul_q30(q->w, q->x);
    const q2_30_t wy = fixed_mul_q30(q->w, q->y);
    const q2_30_t wz = fixed_mul_q30(q->w, q->z);
    const q2_30_t half = Q2_30_ONE / 2;
    rows[0] = (struct vector){
        .x = 2 * (half - yy - zz), .y = 2 * (xy - wz), .z = 2 * (xz + wy)};
    rows[1] = (struct vector){
        .x = 2 * (xy + wz), .y = 2 * (half - xx - zz), .z = 2 * (yz - wx)};
    rows[2] = (struct vector){
        .x = 2 * (xz - wy), .y = 2 * (yz + wx), .z = 2 * (half - xx - yy)};
}

// v / 4, so that four of them may be added.
static struct vector quarter(const struct vector *v) {
    return (struct vector){.x = fixed_scale_down(v->x, 2),
                           .y = fixed_scale_down(v->y, 2),
                           .z = fixed_scale_down(v->z, 2)};
}

void quat_from_rows(const struct vector rows[3], struct quat *out) {
    // w, x, y or z times all four of them, whichever has a square of at least a
    // quarter: the largest of the diagonal tells.
    const struct vector a = quarter(&rows[0]);
    const struct vector b = quarter(&rows[1]);
    const struct vector c = quarter(&rows[2]);
    const q2_30_t one = Q2_30_ONE / 4;
    if (a.x + b.y + c.z > 0) {
        *out = (struct quat){one + a.x + b.y + c.z, c.y - b.z, a.z - c.x, b.x - a.y};
    } else if (a.x >= b.y && a.x >= c.z) {
        *out = (struct quat){c.y - b.z, one + a.x - b.y - c.z, a.y + b.x, a.z + c.x};
    } else if (b.y >= c.z) {
        *out = (struct quat){a.z - c.x, a.y + b.x, one - a.x + b.y - c.z, b.z + c.y};
    } else {
        *out = (struct quat){b.x - a.y, a.z + c.x, b.z + c.y, one - a.x - b.y + c.z};
    }
    (void)quat_normalise(out);
}
