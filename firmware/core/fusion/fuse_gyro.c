// SPDX-License-Identifier: MIT
// Rest, and the gyroscope's bias and scales: one Kalman filter of them and of the error
// of the integrated heading. A rest tells of the bias, what levelling had to correct of
// bias and scales, and a reading across the horizontal field of what has turned the
// heading.
#include <string.h>

#include "core/fusion/fuse_stages.h"

enum {
    REST_SETTLE = 50,  // looks in VQF's mean of 0.5 s
    // Of what levelling goes on to correct, and of its square: 2 and 6.4 s, a look of
    // an axis every second frame.
    DRIFT_LOOKS = 10,
    DRIFT_SQUARE_LOOKS = 32,
};

#define REST_RATE_Q25 INT32_C(1171271)          // VQF's 2 deg/s
#define REST_FORCE_Q21 INT32_C(1048576)         // VQF's 0.5 m/s2
#define REST_RATE_LIMIT_Q25 INT32_C(335544320)  // 10 rad/s: keeps the low-pass in range
#define BIAS_LIMIT_Q25 INT32_C(114085069)       // 3.4 rad/s

// Variances as q11_21: of the bias in 4ths of 1 deg/s, of scales in 500ths, of the
// heading's error in 4 deg.
#define BIAS_VARIANCE_MAX INT32_C(8388608)     // (0.5 deg/s)^2
#define BIAS_VARIANCE_FOUND INT32_C(3355)      // (0.01 deg/s)^2
#define SCALE_VARIANCE_MAX INT32_C(52428800)   // 1 %: (5 / 500)^2
#define SCALE_VARIANCE_MIN INT32_C(47186)      // 0.03 %, which temperature changes
#define SCALE_VARIANCE_UNIT UINT32_C(52)       // 1e-5, squared
#define SCALE_SIGMA_MAX 1000                   // 1 %, as 1e-5
#define TURNED_VARIANCE_MAX INT32_C(52428800)  // (20 deg)^2
#define TURNED_STEP_MAX INT32_C(786432)        // 6 deg2
#define BIAS_WANDER INT32_C(503)               // 1.5e-4 (deg/s)^2 a second
#define WARMING_STEPS 32
#define WARMING UINT16_C(53687)   // 5e-4 (deg/s)^2 a second more, as 32nds
#define SCALE_WANDER INT32_C(21)  // 4e-10 a second
// Of what levelling corrects: 1.2 (deg/s)^2 s, and 10 s times the square of what it
// goes on to correct, at most 3.057 (deg/s)^2, from q2_30; over the 0.2 s of a look.
#define MOTION_NOISE INT32_C(12582912)
#define MOTION_DRIFT INT32_C(321)
#define MOTION_DRIFT_MAX_Q30 INT32_C(999885)
#define REST_NOISE INT32_C(30199)        // (0.03 deg/s)^2 of a mean at rest, in 4ths
#define REST_DOUBT_Q25 INT32_C(2342541)  // 4 deg/s: 0.78 of its square is noise
#define REST_SURPRISE_Q25 INT32_C(134217728)  // 4 rad/s
#define TILTING_LIMIT_Q25 INT32_C(2928177)    // 5 deg/s
#define TURN_LIMIT_Q14 INT32_C(24576)         // 1.5 * 500 deg/s
#define SCALE_LIMIT_Q30 INT32_C(85899346)     // 8 %
// rad/s as q15 over 500 deg/s to q2_14: 2^-1 * 0.1145916.
#define TURN_GAIN_Q30 INT32_C(61520875)
// A scale as q2_30 times 500 deg/s to rad/s q7_25: 8.726646 / 2^5.
#define EFFECT_GAIN_Q30 INT32_C(292817659)
// Scale a rad/s of surprise, from q7_25 to q2_30: 57.29578 / 500 * 2^5, halved.
#define SCALE_GAIN_Q30 INT32_C(1968667994)
// 0.1 s of a rate in 1 deg/s, in 4 deg.
#define TURNED_GAIN_Q30 INT32_C(26843546)

_Static_assert((int)LOWPASS_SHORTS == (int)FUSE_TURNS, "one for each state that turns");

