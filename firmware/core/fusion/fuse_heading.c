// SPDX-License-Identifier: MIT
// Heading from the field of the place, and the stated error of it.
#include "core/fusion/fuse_stages.h"

#define HEADING_LEANING_TWICE ROUNDED(2 * SQUARE(FUSE_HEADING_DRIFT_S))
#define COVARIANCE_SHARE_Q30 Q30(FUSE_COVARIANCE_SHARE)
#define WORST_Q8 ROUNDED(FUSE_HEADING_WORST * 256)
#define ACROSS_HALF_Q14 Q14(FUSE_HEADING_ACROSS / 2)
#define ASTRAY_Q3 ROUNDED(FUSE_HEADING_ASTRAY_UT2 * 8)  // 65536ths to q13_19
#define UNCALIBRATED_VARIANCE Q19(SQUARE(FUSE_UNCALIBRATED_SIGMA_UT))
#define HORIZONTAL_MIN_Q18 Q18(FUSE_HORIZONTAL_MIN_UT)
// Half of what a heading error of 4 degrees changes, from q14_18 to q2_14.
#define TURNED_BY_Q30 Q_RAD(FUSE_HEADING_UNIT_DEG / 2.0 / 16, 30)
#define TURNED_BY_FIELD_Q18 Q18(FUSE_TURNING_FIELD_MAX_UT)

// One copy, whose numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

// The heading's variance, rad2, from that of the field. `north` is the horizontal unit
// vector of the field in the level frame, `norm` the length of the horizontal field,
// uT.
NOINLINE static q2_30_t heading_variance_of(const struct fuse *fuse,
                                            const struct vector *north, q14_18_t norm) {
    const int32_t *covariance = fuse->state.field_covariance;
    // Of two states the covariance has its rows at 0 and at 1; z of `north` is 0.
    struct vector shared = {0};
    for (uint8_t axis = 0; axis < 2; ++axis) {
        shared.axis[axis] =
            vector_dot((const struct vector *)(covariance + axis), north);
    }
    int32_t along = vector_dot(&shared, north);
    const int32_t across = covariance[0] + covariance[2] - along;
    int32_t total_q19 = across;
    if (fuse_is_own_unknown(fuse)) {
        total_q19 += UNCALIBRATED_VARIANCE;
    } else {
        along = fixed_mul_q30(along, COVARIANCE_SHARE_Q30);
        total_q19 = fixed_mul_q30(across, COVARIANCE_SHARE_Q30);
    }
    // The field may be shorter, by what is not known along it.
    norm -= fixed_times(fixed_sqrt((uint32_t)(along > 0 ? 2 * along : 0)), WORST_Q8);
    if (norm < HORIZONTAL_MIN_Q18) {
        return FUSE_HEADING_VARIANCE_MAX_Q30;
    }
    fixed_add(fixed_times(fuse_leaning(fuse, fuse->state.drift_square),
                          HEADING_LEANING_TWICE),
              &total_q19);
    const q2_30_t level = fuse->settings.level_variance;
    fixed_add(2 * fuse_leaning(fuse, fuse_level_variance(fuse) - level +
                                         fixed_divide(level, FUSE_LEVEL_SHARE)),
              &total_q19);
    const int32_t mean_square =  // 2^20ths of 1 uT2
        (int32_t)fuse->state.across_mean * fuse->state.across_mean;
    fixed_add(fixed_mul_q14(mean_square, ACROSS_HALF_Q14), &total_q19);
    fixed_add(fixed_times(fuse->state.field_astray, ASTRAY_Q3), &total_q19);
    // Divided by the field twice; 64ths keep the first quotient in range.
    const uint32_t total_q12 =
        (uint32_t)fixed_divide(total_q19 > 0 ? total_q19 : 0, 128);
    if (total_q12 >= (uint32_t)norm) {
        return FUSE_HEADING_VARIANCE_MAX_Q30;
    }
    const uint32_t once =
        (uint32_t)fixed_scale_down(fixed_ratio(total_q12, (uint32_t)norm), 6);
    return once < (uint32_t)norm ? fixed_ratio(once, (uint32_t)norm)
                                 : FUSE_HEADING_VARIANCE_MAX_Q30;
}

void fuse_stage_world(struct fuse *fuse) {
    struct vector north = {
        .x = fuse->state.field_ut[0], .y = fuse->state.field_ut[1], .z = 0};
    struct quat turn;
    const int32_t norm = vector_normalise(&north);
    quat_set_identity(&turn);
    if (fuse->state.field_learnt > 0 && norm > 0) {
        // The angle that brings the horizontal field to north, y.
        quat_about_z(north.y, north.x, &turn);
        if (norm < HORIZONTAL_MIN_Q18) {
            // The field is vertical and gives no heading: learn it again.
            fuse_forget_place(fuse);
        } else if (fuse->state.field_age == 0) {
            fuse->state.heading_variance = heading_variance_of(fuse, &north, norm);
            fuse_doubt_place(fuse, norm);
        }
        // An error of the heading, which is behind by it, turns the field against it.
        fuse->state.across[0] = (q2_14_t)-fixed_scale_down(north.y, 16);
        fuse->state.across[1] = (q2_14_t)fixed_scale_down(north.x, 16);
        fuse->state.turned_by = (q2_14_t)-fixed_mul_q30(
            fixed_clamp_high(norm, FIXED_HIGH(TURNED_BY_FIELD_Q18)), TURNED_BY_Q30);
    }
    fuse->state.has_reading = false;
    if (fuse->state.windows == 1 && fuse_is_at_rest(fuse)) {
        fuse->state.windows =
            FUSE_LEVEL_SETTLE;  // what comes next is no better than this
    }
    quat_multiply(&turn, &fuse->state.level_from_inertial,
                  &fuse->state.world_from_inertial);
    quat_renormalise(&fuse->state.world_from_inertial);
}
