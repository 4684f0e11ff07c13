// SPDX-License-Identifier: MIT
// Madgwick's filter; see madgwick.h. Equations are those of his report of 2010.
#include "core/fusion/madgwick.h"

#include "core/math/constant.h"

// Half of beta, 0.041 rad/s, over the 8 by which an interval's q33 exceeds q30.
#define HALF_BETA Q30(0.041 / 2 / 8)
#define SQRT_HALF INT32_C(759250125)  // as q2_30

void madgwick_init(struct madgwick *madgwick, uint16_t rate_hz, uint16_t gyr_delay_us) {
    (void)rate_hz;
    (void)gyr_delay_us;
    paper_filter_init(&madgwick->common);
    madgwick_restart(madgwick);
}

// By a quarter turn about z: west-north to north-west and back.
static void turn_frame(const struct quat *q, q2_30_t z, struct quat *out) {
    const struct quat quarter_turn = {SQRT_HALF, 0, 0, z};
    quat_multiply(&quarter_turn, q, out);
}

void madgwick_restart(struct madgwick *madgwick) {
    paper_filter_restart(&madgwick->common);
    turn_frame(&QUAT_IDENTITY, -SQRT_HALF, &madgwick->earth_from_body);
}

void madgwick_set_bias(struct madgwick *madgwick, const struct vector *bias_rad_s_q25) {
    paper_filter_set_bias(&madgwick->common, bias_rad_s_q25);
}

// An eighth of (estimated - measured): at most 1/4 long.
static void eighth_of_error(const struct vector *estimated,
                            const struct vector *measured, struct vector *out) {
    out->x = fixed_scale_down(estimated->x, 3) - fixed_scale_down(measured->x, 3);
    out->y = fixed_scale_down(estimated->y, 3) - fixed_scale_down(measured->y, 3);
    out->z = fixed_scale_down(estimated->z, 3) - fixed_scale_down(measured->z, 3);
}

// The gradient J^T f of equation 34, a sixteenth of it. With up u and north n in the
// body the objectives of equations 25 and 29 are f_g = u - a and f_b = b_x n + b_z u -
// m, so that J^T f is the derivative by q of u . (f_g + b_z f_b) + n . (b_x f_b), whose
// brackets are held here: |up| <= 1/2, |north| <= 1/4.
static void gradient_of(const struct quat *q, const struct vector *up,
                        const struct vector *north, struct quat *out) {
    // u = (2 (xz - wy), 2 (yz + wx), 1 - 2 (xx + yy)): halves of its derivatives, each
    // sum at most 2 |up| = 1.
    out->w = fixed_mul_q30(q->x, up->y) - fixed_mul_q30(q->y, up->x);
    out->x = fixed_mul_q30(q->z, up->x) + fixed_mul_q30(q->w, up->y) -
             2 * fixed_mul_q30(q->x, up->z);
    out->y = fixed_mul_q30(q->z, up->y) - fixed_mul_q30(q->w, up->x) -
             2 * fixed_mul_q30(q->y, up->z);
    out->z = fixed_mul_q30(q->x, up->x) + fixed_mul_q30(q->y, up->y);
    // n = (1 - 2 (yy + zz), 2 (xy - wz), 2 (xz + wy)): at most 0.5 more.
    out->w += fixed_mul_q30(q->y, north->z) - fixed_mul_q30(q->z, north->y);
    out->x += fixed_mul_q30(q->y, north->y) + fixed_mul_q30(q->z, north->z);
    out->y += fixed_mul_q30(q->x, north->y) + fixed_mul_q30(q->w, north->z) -
              2 * fixed_mul_q30(q->y, north->x);
    out->z += fixed_mul_q30(q->x, north->z) - fixed_mul_q30(q->w, north->y) -
              2 * fixed_mul_q30(q->z, north->x);
}

// The direction of the gradient, equation 44; false where there is none.
static bool find_gradient(const struct quat *q, const struct measurement *measurement,
                          struct quat *direction) {
    struct vector rows[3];
    struct vector force;
    struct vector field;
    struct vector up;
    struct vector north = {0};
    if (!paper_filter_unit(&measurement->acc_m_s2_q21, &force)) {
        return false;
    }
    quat_to_rows(q, rows);
    eighth_of_error(&rows[2], &force, &up);
    if (measurement->has_mag && paper_filter_unit(&measurement->mag_ut_q18, &field)) {
        q2_30_t b_x;
        q2_30_t b_z;
        paper_filter_reference(rows, &field, &b_x, &b_z);
        const struct vector estimated = {
            .x = fixed_mul_q30(rows[0].x, b_x) + fixed_mul_q30(rows[2].x, b_z),
            .y = fixed_mul_q30(rows[0].y, b_x) + fixed_mul_q30(rows[2].y, b_z),
            .z = fixed_mul_q30(rows[0].z, b_x) + fixed_mul_q30(rows[2].z, b_z)};
        eighth_of_error(&estimated, &field, &north);
        up.x += fixed_mul_q30(north.x, b_z);
        up.y += fixed_mul_q30(north.y, b_z);
        up.z += fixed_mul_q30(north.z, b_z);
        vector_scale(&north, b_x, &north);
    }
    gradient_of(q, &up, &north, direction);
    return quat_normalise(direction);
}

void madgwick_step(struct madgwick *madgwick, const struct measurement *measurement,
                   uint32_t interval_us) {
    struct quat *q = &madgwick->earth_from_body;
    struct quat direction;
    struct vector turn;
    struct quat start;
    paper_filter_count(&madgwick->common, measurement, interval_us);
    if (paper_filter_wants_start(&madgwick->common, measurement)) {
        turn_frame(q, SQRT_HALF, &start);
        if (paper_filter_start(&madgwick->common, measurement, &start)) {
            turn_frame(&start, -SQRT_HALF, q);
            return;
        }
    }
    const int32_t seconds_q33 = paper_filter_seconds_q33(interval_us);
    const bool has_direction = find_gradient(q, measurement, &direction);
    // Equations 11 to 13 and 42 to 44, halved: q / 2 + (rate's step - beta direction)
    // / 2. |rate's quarter turn| <= 0.91, 72.7 rad/s for 50 ms; |beta's| <= 0.0011.
    paper_filter_rate(&madgwick->common, measurement, &turn);
    vector_scale(&turn, seconds_q33, &turn);
    quat_half_step(q, &turn, q);
    if (has_direction) {
        const q2_30_t beta = fixed_mul_q30(seconds_q33, HALF_BETA);
        q->w -= fixed_mul_q30(direction.w, beta);
        q->x -= fixed_mul_q30(direction.x, beta);
        q->y -= fixed_mul_q30(direction.y, beta);
        q->z -= fixed_mul_q30(direction.z, beta);
    }
    (void)quat_normalise(q);
}

void madgwick_orientation(const struct madgwick *madgwick, struct quat *out) {
    turn_frame(&madgwick->earth_from_body, SQRT_HALF, out);
}

void madgwick_quality(const struct madgwick *madgwick, struct attitude_quality *out) {
    paper_filter_quality(&madgwick->common, out);
}
