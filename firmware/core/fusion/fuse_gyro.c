// SPDX-License-Identifier: MIT
// Rest, and the gyroscope's bias and scale: one Kalman filter of four states, which a
// rest tells of the bias, and what levelling had to correct of both.
#include <string.h>

#include "core/fusion/fuse_stages.h"

enum {
    REST_SETTLE = 50,  // looks in VQF's mean of 0.5 s
};

#define REST_RATE_Q25 INT32_C(1171299)          // VQF's 2 deg/s
#define REST_FORCE_Q21 INT32_C(1048576)         // VQF's 0.5 m/s2
#define REST_RATE_LIMIT_Q25 INT32_C(335544320)  // 10 rad/s: keeps the low-pass in range
#define BIAS_LIMIT_Q25 INT32_C(114085069)       // 3.4 rad/s

// Variances of the bias in (deg/s)^2 and of the scale in 500ths squared, as q6_26.
#define BIAS_VARIANCE_MAX INT32_C(16777216)    // (0.5 deg/s)^2
#define BIAS_VARIANCE_FOUND INT32_C(6711)      // (0.01 deg/s)^2
#define SCALE_VARIANCE_MAX INT32_C(150994944)  // 0.3 %: (1.5 / 500)^2
#define MOTION_WANDER INT32_C(671)             // 1e-4 a second
#define MOTION_NOISE INT32_C(201326592)  // 0.3 (deg/s)^2 s of what levelling corrects
#define REST_NOISE INT32_C(60398)        // (0.03 deg/s)^2 of a mean at rest
#define TILTING_LIMIT_Q25 INT32_C(2928177)    // 5 deg/s
#define TURN_MEAN_LIMIT_Q17 INT32_C(2228224)  // 17 rad/s an axis: 29.4 in all
#define TURN_LIMIT_Q25 INT32_C(439226488)     // 1.5 * 500 deg/s
#define SCALE_LIMIT_Q30 INT32_C(21474836)     // 2 %
// rad/s q7_25 over 500 deg/s to q2_14: 2^-11 * 0.1145916.
#define TURN_GAIN_Q30 INT32_C(60079)
// Scale a rad/s of surprise, from q7_25 to q2_30: 57.29578 / 500 * 2^5, halved.
#define SCALE_GAIN_Q30 INT32_C(1968667994)

// Of VQF's rest filter, 0.5 s, at 100 looks a second.
static const IN_FLASH struct lowpass_gain rest_gain = {
    INT32_C(15186015), INT32_C(1052480291), REST_SETTLE};

// Covariance of a bias that is known this well, and of a scale known as before.
static void set_bias_variance(struct fuse *fuse, int32_t bias_variance) {
    int32_t *covariance = fuse->motion_covariance;
    const int32_t scale_variance = covariance[kalman_variance(3)];
    memset(covariance, 0, sizeof fuse->motion_covariance);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        covariance[kalman_variance(axis)] = bias_variance;
    }
    covariance[kalman_variance(3)] = scale_variance;
}

void fuse_init_gyro(struct fuse *fuse) {
    fuse->motion_covariance[kalman_variance(3)] = SCALE_VARIANCE_MAX;
    set_bias_variance(fuse, BIAS_VARIANCE_MAX);
}

void fuse_set_bias(struct fuse *fuse, const struct vector *bias_rad_s_q25) {
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &fuse->bias_rad_s_q25);
    fuse->calibrated_rad_s_q25 = fuse->bias_rad_s_q25;
    set_bias_variance(fuse, BIAS_VARIANCE_FOUND);
}

// True where |v - mean| is below the limit, which is at most 2^21.
static bool is_near(const struct vector *v, const struct lowpass *mean, int32_t limit) {
    struct vector away;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t off = v->axis[axis] - mean->axis[axis].level;
        if (fixed_magnitude(off) > (uint32_t)limit) {
            return false;
        }
        away.axis[axis] = off * 512;  // keeps the precision of the squares
    }
    const uint32_t bound = (uint32_t)limit * 512;
    return vector_square_q32(&away) < fixed_umul_q32(bound, bound);
}

