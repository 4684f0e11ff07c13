// SPDX-License-Identifier: MIT
// The stages of a window of fuse.c, and what its files share. Private to the filter.
//
//   fuse.c        integration, the order of the stages, orientation and quality
//   fuse_level.c  the vertical, from the specific force
//   fuse_gyro.c   rest, and the gyroscope's bias and scales
//   fuse_field.c  the magnetic field of the place and of the probe
//   fuse_heading.c  heading from it, and the stated error
//   fuse_doubt.c  what can't be: fields, forces, sensors that are dead
//   fuse_own.c    the probe's own field from one run to the next
//
// Frames of reference: body; inertial, which drifts with the gyroscope; level, with z
// up and the heading of the inertial frame; world: east, north, up.
#ifndef FUSE_STAGES_H
#define FUSE_STAGES_H

#include "core/fusion/fuse.h"
#include "core/fusion/fuse_params.h"
#include "core/math/constant.h"

enum {
    FUSE_LEVEL_SETTLE = FUSE_WINDOWS(FUSE_LEVEL_TAU_S),
    FUSE_WINDOWS_LOST = UINT8_MAX,  // level and heading have to be found again
    FUSE_REST_LOOKS = FUSE_LOOKS(FUSE_REST_S),
    FUSE_FIELD_LEARN = FUSE_WINDOWS(FUSE_LEARN_S),  // a reading each
    // Squared distances as 64ths of 1 uT2, shares as 65536ths.
    FUSE_FIELD_UNIT = ROUNDED(FUSE_SURPRISE_UT * FUSE_SURPRISE_UT * 64),
    FUSE_FIELD_ASTRAY = Q16(FUSE_ASTRAY_SHARE) - 1,  // the AVR's int ends at 32767
    FUSE_Q2_14_ONE = 16384,
    FUSE_UNSETTLED = FUSE_WINDOWS(FUSE_UNSETTLED_S),
    // Of the own field, 16ths of 1 uT2: above it, it was not calibrated.
    FUSE_OWN_CALIBRATED = ROUNDED(16 * SQUARE(FUSE_OWN_CALIBRATED_SIGMA_UT)),
};

// The units of motion_covariance: bias in 4ths of 1 deg/s, scales in 500ths, that is in
// deg/s at 500 deg/s, the heading's error in 4 deg.
#define FUSE_BIAS_UNITS 4
#define FUSE_RATE_UNIT_DPS 500
#define FUSE_HEADING_UNIT_DEG 4

#define FUSE_HEADING_VARIANCE_MAX_Q30 Q2_30_ONE  // (57 deg)^2

// Why errors are withheld: the upper half of a pose's flags.
enum fuse_doubt {
    FUSE_IMPOSSIBLE = POSE_FIELD_IMPOSSIBLE / 256,
    FUSE_UNLIKE = POSE_FIELD_UNLIKE / 256,
    FUSE_FORCE = POSE_FORCE_IMPOSSIBLE / 256,
};

// The low-pass of the force, a step each window.
extern const IN_FLASH struct lowpass_gain fuse_level_gain;

static inline bool fuse_is_at_rest(const struct fuse *fuse) {
    return fuse->state.rest_looks == FUSE_REST_LOOKS;
}

// What clipped in this window, or in the one before it, hides the force.
static inline bool fuse_is_force_hidden(const struct fuse *fuse) {
    return fuse->state.unsettled >= FUSE_UNSETTLED - FUSE_HIDDEN_WINDOWS;
}

// Bias at rest and the probe's own field in motion are read by one axis a window.
static inline void fuse_next_axis(struct fuse *fuse) {
    fuse->state.next_axis =
        (uint8_t)(fuse->state.next_axis == 2 ? 0 : fuse->state.next_axis + 1);
}

// fuse_level.c

// The first sample is levelled at once. Force in the body frame, m/s2 q11_21.
void fuse_take_first(struct fuse *fuse, const struct vector *force_body);
void fuse_level_first(struct fuse *fuse);
// The variance of the level from the accelerometer's own error, rad2, at this
// temperature.
q2_30_t fuse_level_variance(const struct fuse *fuse);

