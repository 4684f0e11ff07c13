// SPDX-License-Identifier: MIT
// Passes the filter's windows to strokes.
#include <string.h>

#include "core/fusion/fuse_stages.h"
#include "core/fusion/stroke.h"

#define DRIFT_MAX_Q15 Q15(FUSE_STROKE_DRIFT_MAX_M_S2)
#define DRIFT_NOISE_MAX ((uint32_t)Q30(FUSE_STROKE_NOISE_MAX_M2_S4))
#define WINDOW_TURNS (GRAVITY_M_S2 * FUSE_WINDOW_S)  // m/s2 a rad/s of bias
// (m/s2)^2 q2_30 of one window as the variance of a bias in 4ths of 1 deg/s, q11_21.
#define DRIFT_NOISE                                                                    \
    ((uint32_t)Q_DEG2(SQUARE(1.0 * FUSE_BIAS_UNITS) / 512 / (SQUARE(WINDOW_TURNS)), 0))
// m/s2 q15 of one window as a bias, rad/s q7_25, four times.
#define DRIFT_TURN ROUNDED(FUSE_BIAS_UNITS * 1024 / WINDOW_TURNS)

void fuse_deny_rest(struct fuse *fuse) {
    fuse->state.rest_looks = 0;
}

// A bias of b turns the vertical by b T in the time T: delta is b T x g.
void fuse_learn_drift(struct fuse *fuse, uint8_t axis, const struct vector *delta_q15,
                      uint32_t noise_q30, uint8_t windows) {
    struct quat attitude;
    struct matrix level_from_body;
    struct vector delta;
    const uint32_t square = (uint32_t)windows * windows;
    quat_rotate(&fuse->state.level_from_inertial, delta_q15, &delta);
    quat_multiply(&fuse->state.level_from_inertial, &fuse->state.inertial_from_body,
                  &attitude);
    matrix_from_quat(&attitude, &level_from_body);
    const uint32_t noise = noise_q30 > DRIFT_NOISE_MAX ? DRIFT_NOISE_MAX : noise_q30;
    const int32_t variance = (int32_t)(noise * DRIFT_NOISE / square) + 1;
    q2_14_t row[FUSE_MOTION_STATES] = {0};
    memcpy(row, level_from_body.row[axis], sizeof level_from_body.row[axis]);
    const int32_t force = axis == 0 ? -delta.y : delta.x;
    fuse_read_motion(fuse, row, variance,
                     fixed_clamp(force, DRIFT_MAX_Q15) * DRIFT_TURN / windows);
}

bool stroke_listen(struct stroke_sums *sums, const struct fuse *fuse,
                   struct stroke_window *out) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    // A step of a mean velocity's 1e-5 m/s is enough.
    for (uint8_t row = 0; row < 3; ++row) {
        fixed_add(fixed_byte_floor(fuse->state.force_sum_q13.axis[row]),
                  &sums->force_q5.axis[row]);
    }
    if (fuse->state.in_window != 0) {
        return false;
    }
    for (uint8_t row = 0; row < 3; ++row) {
        // At most 480 m/s2 and 80 samples, so that each of these is below 2^31.
        const int32_t mean =
            fixed_mul_q30(fuse->state.force_sum_q13.axis[row] * 4, coefficients->share);
        const int32_t sum =
            fixed_mul_q30(sums->force_q5.axis[row] * 16, coefficients->share);
        // Sums include the sample that they end with, of which half is too much.
        const int32_t twice = sum * 64 - mean / 2;
        out->force.mean_q15.axis[row] = mean;
        out->force.gained_q15.axis[row] = fixed_mul_q30(twice, coefficients->share) * 2;
        int32_t turn = 0;
        for (uint8_t axis = 0; axis < 3; ++axis) {
            turn += fuse->state.turn_sum_q15[axis].axis[row];
        }
        out->turn_q15.axis[row] = fixed_mul_q30(turn, coefficients->share);
    }
    const int32_t *covariance = fuse->state.motion_covariance;
    out->bias_variance =
        (covariance[kalman_variance(0)] + covariance[kalman_variance(1)] +
         covariance[kalman_variance(2)]) /
        3;
    memset(sums, 0, sizeof *sums);
    out->is_settled = fuse->state.windows >= FUSE_LEVEL_SETTLE;
    return true;
}