void fuse_look_for_rest(struct fuse *fuse, const struct measurement *measurement) {
    struct vector rate;
    if (fuse->settled_looks <= REST_SETTLE) {
        ++fuse->settled_looks;
    }
    vector_clamp(&measurement->gyr_rad_s_q25, REST_RATE_LIMIT_Q25, &rate);
    lowpass_step(&fuse->rest_rate, &rest_gain, &rate, fuse->settled_looks);
    lowpass_step(&fuse->rest_force, &rest_gain, &measurement->acc_m_s2_q21,
                 fuse->settled_looks);
    const bool is_near_mean =
        is_near(&rate, &fuse->rest_rate, REST_RATE_Q25) &&
        is_near(&measurement->acc_m_s2_q21, &fuse->rest_force, REST_FORCE_Q21);
    lowpass_read(&fuse->rest_rate, &rate);
    vector_subtract(&rate, &fuse->calibrated_rad_s_q25, &rate);
    if (!is_near_mean || vector_exceeds(&rate, REST_RATE_Q25)) {
        fuse->rest_looks = 0;
    } else if (fuse->rest_looks < FUSE_REST_LOOKS) {
        ++fuse->rest_looks;
    }
}

// Two rows of the attitude (-1 to 1 as 2^29ths) for the bias, and the frame's mean rate
// for the scale.
void fuse_stage_regressors(struct fuse *fuse) {
    struct vector turn;
    struct quat attitude;
    struct matrix level_from_body;
    const uint32_t square = vector_square_q32(&fuse->rate_rad_s_q25);
    fixed_add(((int32_t)square - fuse->rate_square) / FUSE_LEVEL_SETTLE,
              &fuse->rate_square);
    fuse_take_mean(fuse, &fuse->turn_sum_q17, TURN_MEAN_LIMIT_Q17, &turn);
    quat_rotate(&fuse->level_from_inertial, &turn, &turn);
    quat_multiply(&fuse->level_from_inertial, &fuse->inertial_from_body, &attitude);
    matrix_from_quat(&attitude, &level_from_body);
    struct lowpass_axis *regressor = fuse->regressor;
    for (uint8_t row = 0; row < 2; ++row) {
        for (uint8_t axis = 0; axis < 3; ++axis) {
            lowpass_axis_step(regressor, &fuse_level_gain,
                              level_from_body.row[row][axis] * -INT32_C(32768),
                              fuse->frames);
            ++regressor;
        }
        lowpass_axis_step(regressor, &fuse_level_gain, turn.axis[row], fuse->frames);
        ++regressor;
    }
    int32_t *variance = fuse->motion_covariance;
    for (uint8_t state = 0; state < FUSE_MOTION_STATES; ++state) {
        fixed_add_clamped(MOTION_WANDER,
                          state < 3 ? BIAS_VARIANCE_MAX : SCALE_VARIANCE_MAX, variance);
        variance += state + 2;
    }
}

// Takes a reading of bias and scale whose surprise is `surprise_rad_s`.
static void read_motion(struct fuse *fuse, const q2_14_t row[], int32_t noise,
                        q7_25_t surprise_rad_s) {
    q2_30_t gain[KALMAN_STATES];
    kalman_read(fuse->motion_covariance, FUSE_MOTION_STATES, row, noise, gain);
    int32_t *bias = fuse->bias_rad_s_q25.axis;
    for (uint8_t i = 0; i < 3; ++i) {
        fixed_add_clamped(fixed_mul_q30(gain[i], surprise_rad_s), BIAS_LIMIT_Q25,
                          &bias[i]);
    }
    const int32_t scale_step =
        fixed_mul_q30(fixed_mul_q30(gain[3], surprise_rad_s), SCALE_GAIN_Q30) * 2;
    fixed_add_clamped(scale_step, SCALE_LIMIT_Q30, &fuse->scale);
}

void fuse_stage_rest(struct fuse *fuse) {
    q2_14_t row[KALMAN_STATES] = {0};
    const uint8_t axis = fuse->rest_axis;
    row[axis] = FUSE_Q2_14_ONE;
    read_motion(fuse, row, REST_NOISE,
                fuse->rest_rate.axis[axis].level - fuse->bias_rad_s_q25.axis[axis]);
    fuse->rest_axis = (uint8_t)(axis == 2 ? 0 : axis + 1);
}

void fuse_stage_motion(struct fuse *fuse, uint8_t axis) {
    const struct lowpass_axis *regressor = &fuse->regressor[axis * FUSE_MOTION_STATES];
    if (fuse->frames <= FUSE_LEVEL_SETTLE || fuse->unsettled > 0) {
        return;
    }
    q2_14_t row[KALMAN_STATES] = {0};
    for (uint8_t i = 0; i < 3; ++i) {
        row[i] = (q2_14_t)fixed_scale_down(regressor[i].level, 15);
    }
    row[3] = (q2_14_t)fixed_mul_q30(fixed_clamp(regressor[3].level, TURN_LIMIT_Q25),
                                    TURN_GAIN_Q30);
    read_motion(fuse, row, MOTION_NOISE,
                fixed_clamp(fuse->tilting_rad_s[axis], TILTING_LIMIT_Q25));
}