// The same by a sigma of an axis, 1e-4 m/s2; at most 0.9.
q2_30_t fuse_level_variance_of(uint16_t sigma);
// Level from the mean force of the window.
void fuse_stage_level(struct fuse *fuse);

// fuse_gyro.c

// Bias and scales as unsure as a gyroscope's can be.
void fuse_init_gyro(struct fuse *fuse);
// How well scales are known: `sigma` of a calibration, 1e-5.
void fuse_set_scale_accuracy(struct fuse *fuse, uint16_t sigma);
// The heading refers to a newly learned field: its error is unknown.
void fuse_forget_turned(struct fuse *fuse);
// Rest: for 1.5 s rates and force have stayed near their short mean, and the mean rate
// near the calibrated bias.
void fuse_look_for_rest(struct fuse *fuse, const struct measurement *measurement);
// How errors of bias and scales would turn the level frame.
void fuse_stage_regressors(struct fuse *fuse);
// Adds their part to the uncertainty of the heading.
void fuse_stage_predict(struct fuse *fuse);
// At rest the mean rate is the bias, of one body axis a window.
void fuse_stage_rest(struct fuse *fuse);
// Learns bias and scales in motion from the corrections of levelling about x and y.
void fuse_stage_motion(struct fuse *fuse);
// Takes a reading of bias, scales and heading, whose states and units are those of
// motion_covariance; its surprise in its own unit times a degree, as q7_25.
void fuse_read_motion(struct fuse *fuse, const q2_14_t row[], int32_t noise,
                      q7_25_t surprise);

// fuse_doubt.c

// Learns the local field again; until then there is no heading.
void fuse_forget_place(struct fuse *fuse);
// How often in a row a sensor has given this measurement before.
uint8_t fuse_repeats(struct fuse_repeats *repeats, const struct vector *v);
// The field of the calibration.
void fuse_set_known_field(struct fuse *fuse, const struct calibration *calibration);
// Whether a doubtful local field must be learned again, since readings are plain.
bool fuse_is_plain_again(struct fuse *fuse);
// Whether and why the place, whose horizontal field is given, leaves no heading.
void fuse_doubt_place(struct fuse *fuse, q14_18_t horizontal_ut);

// fuse_field.c

// How late readings of the field are, before turns have told.
void fuse_init_lag(struct fuse *fuse);
// Nothing tells how large the probe's own field is.
bool fuse_is_own_unknown(const struct fuse *fuse);
// The heading's error is too large to be stated.
bool fuse_is_heading_free(const struct fuse *fuse);
// How well the probe's own field is known: `sigma` of a calibration, 0.01 uT.
void fuse_set_own_accuracy(struct fuse *fuse, uint16_t sigma);
// The mean of the readings since the last call is the reading of this window.
void fuse_stage_mean(struct fuse *fuse);
// Turns it to the level frame.
void fuse_stage_reading(struct fuse *fuse);
// Predicts the field, and weighs the reading. Without a reading, only predicts.
void fuse_stage_field(struct fuse *fuse);
// A reading across the horizontal field tells by how much errors of the gyroscope
// turned the heading.
void fuse_stage_turning(struct fuse *fuse);
// Learns from the reading how late readings are.
void fuse_follow_lag(struct fuse *fuse);
// Takes one axis of the reading into the field of the place and of the probe; axis 3:
// that the probe has none of its own, along one axis of the body, where it seems so.
void fuse_stage_field_axis(struct fuse *fuse, uint8_t axis);
// The square of the vertical field, seen through a level that leans by an angle whose
// square is given: uT2; of what levelling keeps correcting in a second, at most 28.
q14_18_t fuse_leaning(const struct fuse *fuse, q2_30_t square_rad);

// fuse_heading.c

// Level and heading as one rotation, which makes poses for the next window.
void fuse_stage_world(struct fuse *fuse);

#endif
