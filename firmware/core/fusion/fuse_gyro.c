// SPDX-License-Identifier: MIT
// Rest, and the gyroscope's bias and scales: one Kalman filter of them and of the error
// of the integrated heading. A rest tells of the bias, what levelling had to correct of
// bias and scales, and a reading across the horizontal field of what has turned the
// heading.
#include <string.h>

#include "core/fusion/fuse_stages.h"

#define LOOK_S (2 * FUSE_WINDOW_S)  // of an axis for bias and scales in motion

enum {
    REST_SETTLE = FUSE_LOOKS(FUSE_REST_TAU_S),
    DRIFT_LOOKS = ROUNDED(FUSE_DRIFT_TAU_S / LOOK_S),
    DRIFT_SQUARE_LOOKS = ROUNDED(FUSE_DRIFT_SQUARE_TAU_S / LOOK_S),
    SCALE_SIGMA_MAX = ROUNDED(FUSE_SCALE_SIGMA * 1e5),  // as 1e-5
    WARMING_STEPS = 32,
    WARMING_WINDOWS = FUSE_WINDOWS(FUSE_WARMING_TAU_S),
};

#define REST_RATE_Q25 Q_RAD(FUSE_REST_RATE_DPS, 25)
#define REST_FORCE_Q21 Q21(FUSE_REST_FORCE_M_S2)
#define REST_RATE_LIMIT_Q25 Q25(FUSE_REST_RATE_MAX_RAD_S)
#define BIAS_LIMIT_Q25 Q25(FUSE_BIAS_MAX_RAD_S)

// Variances of the states as q11_21.
#define BIAS_VARIANCE(square_dps) Q21(SQUARE(FUSE_BIAS_UNITS) * (square_dps))
#define SCALE_VARIANCE(square) Q21(SQUARE(1.0 * FUSE_RATE_UNIT_DPS) * (square))
#define TURNED_VARIANCE(square_deg) Q21((square_deg) / SQUARE(FUSE_HEADING_UNIT_DEG))
#define BIAS_VARIANCE_MAX BIAS_VARIANCE(SQUARE(FUSE_BIAS_SIGMA_DPS))
#define BIAS_VARIANCE_FOUND BIAS_VARIANCE(SQUARE(FUSE_BIAS_FOUND_SIGMA_DPS))
#define SCALE_VARIANCE_MAX SCALE_VARIANCE(SQUARE(FUSE_SCALE_SIGMA))
#define SCALE_VARIANCE_MIN SCALE_VARIANCE(SQUARE(FUSE_SCALE_SIGMA_LEAST))
#define SCALE_VARIANCE_UNIT ((uint32_t)SCALE_VARIANCE(1e-10))  // of 1e-5, squared
#define TURNED_VARIANCE_MAX TURNED_VARIANCE(SQUARE(FUSE_TURNED_SIGMA_MAX_DEG))
#define TURNED_STEP_MAX TURNED_VARIANCE(FUSE_TURNED_STEP_MAX_DEG2)
#define BIAS_WANDER BIAS_VARIANCE(FUSE_PER_WINDOW(FUSE_BIAS_WANDER_DPS2_S))
#define WARMING                                                                        \
    ((uint16_t)BIAS_VARIANCE(WARMING_STEPS * FUSE_PER_WINDOW(FUSE_WARMING_DPS2_S)))
#define SCALE_WANDER SCALE_VARIANCE(FUSE_PER_WINDOW(FUSE_SCALE_WANDER_S))
// Of what levelling corrects in a look, (deg/s)^2 q11_21; the square of what continues
// is (rad/s)^2 q2_30.
#define MOTION_NOISE Q21(FUSE_MOTION_NOISE_DPS2_S / LOOK_S)
#define MOTION_DRIFT Q_DEG2(FUSE_MOTION_DRIFT_S / LOOK_S / 512, 0)
#define MOTION_DRIFT_MAX_Q30 Q_RAD2(FUSE_MOTION_DRIFT_MAX_DPS2, 30)
#define REST_NOISE BIAS_VARIANCE(SQUARE(FUSE_REST_SIGMA_DPS))
#define REST_AGAINST_Q25 Q_RAD(FUSE_REST_AGAINST_DPS, 25)
#define REST_DOUBT_Q25 Q_RAD(FUSE_REST_DOUBT_MAX_DPS, 25)
// The square of a surprise, (rad/s)^2 q34, as its noise.
#define REST_DOUBT Q_DEG2(FUSE_REST_DOUBT / 512, 0)
#define REST_SURPRISE_Q25 Q25(FUSE_REST_SURPRISE_MAX_RAD_S)
#define TILTING_LIMIT_Q25 Q_RAD(FUSE_TILTING_MAX_DPS, 25)
#define TURN_LIMIT_Q14 Q14(FUSE_TURN_MAX)
#define SCALE_LIMIT_Q30 Q30(FUSE_SCALE_MAX)
// rad/s as q15 to q2_14 in 500 deg/s; the product is halved.
#define TURN_GAIN_Q30 Q_DEG(1.0 / FUSE_RATE_UNIT_DPS / 2, 30)
// A scale as q2_30 times 500 deg/s to rad/s q7_25.
#define EFFECT_GAIN_Q30 Q_RAD(FUSE_RATE_UNIT_DPS / 32.0, 30)
// Scale a rad/s of surprise, from q7_25 to q2_30; half of it.
#define SCALE_GAIN_Q30 Q_DEG(32.0 / FUSE_RATE_UNIT_DPS / 2, 30)
// A window of a rate in 1 deg/s, in 4 deg.
#define TURNED_GAIN_Q30 Q30(FUSE_WINDOW_S / FUSE_HEADING_UNIT_DEG)

