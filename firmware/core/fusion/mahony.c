// SPDX-License-Identifier: MIT
// Mahony's filter; see mahony.h.
#include "core/fusion/mahony.h"

#include "core/math/constant.h"

// Kp / 2, for half an error that turns a quarter of its angle, over the 8 by which an
// interval's q33 exceeds q30.
#define HALF_KP Q30(15.0 / 2 / 8)

void mahony_init(struct mahony *mahony, uint16_t rate_hz, uint16_t gyr_delay_us) {
    (void)rate_hz;
    (void)gyr_delay_us;
    paper_filter_init(&mahony->common);
    mahony_restart(mahony);
}

void mahony_restart(struct mahony *mahony) {
    paper_filter_restart(&mahony->common);
    mahony->world_from_body = QUAT_IDENTITY;
}

void mahony_set_bias(struct mahony *mahony, const struct vector *bias_rad_s_q25) {
    paper_filter_set_bias(&mahony->common, bias_rad_s_q25);
}

// Adds half of measured x estimated, unit vectors: |sum| <= 1/2 each time.
static void add_half_error(const struct vector *measured,
                           const struct vector *estimated, struct vector *sum) {
    struct vector error;
    vector_cross(measured, estimated, &error);
    sum->x += fixed_half_floor(error.x);
    sum->y += fixed_half_floor(error.y);
    sum->z += fixed_half_floor(error.z);
}

void mahony_step(struct mahony *mahony, const struct measurement *measurement,
                 uint32_t interval_us) {
    struct quat *q = &mahony->world_from_body;
    struct vector rows[3];
    struct vector turn;
    struct vector force;
    struct vector field;
    struct vector half_error = {0};
    paper_filter_count(&mahony->common, measurement, interval_us);
    if (paper_filter_wants_start(&mahony->common, measurement) &&
        paper_filter_start(&mahony->common, measurement, q)) {
        return;
    }
    const int32_t seconds_q33 = paper_filter_seconds_q33(interval_us);
    paper_filter_rate(&mahony->common, measurement, &turn);
    vector_scale(&turn, seconds_q33, &turn);
    // Equation 32c: the sum of measured x estimated directions, both of weight 1.
    // Without a force, as the implementation that NECTEC uses, nothing corrects.
    if (paper_filter_unit(&measurement->acc_m_s2_q21, &force)) {
        quat_to_rows(q, rows);
        add_half_error(&force, &rows[2], &half_error);
        if (measurement->has_mag &&
            paper_filter_unit(&measurement->mag_ut_q18, &field)) {
            q2_30_t north;
            q2_30_t up;
            paper_filter_reference(rows, &field, &north, &up);
            const struct vector estimated = {
                .x = fixed_mul_q30(rows[1].x, north) + fixed_mul_q30(rows[2].x, up),
                .y = fixed_mul_q30(rows[1].y, north) + fixed_mul_q30(rows[2].y, up),
                .z = fixed_mul_q30(rows[1].z, north) + fixed_mul_q30(rows[2].z, up)};
            add_half_error(&field, &estimated, &half_error);
        }
    }
    // Equation 32a without the bias' b: rate + Kp error, a quarter of what it turns.
    // The rate's is at most 0.91 long, 72.7 rad/s for 50 ms; the error's 0.375 * 1.
    vector_scale(&half_error, fixed_mul_q30(seconds_q33, HALF_KP), &half_error);
    turn = (struct vector){.x = turn.x + half_error.x,
                           .y = turn.y + half_error.y,
                           .z = turn.z + half_error.z};
    quat_half_step(q, &turn, q);
    (void)quat_normalise(q);
}

void mahony_orientation(const struct mahony *mahony, struct quat *out) {
    *out = mahony->world_from_body;
}

void mahony_quality(const struct mahony *mahony, struct attitude_quality *out) {
    paper_filter_quality(&mahony->common, out);
}
