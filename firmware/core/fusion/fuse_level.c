// SPDX-License-Identifier: MIT
// The vertical: the specific force, low-passed in the inertial frame, points up in the
// level frame.
#include <string.h>

#include "core/fusion/fuse_stages.h"

// 477 m/s2 as q13, more than the range's corner: 256 times as much is low-passed.
#define FORCE_LIMIT_Q13 (LOWPASS_INPUT_MAX / 256)
#define FORCE_MIN_Q21 Q21(FUSE_FORCE_MIN_M_S2)
// Upper halves of q11_21: 32nds of 1 m/s2.
#define GRAVITY_MIN ROUNDED(FUSE_GRAVITY_MIN_M_S2 * 32)
#define GRAVITY_RANGE ROUNDED((FUSE_GRAVITY_MAX_M_S2 - FUSE_GRAVITY_MIN_M_S2) * 32)
// The squared sigma of two axes in 1e-4 m/s2 as rad2 q2_30.
#define LEVEL_GAIN_Q32                                                                 \
    Q32_UNSIGNED(2 * (1e-4 / GRAVITY_M_S2) * (1e-4 / GRAVITY_M_S2) * 1073741824.0)
// A correction, rad a window as q2_30, to rad/s q7_25.
#define TILTING_GAIN_Q14 Q14(1 / FUSE_WINDOW_S / 32)

#define HIDDEN_DRIFT_Q30 Q_RAD2(SQUARE(FUSE_HIDDEN_DRIFT_DPS), 30)
#define HIDDEN_MOST_Q30 Q_RAD2(SQUARE(FUSE_HIDDEN_MOST_DPS), 30)

const IN_FLASH struct lowpass_gain fuse_level_gain =
    LOWPASS_GAIN(FUSE_WINDOW_S, FUSE_LEVEL_TAU_S);

// Turns the level frame so that the low-passed specific force points up. Leaves the
// correction about x and y in `tilt`.
static void follow_gravity(struct fuse *fuse) {
    struct quat *level = &fuse->state.level_from_inertial;
    struct vector up;
    fuse->state.tilt[0].corrected_rad_s = 0;
    fuse->state.tilt[1].corrected_rad_s = 0;
    up = fuse->state.force.level;
    if (fuse->state.windows > 0) {  // before the first levelling they are the same
        quat_rotate(level, &up, &up);
    }
    const int32_t norm = vector_normalise(&up);
    const bool is_gravity =  // where the difference is negative, it is more
        fuse->state.acc.count < FUSE_REPEATS_FORCE &&
        (uint16_t)(fixed_high_half((uint32_t)norm) - GRAVITY_MIN) <= GRAVITY_RANGE;
    fuse->state.doubts = (uint8_t)(is_gravity ? fuse->state.doubts & ~FUSE_FORCE
                                              : fuse->state.doubts | FUSE_FORCE);
    if (norm < FORCE_MIN_Q21) {
        return;
    }
    fuse->state.tilt[0].corrected_rad_s = fixed_mul_q14(up.y, TILTING_GAIN_Q14);
    fuse->state.tilt[1].corrected_rad_s = -fixed_mul_q14(up.x, TILTING_GAIN_Q14);
    // The shortest turn that takes `up` to z is (1 + z, y, -x, 0), normalised; from
    // straight down it is half a turn about x.
    union {
        struct quat turn;
        struct vector part;  // all but the last
    } shortest = {{Q2_30_ONE / 2 + fixed_half_floor(up.z), fixed_half_floor(up.y),
                   -fixed_half_floor(up.x), 0}};
    if (vector_normalise(&shortest.part) == 0) {
        shortest.turn.x = Q2_30_ONE;
    }
    quat_multiply(&shortest.turn, level, level);
    quat_renormalise(level);
}

void fuse_take_first(struct fuse *fuse, const struct vector *force_body) {
    fuse->state.force.level = *force_body;
}

void fuse_level_first(struct fuse *fuse) {
    follow_gravity(fuse);
    fuse->state.world_from_inertial = fuse->state.level_from_inertial;
}

q2_30_t fuse_level_variance_of(uint16_t sigma) {
    return (q2_30_t)fixed_umul_q32((uint32_t)sigma * sigma, LEVEL_GAIN_Q32);
}

q2_30_t fuse_level_variance(const struct fuse *fuse) {
    return fuse->settings.level_variance +
           fuse_level_variance_of((uint16_t)(fuse->state.warmth * fuse->drift));
}

// Orientation lost: keep it as the initial guess, and level again.
static void lose_orientation(struct fuse *fuse) {
    memset(&fuse->state.force, 0, sizeof fuse->state.force);
    memset(fuse->state.tilt, 0, sizeof fuse->state.tilt);
    fuse->state.windows = 0;
    fuse_forget_place(fuse);
}

void fuse_stage_level(struct fuse *fuse) {
    struct vector force;
    if (fuse->state.clipped >= FUSE_CLIPPED_LOST ||
        fuse->state.windows == FUSE_WINDOWS_LOST) {
        lose_orientation(fuse);
    }
    fuse->state.clipped = 0;
    if (fuse->state.unsettled > 0) {
        --fuse->state.unsettled;
    }
    fuse->state.windows =
        (uint8_t)(fuse->state.windows < UINT8_MAX - 1 ? fuse->state.windows + 1
                                                      : UINT8_MAX - 2);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        int32_t *const sum = &fuse->state.force_sum_q13.axis[axis];
        const int32_t mean = fixed_mul_at(sum, &fuse->coefficients.share);
        force.axis[axis] = fixed_clamp(mean, FORCE_LIMIT_Q13) * 256;
        *sum = 0;
    }
    if (fuse->state.windows > FUSE_LEVEL_SETTLE && fuse_is_force_hidden(fuse)) {
        fuse->state.tilt[0].corrected_rad_s = 0;
        fuse->state.tilt[1].corrected_rad_s = 0;
        fixed_add_clamped(HIDDEN_DRIFT_Q30, HIDDEN_MOST_Q30, &fuse->state.drift_square);
        if (fuse->state.drift_square == HIDDEN_MOST_Q30) {
            fuse->state.doubts |= FUSE_FORCE;
        }
        return;
    }
    lowpass_step(&fuse->state.force, &fuse_level_gain, &force, fuse->state.windows);
    follow_gravity(fuse);
}
