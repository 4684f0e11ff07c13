// SPDX-License-Identifier: MIT
// What strokes hear of the filter: its windows.
#include <string.h>

#include "core/fusion/fuse_stages.h"
#include "core/fusion/stroke.h"

bool stroke_listen(struct stroke_sums *sums, const struct fuse *fuse,
                   struct stroke_window *out) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    // A step of a mean velocity's 1e-5 m/s is enough.
    for (uint8_t row = 0; row < 3; ++row) {
        fixed_add(fixed_byte_floor(fuse->force_sum_q13.axis[row]),
                  &sums->force_q5.axis[row]);
    }
    if (fuse->in_frame != 0) {
        return false;
    }
    for (uint8_t row = 0; row < 3; ++row) {
        // At most 480 m/s2 and 80 samples, so that each of these is below 2^31.
        const int32_t mean =
            fixed_mul_q30(fuse->force_sum_q13.axis[row] * 4, coefficients->share);
        const int32_t sum =
            fixed_mul_q30(sums->force_q5.axis[row] * 16, coefficients->share);
        // Sums include the sample that they end with, of which half is too much.
        const int32_t twice = sum * 64 - mean / 2;
        out->force.mean_q15.axis[row] = mean;
        out->force.gained_q15.axis[row] = fixed_mul_q30(twice, coefficients->share) * 2;
        int32_t turn = 0;
        for (uint8_t axis = 0; axis < 3; ++axis) {
            turn += fuse->turn_sum_q15[axis].axis[row];
        }
        out->turn_q15.axis[row] = fixed_mul_q30(turn, coefficients->share);
    }
    const int32_t *covariance = fuse->motion_covariance;
    out->bias_variance =
        (covariance[kalman_variance(0)] + covariance[kalman_variance(1)] +
         covariance[kalman_variance(2)]) /
        3;
    memset(sums, 0, sizeof *sums);
    out->is_settled = fuse->frames >= FUSE_LEVEL_SETTLE;
    out->inertial_from_body = &fuse->inertial_from_body;
    out->world_from_inertial = &fuse->world_from_inertial;
    return true;
}