_Static_assert((int)LOWPASS_SHORTS == (int)FUSE_TURNS, "one for each state that turns");

enum {
    SCALE = 3,                                    // the first state of the scales
    HEADING = 6,                                  // and that of the heading's error
    HEADING_PAIRS = HEADING * (HEADING + 1) / 2,  // before its covariances
};

// One copy, whose numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

static const IN_FLASH struct lowpass_gain rest_gain =
    LOWPASS_GAIN(FUSE_LOOK_S, FUSE_REST_TAU_S);

// States are known this well, whatever else is known.
NOINLINE static void set_variances(struct fuse *fuse, uint8_t state, uint8_t end,
                                   int32_t variance) {
    for (; state < end; ++state) {
        *kalman_forget(fuse->state.motion_covariance, FUSE_MOTION_STATES, state) =
            variance;
    }
}

void fuse_init_gyro(struct fuse *fuse) {
    fuse_set_scale_accuracy(fuse, UINT16_MAX);
    set_variances(fuse, 0, SCALE, BIAS_VARIANCE_MAX);
    fuse->state.warming = WARMING;
}

void fuse_set_scale_accuracy(struct fuse *fuse, uint16_t sigma) {
    int32_t variance = SCALE_VARIANCE_MAX;
    if (sigma < SCALE_SIGMA_MAX) {
        variance = SCALE_VARIANCE_MIN +
                   (int32_t)((uint32_t)sigma * sigma * SCALE_VARIANCE_UNIT);
    }
    set_variances(fuse, SCALE, HEADING, variance);
}

void fuse_forget_turned(struct fuse *fuse) {
    set_variances(fuse, HEADING, FUSE_MOTION_STATES, 0);
}

void fuse_set_bias(struct fuse *fuse, const struct vector *bias_rad_s_q25) {
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &fuse->state.bias_rad_s_q25);
    fuse->state.calibrated_rad_s_q25 = fuse->state.bias_rad_s_q25;
    set_variances(fuse, 0, SCALE, BIAS_VARIANCE_FOUND);
    if (fuse->state.windows > 0) {
        // It has turned the inertial frame, in which forces and fields lie.
        fuse->state.windows = FUSE_WINDOWS_LOST;
        fuse->state.rest_looks = FUSE_REST_LOOKS;
    }
}

// Takes v into its mean; true where |v - mean| is below the limit, which is at most
// 2^21.
NOINLINE static bool stays_near(struct lowpass *mean, const struct vector *v,
                                uint8_t looks, int32_t limit) {
    struct vector away;
    lowpass_step(mean, &rest_gain, v, looks);
    vector_subtract(v, &mean->level, &away);
    if (vector_exceeds(&away, limit)) {
        return false;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        // Keeps the precision of the squares.
        away.axis[axis] *= 512;
    }
    const uint32_t bound = (uint32_t)fixed_scale_up(limit, 9);
    return vector_square_q32(&away) < fixed_umul_q32(bound, bound);
}

void fuse_look_for_rest(struct fuse *fuse, const struct measurement *measurement) {
    struct vector rate;
    if (fuse->state.settled_looks <= REST_SETTLE) {
        ++fuse->state.settled_looks;
    }
    (void)fuse_repeats(&fuse->state.acc, &measurement->acc_m_s2_q21);
    vector_clamp(&measurement->gyr_rad_s_q25, REST_RATE_LIMIT_Q25, &rate);
    const bool is_rate_near = stays_near(&fuse->state.rest_rate, &rate,
                                         fuse->state.settled_looks, REST_RATE_Q25);
    const bool is_force_near =
        stays_near(&fuse->state.rest_force, &measurement->acc_m_s2_q21,
                   fuse->state.settled_looks, REST_FORCE_Q21);
    vector_subtract(&fuse->state.rest_rate.level, &fuse->state.calibrated_rad_s_q25,
                    &rate);
    if (!is_rate_near || !is_force_near || vector_exceeds(&rate, REST_RATE_Q25)) {
        fuse->state.rest_looks = 0;
    } else if (fuse->state.rest_looks < FUSE_REST_LOOKS) {
        ++fuse->state.rest_looks;
    }
}

