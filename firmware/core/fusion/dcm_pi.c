// SPDX-License-Identifier: MIT
// Baranek's filter; see dcm_pi.h.
#include "core/fusion/dcm_pi.h"

#include "core/math/constant.h"

#define GRAVITY_Q21 Q21(GRAVITY_M_S2)
// Kp 500 and Ki 0.1 a sample. In rad/s such a Kp is unstable at any period above 4 ms.
// In counts of the paper's L3G4200D as it wakes up, 8.75 mdps at 100 Hz, they make a
// loop of 13 s with critical damping, which "slowly follows": that is meant.
#define COUNT_DPS 0.00875
#define KP_Q25 Q_RAD(500 * COUNT_DPS, 25)  // 0.0764 rad/s
// 0.00153 rad/s a second, q2_30 over the 8 by which an interval's q33 exceeds q30.
#define KI_Q27 Q_RAD(0.1 * COUNT_DPS * 100 / 8, 30)
#define STEP_MAX_US UINT32_C(7500)  // 74 rad/s turn 0.56 rad in it
#define INTERVAL_MAX_US UINT32_C(50000)

void dcm_pi_init(struct dcm_pi *dcm_pi, uint16_t rate_hz, uint16_t gyr_delay_us) {
    (void)rate_hz;
    (void)gyr_delay_us;
    paper_filter_init(&dcm_pi->common);
    dcm_pi->sum_x_rad_s = 0;
    dcm_pi->sum_y_rad_s = 0;
    dcm_pi_restart(dcm_pi);
}

void dcm_pi_restart(struct dcm_pi *dcm_pi) {
    paper_filter_restart(&dcm_pi->common);
    quat_to_rows(&QUAT_IDENTITY, dcm_pi->rows);
}

void dcm_pi_set_bias(struct dcm_pi *dcm_pi, const struct vector *bias_rad_s_q25) {
    paper_filter_set_bias(&dcm_pi->common, bias_rad_s_q25);
    // What the controllers have taken for offset is in the bias.
    dcm_pi->sum_x_rad_s = 0;
    dcm_pi->sum_y_rad_s = 0;
}

// Equations 15 and 16: the offset in q7_25 rad/s, below 1.08, of an error within 1.
static int32_t control(q2_30_t *sum, q2_30_t error, int32_t seconds_q33,
                       q2_30_t trust) {
    const q2_30_t gain = fixed_mul_q30(seconds_q33, KI_Q27);
    *sum = fixed_clamp(*sum + fixed_mul_q30(error, gain), Q2_30_ONE);
    return fixed_mul_q30(fixed_mul_q30(KP_Q25, error) + fixed_scale_down(*sum, 5),
                         trust);
}

// Subtracts the offsets that the measured vertical tells from the rate.
static void remove_offsets(struct dcm_pi *dcm_pi, const struct vector *force_q21,
                           int32_t seconds_q33, struct vector *rate_q25) {
    struct vector a = *force_q21;
    struct vector error;
    const int32_t norm = vector_normalise(&a);
    if (norm == 0) {
        return;
    }
    // Equation 12, the other way round: subtracted from the rate it then turns z to a.
    vector_cross(&dcm_pi->rows[2], &a, &error);
    const q2_30_t trust = fixed_exp_neg((int32_t)fixed_magnitude(GRAVITY_Q21 - norm));
    rate_q25->x -= control(&dcm_pi->sum_x_rad_s, error.x, seconds_q33, trust);
    rate_q25->y -= control(&dcm_pi->sum_y_rad_s, error.y, seconds_q33, trust);
}

// Equation 6 of a row: r (I + Omega T) = r + r x angle.
static void turn_row(struct vector *row, const struct vector *angle_rad_q30) {
    struct vector step;
    vector_cross(row, angle_rad_q30, &step);
    *row = (struct vector){
        .x = row->x + step.x, .y = row->y + step.y, .z = row->z + step.z};
}

// Equation 11: the norm n <= 1.15 becomes n (3 - n^2) / 2, which is within 1 of any n.
static void normalise_row(struct vector *row) {
    const q2_30_t square = vector_square_q30(row);
    vector_scale(row, Q2_30_ONE + fixed_half_floor(Q2_30_ONE - square), row);
}

// Rows of at most 1, turned by 0.56 rad at most, are at most sqrt(1 + 0.56^2) = 1.15
// long, and 0.24 off square.
static void step_rows(struct vector rows[3], const struct vector *angle_rad_q30) {
    struct vector *x = &rows[0];
    struct vector *y = &rows[1];
    turn_row(x, angle_rad_q30);
    turn_row(y, angle_rad_q30);
    // Equations 7 to 9.
    const q2_30_t half = fixed_half_floor(vector_dot(x, y));
    const struct vector old = *x;
    x->x -= fixed_mul_q30(half, y->x);
    x->y -= fixed_mul_q30(half, y->y);
    x->z -= fixed_mul_q30(half, y->z);
    y->x -= fixed_mul_q30(half, old.x);
    y->y -= fixed_mul_q30(half, old.y);
    y->z -= fixed_mul_q30(half, old.z);
    // Equations 10 and 11; the third row's own turn is not needed.
    vector_cross(x, y, &rows[2]);
    normalise_row(x);
    normalise_row(y);
    normalise_row(&rows[2]);
}

void dcm_pi_step(struct dcm_pi *dcm_pi, const struct measurement *measurement,
                 uint32_t interval_us) {
    struct vector rate;
    struct quat start;
    paper_filter_count(&dcm_pi->common, measurement, interval_us);
    if (paper_filter_wants_start(&dcm_pi->common, measurement)) {
        quat_from_rows(dcm_pi->rows, &start);
        if (paper_filter_start(&dcm_pi->common, measurement, &start)) {
            quat_to_rows(&start, dcm_pi->rows);
            return;
        }
    }
    paper_filter_rate(&dcm_pi->common, measurement, &rate);
    remove_offsets(dcm_pi, &measurement->acc_m_s2_q21,
                   paper_filter_seconds_q33(interval_us), &rate);
    // In equal parts, short enough for the repair to hold.
    if (interval_us > INTERVAL_MAX_US) {
        interval_us = INTERVAL_MAX_US;
    }
    const uint8_t parts = (uint8_t)((interval_us + STEP_MAX_US - 1) / STEP_MAX_US);
    if (parts == 0) {
        return;
    }
    // Rad q4_28, at most 0.33 an axis, and two bits more.
    vector_scale(&rate, paper_filter_seconds_q33(interval_us / parts), &rate);
    rate = (struct vector){.x = rate.x * 4, .y = rate.y * 4, .z = rate.z * 4};
    for (uint8_t part = 0; part < parts; ++part) {
        step_rows(dcm_pi->rows, &rate);
    }
}

void dcm_pi_orientation(const struct dcm_pi *dcm_pi, struct quat *out) {
    quat_from_rows(dcm_pi->rows, out);
}

void dcm_pi_quality(const struct dcm_pi *dcm_pi, struct attitude_quality *out) {
    paper_filter_quality(&dcm_pi->common, out);
    out->flags |= POSE_HEADING_FREE;
}