enum {
    SCALE = 3,                                    // the first state of the scales
    HEADING = 6,                                  // and that of the heading's error
    HEADING_PAIRS = HEADING * (HEADING + 1) / 2,  // before its covariances
};

// One copy, whose numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

// Of VQF's rest filter, 0.5 s, at 100 looks a second.
static const IN_FLASH struct lowpass_gain rest_gain = {
    INT32_C(15186038), INT32_C(1052480662), REST_SETTLE};

// States are known this well, whatever else is known.
NOINLINE static void set_variances(struct fuse *fuse, uint8_t state, uint8_t end,
                                   int32_t variance) {
    for (; state < end; ++state) {
        *kalman_forget(fuse->motion_covariance, FUSE_MOTION_STATES, state) = variance;
    }
}

void fuse_init_gyro(struct fuse *fuse) {
    fuse_set_scale_accuracy(fuse, UINT16_MAX);
    set_variances(fuse, 0, SCALE, BIAS_VARIANCE_MAX);
    fuse->warming = WARMING;
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
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &fuse->bias_rad_s_q25);
    fuse->calibrated_rad_s_q25 = fuse->bias_rad_s_q25;
    set_variances(fuse, 0, SCALE, BIAS_VARIANCE_FOUND);
    if (fuse->frames > 0) {
        // It has turned the inertial frame, in which forces and fields lie.
        fuse->frames = FUSE_FRAMES_LOST;
        fuse->rest_looks = FUSE_REST_LOOKS;
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
        away.axis[axis] = fixed_scale_up(away.axis[axis], 9);
    }
    const uint32_t bound = (uint32_t)fixed_scale_up(limit, 9);
    return vector_square_q32(&away) < fixed_umul_q32(bound, bound);
}

void fuse_look_for_rest(struct fuse *fuse, const struct measurement *measurement) {
    struct vector rate;
    if (fuse->settled_looks <= REST_SETTLE) {
        ++fuse->settled_looks;
    }
    vector_clamp(&measurement->gyr_rad_s_q25, REST_RATE_LIMIT_Q25, &rate);
    const bool is_rate_near =
        stays_near(&fuse->rest_rate, &rate, fuse->settled_looks, REST_RATE_Q25);
    const bool is_force_near = stays_near(&fuse->rest_force, &measurement->acc_m_s2_q21,
                                          fuse->settled_looks, REST_FORCE_Q21);
    vector_subtract(&fuse->rest_rate.level, &fuse->calibrated_rad_s_q25, &rate);
    if (!is_rate_near || !is_force_near || vector_exceeds(&rate, REST_RATE_Q25)) {
        fuse->rest_looks = 0;
    } else if (fuse->rest_looks < FUSE_REST_LOOKS) {
        ++fuse->rest_looks;
    }
}

// The rate by which bias and scales that are as estimated turn the level frame about an
// axis that has this row.
static q7_25_t effect(const struct fuse *fuse, const q2_14_t row[FUSE_TURNS]) {
    return fixed_dot3_q14(fuse->bias_rad_s_q25.axis, row) +
           fixed_mul_q30(fixed_dot3_q14(fuse->scale, row + SCALE), EFFECT_GAIN_Q30);
}