// The rate by which bias and scales that are as estimated turn the level frame about an
// axis that has this row.
static q7_25_t effect(const struct fuse *fuse, const q2_14_t row[FUSE_TURNS]) {
    return fixed_dot3_q14(fuse->state.bias_rad_s_q25.axis, row) +
           fixed_mul_q30(fixed_dot3_q14(fuse->state.scale, row + SCALE),
                         EFFECT_GAIN_Q30);
}

// The uncertainty that a window adds to bias, scales and heading.
void fuse_stage_predict(struct fuse *fuse) {
    int32_t shared[FUSE_TURNS];
    int32_t *const covariance = fuse->state.motion_covariance;
    kalman_wander(covariance, 0, BIAS_WANDER + fuse->state.warming / WARMING_STEPS,
                  FIXED_HIGH(BIAS_VARIANCE_MAX));
    kalman_wander(covariance, SCALE, SCALE_WANDER, FIXED_HIGH(SCALE_VARIANCE_MAX));
    fuse->state.warming =
        (uint16_t)(fuse->state.warming - fuse->state.warming / WARMING_WINDOWS);
    kalman_share(covariance, HEADING, fuse->state.up, shared);
    int32_t *const heading = covariance + HEADING_PAIRS;
    int32_t sum = 0;
    for (uint8_t state = 0; state < HEADING; ++state) {
        // Before and after the step: twice the half of it.
        const int32_t step = fixed_mul_q30(shared[state], TURNED_GAIN_Q30);
        fixed_add_product(2 * heading[state] + step, fuse->state.up[state], &sum);
        fixed_add(step, &heading[state]);
    }
    int32_t growth = fixed_mul_q30(sum, TURNED_GAIN_Q30);
    if (growth < 0) {
        growth = 0;
    }
    fuse->state.turned_q17 = (uint16_t)fixed_divide(
        fixed_clamp_high(growth, FIXED_HIGH(TURNED_STEP_MAX)), 16);
    if (growth > TURNED_VARIANCE_MAX - heading[HEADING]) {
        // It is limited, so that its covariances would soon be more than it allows.
        (void)kalman_forget(covariance, FUSE_MOTION_STATES, HEADING);
    }
    fixed_add_clamped_high(growth, FIXED_HIGH(TURNED_VARIANCE_MAX), &heading[HEADING]);
}

// Rates over the frame about the axes of the body, in the level frame: the columns of
// `row` after the third.
NOINLINE static void turn_rates(struct fuse *fuse, q2_14_t row[3][FUSE_TURNS]) {
    struct matrix level_from_inertial;
    const q2_30_t gain = fixed_mul_q30(fuse->coefficients.share, TURN_GAIN_Q30);
    struct vector *const mean = &fuse->state.reading_rad_s_q25;
    matrix_from_quat(&fuse->state.level_from_inertial, &level_from_inertial);
    memset(mean, 0, sizeof *mean);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        struct vector rate;
        struct vector *sum = &fuse->state.turn_sum_q15[axis];
        matrix_turn(&level_from_inertial, sum->axis, rate.axis);
        memset(sum, 0, sizeof *sum);
        for (uint8_t i = 0; i < 3; ++i) {
            fixed_add(rate.axis[i], &mean->axis[i]);
            row[i][SCALE + axis] =
                (q2_14_t)fixed_clamp(fixed_mul_q30(rate.axis[i], gain), TURN_LIMIT_Q14);
        }
    }
}

// The rotation from the body to the level frame, the other way round: the columns
// before.
NOINLINE static void turn_axes(const struct fuse *fuse, q2_14_t row[3][FUSE_TURNS]) {
    struct quat attitude;
    struct matrix level_from_body;
    quat_multiply(&fuse->state.level_from_inertial, &fuse->state.inertial_from_body,
                  &attitude);
    matrix_from_quat(&attitude, &level_from_body);
    for (uint8_t i = 0; i < 3; ++i) {
        for (uint8_t axis = 0; axis < 3; ++axis) {
            row[i][axis] = (q2_14_t)-level_from_body.row[i][axis];
        }
    }
}

// A row of unit rates as one of the units of motion_covariance.
NOINLINE static void to_units(q2_14_t row[]) {
    for (uint8_t axis = 0; axis < SCALE; ++axis) {
        row[axis] = (q2_14_t)(row[axis] / 4);
    }
}

