// SPDX-License-Identifier: MIT
// The thesis' filter; see complementary.h.
#include "core/fusion/complementary.h"

#include "core/math/constant.h"

// Table I in counts of the ranges that the thesis sets, 2 g and 250 deg/s, and of 14
// bits of the AK8963, 0.6 uT: in counts of 16 bits its noise at rest, of which the 3
// were chosen, would be larger than they are.
#define FORCE_COUNT_M_S2 (2 * GRAVITY_M_S2 / 32768)
#define FIELD_COUNT_UT 0.6
#define RATE_COUNT_DPS (1 / 131.0)
#define FORCE_WIDE_Q21 Q21(200 * FORCE_COUNT_M_S2)     // NP
#define FORCE_NARROW_Q21 Q21(150 * FORCE_COUNT_M_S2)   // NPS
#define FIELD_WIDE_Q18 Q18(3 * FIELD_COUNT_UT)         // NP and NPS
#define RATE_LEAST_Q25 Q_RAD(30 * RATE_COUNT_DPS, 25)  // NP and NPS
#define LOW_Q30 Q30(0.025)                             // NPL
#define ALPHA_Q30 Q30(0.9)
#define QUARTER_TURN ((turn32_t)Q32_UNSIGNED(0.25))

void complementary_init(struct complementary *complementary, uint16_t rate_hz,
                        uint16_t gyr_delay_us) {
    (void)rate_hz;
    (void)gyr_delay_us;
    paper_filter_init(&complementary->common);
    complementary_restart(complementary);
}

void complementary_restart(struct complementary *complementary) {
    paper_filter_restart(&complementary->common);
    complementary->roll_rad = 0;
    complementary->pitch_rad = 0;
    complementary->yaw = 0;
}

void complementary_set_bias(struct complementary *complementary,
                            const struct vector *bias_rad_s_q25) {
    paper_filter_set_bias(&complementary->common, bias_rad_s_q25);
}

// The noise filter of section 6: a large change passes, a lesser one goes half the way,
// a small one is low-passed. |value|, |before| <= 9.9e8, so that their difference fits.
static int32_t quieten(int32_t value, int32_t before, int32_t wide, int32_t narrow) {
    const int32_t change = value - before;
    if (fixed_magnitude(change) > (uint32_t)wide) {
        return value;
    }
    if (fixed_magnitude(change) > (uint32_t)narrow) {
        return before + fixed_half_floor(change);
    }
    return before + fixed_mul_q30(change, LOW_Q30);
}

static void quieten_vector(const struct vector *value, struct vector *state,
                           int32_t wide, int32_t narrow) {
    state->x = quieten(value->x, state->x, wide, narrow);
    state->y = quieten(value->y, state->y, wide, narrow);
    state->z = quieten(value->z, state->z, wide, narrow);
}

// The gyroscope's: what is not above the least is drift.
static int32_t rate_of(int32_t rate_q25) {
    return fixed_magnitude(rate_q25) > (uint32_t)RATE_LEAST_Q25 ? rate_q25 : 0;
}

// atan(across / sqrt(one^2 + other^2)) in rad q7_25, within a quarter turn.
static q7_25_t slope(int32_t across, int32_t one, int32_t other) {
    struct vector flat = {.x = one, .y = other, .z = 0};
    // 2^-32 turns times 2 pi.
    return fixed_mul_q32(fixed_atan2(across, vector_normalise(&flat)), Q_RAD(360, 25));
}

// Equations 7.4 and 7.5, as measured + alpha (predicted - measured). The turn of a
// sample is at most 2.1 rad, 42 rad/s for 50 ms, so that |angle| stays below 21, where
// 0.9 (2.1 + |angle|) + 0.16 is no more than itself.
static q7_25_t complement(q7_25_t angle, q7_25_t turn, q7_25_t measured) {
    return measured + fixed_mul_q30(angle + turn - measured, ALPHA_Q30);
}

// Rad q7_25 as an angle that wraps: 2^32 / (2 pi 2^25) is 20 + 1597009354 / 2^32.
static turn32_t wrapped(q7_25_t angle) {
    return (turn32_t)((uint32_t)angle * 20 +
                      (uint32_t)fixed_mul_q32(angle, INT32_C(1597009354)));
}