// The uncertainty that a frame adds to bias, scales and heading.
void fuse_stage_predict(struct fuse *fuse) {
    int32_t shared[FUSE_TURNS];
    int32_t *const covariance = fuse->motion_covariance;
    kalman_wander(covariance, 0, BIAS_WANDER + fuse->warming / WARMING_STEPS,
                  FIXED_HIGH(BIAS_VARIANCE_MAX));
    kalman_wander(covariance, SCALE, SCALE_WANDER, FIXED_HIGH(SCALE_VARIANCE_MAX));
    fuse->warming = (uint16_t)(fuse->warming - fuse->warming / 256);
    kalman_share(covariance, HEADING, fuse->up, shared);
    int32_t *const heading = covariance + HEADING_PAIRS;
    int32_t sum = 0;
    for (uint8_t state = 0; state < HEADING; ++state) {
        // Before and after the step: twice the half of it.
        const int32_t step = fixed_mul_q30(shared[state], TURNED_GAIN_Q30);
        fixed_add_product(2 * heading[state] + step, fuse->up[state], &sum);
        fixed_add(step, &heading[state]);
    }
    int32_t growth = fixed_mul_q30(sum, TURNED_GAIN_Q30);
    if (growth < 0) {
        growth = 0;
    }
    fuse->turned_q17 = (uint16_t)fixed_divide(
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
    matrix_from_quat(&fuse->level_from_inertial, &level_from_inertial);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        struct vector rate;
        struct vector *sum = &fuse->turn_sum_q15[axis];
        matrix_turn(&level_from_inertial, sum->axis, rate.axis);
        memset(sum, 0, sizeof *sum);
        for (uint8_t i = 0; i < 3; ++i) {
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
    quat_multiply(&fuse->level_from_inertial, &fuse->inertial_from_body, &attitude);
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
        struct fuse_tilt *tilt = &fuse->tilt[i];
        lowpass_short_step(&tilt->regressor, row[i], fuse->frames);
        lowpass_axis_step(&tilt->taken_off.level, &tilt->taken_off.band,
                          &fuse_level_gain, fuse->frames, effect(fuse, row[i]));
    }
    memcpy(fuse->up, row[2], sizeof fuse->up);
    to_units(fuse->up);
}

void fuse_read_motion(struct fuse *fuse, const q2_14_t row[], int32_t noise,
                      q7_25_t surprise) {
    q2_30_t gain[FUSE_MOTION_STATES];
    kalman_read(fuse->motion_covariance, FUSE_MOTION_STATES, row, noise, gain);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fixed_add_clamped(fixed_scale_down(fixed_mul_q30(gain[axis], surprise), 2),
                          BIAS_LIMIT_Q25, &fuse->bias_rad_s_q25.axis[axis]);
        const int32_t step = fixed_mul_q30(gain[SCALE + axis], surprise);
        fixed_add_clamped(fixed_mul_q30(step, SCALE_GAIN_Q30) * 2, SCALE_LIMIT_Q30,
                          &fuse->scale[axis]);
    }
}

// (rad/s)^2 as q2_30, of what levelling goes on to correct about an axis.
NOINLINE static q2_30_t square_of(int16_t drift_q18) {
    return fixed_scale_down((int32_t)drift_q18 * drift_q18, 6);
}

void fuse_stage_rest(struct fuse *fuse) {
    q2_14_t row[FUSE_MOTION_STATES] = {0};
    const uint8_t axis = fuse->next_axis;
    if (!fuse_is_at_rest(fuse)) {
        return;
    }
    const int32_t surprise =
        fuse->rest_rate.level.axis[axis] - fuse->bias_rad_s_q25.axis[axis];
    // A slow turn looks like a rest: the farther the rate, the less it tells.
    const int32_t off = fixed_scale_up(fixed_clamp(surprise, REST_DOUBT_Q25), 7);
    row[axis] = FUSE_Q2_14_ONE;
    fuse_read_motion(
        fuse, row, REST_NOISE + fixed_times(fixed_square_q30(off), 5),
        fixed_scale_up(fixed_clamp_high(surprise, FIXED_HIGH(REST_SURPRISE_Q25)), 2));
    fuse_next_axis(fuse);
}

// The surprise of levelling is that of an error that has always been there: what the
// estimates took off each correction is taken back, and what those of now would have
// taken off is not a surprise. The axes take turns.
void fuse_stage_motion(struct fuse *fuse) {
    const uint8_t axis = fuse->frames % 2;
    const struct fuse_tilt *tilt = &fuse->tilt[axis];
    int16_t *drift = &fuse->drift_q18[axis];
    q2_14_t row[FUSE_MOTION_STATES];
    if (fuse->frames <= FUSE_LEVEL_SETTLE || fuse->unsettled > 0) {
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
        fixed_add(fixed_divide(square - fuse->drift_square, DRIFT_SQUARE_LOOKS),
                  &fuse->drift_square);
    }
    if (!fuse_is_at_rest(fuse)) {
        memcpy(row, tilt->regressor.level, sizeof tilt->regressor.level);
        to_units(row);
        row[HEADING] = 0;
        fuse_read_motion(fuse, row,
                         MOTION_NOISE + fixed_times(fixed_clamp(fuse->drift_square,
                                                                MOTION_DRIFT_MAX_Q30),
                                                    MOTION_DRIFT),
                         surprise);
    }
}