void fuse_stage_regressors(struct fuse *fuse) {
    q2_14_t row[3][FUSE_TURNS];
    turn_rates(fuse, row);
    turn_axes(fuse, row);
    for (uint8_t i = 0; i < 2; ++i) {
        struct fuse_tilt *tilt = &fuse->state.tilt[i];
        lowpass_short_step(&tilt->regressor, row[i], fuse->state.windows);
        lowpass_axis_step(&tilt->taken_off.level, &tilt->taken_off.band,
                          &fuse_level_gain, fuse->state.windows, effect(fuse, row[i]));
    }
    memcpy(fuse->state.up, row[2], sizeof fuse->state.up);
    to_units(fuse->state.up);
}

void fuse_read_motion(struct fuse *fuse, const q2_14_t row[], int32_t noise,
                      q7_25_t surprise) {
    q2_30_t gain[FUSE_MOTION_STATES];
    kalman_read(fuse->state.motion_covariance, FUSE_MOTION_STATES, row, noise, gain);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fixed_add_clamped(fixed_scale_down(fixed_mul_q30(gain[axis], surprise), 2),
                          BIAS_LIMIT_Q25, &fuse->state.bias_rad_s_q25.axis[axis]);
        const int32_t step = fixed_mul_q30(gain[SCALE + axis], surprise);
        fixed_add_clamped(fixed_mul_q30(step, SCALE_GAIN_Q30) * 2, SCALE_LIMIT_Q30,
                          &fuse->state.scale[axis]);
    }
}

// (rad/s)^2 as q2_30, of what levelling keeps correcting about an axis.
NOINLINE static q2_30_t square_of(int16_t drift_q18) {
    return fixed_scale_down((int32_t)drift_q18 * drift_q18, 6);
}

void fuse_stage_rest(struct fuse *fuse) {
    q2_14_t row[FUSE_MOTION_STATES] = {0};
    const uint8_t axis = fuse->state.next_axis;
    if (!fuse_is_at_rest(fuse)) {
        return;
    }
    const int32_t surprise =
        fuse->state.rest_rate.level.axis[axis] - fuse->state.bias_rad_s_q25.axis[axis];
    if (fixed_magnitude(surprise) > (uint32_t)REST_AGAINST_Q25 &&
        fuse->settings.own_variance > FUSE_OWN_CALIBRATED) {
        // In it the field seemed to turn, or not to.
        set_variances(fuse, 0, SCALE, BIAS_VARIANCE_MAX);
        fuse_forget_place(fuse);
    }
    // A slow turn looks like a rest: the farther the rate, the less it tells.
    const int32_t off = fixed_scale_up(fixed_clamp(surprise, REST_DOUBT_Q25), 7);
    row[axis] = FUSE_Q2_14_ONE;
    fuse_read_motion(
        fuse, row, REST_NOISE + fixed_times(fixed_square_q30(off), REST_DOUBT),
        fixed_scale_up(fixed_clamp_high(surprise, FIXED_HIGH(REST_SURPRISE_Q25)), 2));
    fuse_next_axis(fuse);
}

// The surprise of levelling is that of an error that has always been there: what the
// estimates took off each correction is taken back, and what those of now would have
// taken off is not a surprise. The axes take turns.
void fuse_stage_motion(struct fuse *fuse) {
    const uint8_t axis = fuse->state.windows % 2;
    const struct fuse_tilt *tilt = &fuse->state.tilt[axis];
    int16_t *drift = &fuse->state.drift_q18[axis];
    q2_14_t row[FUSE_MOTION_STATES];
    if (fuse->state.windows <= FUSE_LEVEL_SETTLE || fuse_is_force_hidden(fuse)) {
        return;
    }
    const int32_t surprise = fixed_clamp(tilt->corrected_rad_s + tilt->taken_off.level -
                                             effect(fuse, tilt->regressor.level),
                                         TILTING_LIMIT_Q25);
    *drift = (int16_t)(*drift + fixed_divide(fixed_scale_down(surprise, 7) - *drift,
                                             DRIFT_LOOKS));
    if (axis == 1) {
        const int32_t square =
            fixed_half_floor(square_of(drift[-1]) + square_of(*drift));
        fixed_add(fixed_divide(square - fuse->state.drift_square, DRIFT_SQUARE_LOOKS),
                  &fuse->state.drift_square);
    }
    if (!fuse_is_at_rest(fuse) && fuse->state.unsettled == 0) {
        memcpy(row, tilt->regressor.level, sizeof tilt->regressor.level);
        to_units(row);
        row[HEADING] = 0;
        fuse_read_motion(
            fuse, row,
            MOTION_NOISE +
                fixed_times(fixed_clamp(fuse->state.drift_square, MOTION_DRIFT_MAX_Q30),
                            MOTION_DRIFT),
            surprise);
    }
}