static void follow_field(struct complementary *complementary) {
    struct vector m = complementary->field_ut_q18;
    q2_30_t sin_roll;
    q2_30_t cos_roll;
    q2_30_t sin_pitch;
    q2_30_t cos_pitch;
    if (vector_normalise(&m) == 0) {
        return;
    }
    fixed_sincos(wrapped(complementary->roll_rad), &sin_roll, &cos_roll);
    fixed_sincos(wrapped(complementary->pitch_rad), &sin_pitch, &cos_pitch);
    // Equations 7.6 to 7.8: components of a unit vector, turned.
    const q2_30_t mag_x = fixed_mul_q30(m.z, sin_roll) - fixed_mul_q30(m.y, cos_roll);
    const q2_30_t down = fixed_mul_q30(m.y, sin_roll) + fixed_mul_q30(m.z, cos_roll);
    const q2_30_t mag_y =
        fixed_mul_q30(m.x, cos_pitch) + fixed_mul_q30(down, sin_pitch);
    complementary->yaw = fixed_atan2(mag_x, mag_y);
}

void complementary_step(struct complementary *complementary,
                        const struct measurement *measurement, uint32_t interval_us) {
    struct paper_filter *common = &complementary->common;
    struct vector *force = &complementary->force_m_s2_q21;
    struct vector *field = &complementary->field_ut_q18;
    struct vector rate;
    paper_filter_count(common, measurement, interval_us);
    if (common->has_level) {
        quieten_vector(&measurement->acc_m_s2_q21, force, FORCE_WIDE_Q21,
                       FORCE_NARROW_Q21);
    } else {
        *force = measurement->acc_m_s2_q21;
    }
    const q7_25_t roll = slope(force->y, force->x, force->z);
    const q7_25_t pitch = slope(-force->x, force->y, force->z);
    if (common->has_level) {
        const int32_t seconds_q33 = paper_filter_seconds_q33(interval_us);
        paper_filter_rate(common, measurement, &rate);
        // Rad q4_28, and 3 bits less.
        const q7_25_t turn_x =
            fixed_scale_down(fixed_mul_q30(rate_of(rate.x), seconds_q33), 3);
        const q7_25_t turn_y =
            fixed_scale_down(fixed_mul_q30(rate_of(rate.y), seconds_q33), 3);
        complementary->roll_rad = complement(complementary->roll_rad, turn_x, roll);
        complementary->pitch_rad = complement(complementary->pitch_rad, turn_y, pitch);
    } else {
        complementary->roll_rad = roll;
        complementary->pitch_rad = pitch;
        common->has_level = true;
    }
    if (measurement->has_mag) {
        if (common->has_heading) {
            quieten_vector(&measurement->mag_ut_q18, field, FIELD_WIDE_Q18,
                           FIELD_WIDE_Q18);
        } else {
            *field = measurement->mag_ut_q18;
            common->has_heading = true;
        }
        follow_field(complementary);
    }
}

void complementary_orientation(const struct complementary *complementary,
                               struct quat *out) {
    struct quat turn;
    q2_30_t sin_roll;
    q2_30_t cos_roll;
    q2_30_t sin_pitch;
    q2_30_t cos_pitch;
    fixed_sincos(wrapped(complementary->roll_rad) / 2, &sin_roll, &cos_roll);
    fixed_sincos(wrapped(complementary->pitch_rad) / 2, &sin_pitch, &cos_pitch);
    const struct quat level = {
        fixed_mul_q30(cos_pitch, cos_roll), fixed_mul_q30(cos_pitch, sin_roll),
        fixed_mul_q30(sin_pitch, cos_roll), -fixed_mul_q30(sin_pitch, sin_roll)};
    // The thesis' world has x to the north and y to the west.
    quat_from_heading(turn32_add(complementary->yaw, QUARTER_TURN), &turn);
    quat_multiply(&turn, &level, out);
    quat_renormalise(out);
}

void complementary_quality(const struct complementary *complementary,
                           struct attitude_quality *out) {
    paper_filter_quality(&complementary->common, out);
}
