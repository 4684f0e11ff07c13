// SPDX-License-Identifier: MIT
// The filter: measurements in, orientation and its quality out, one step a sample.
//
// A filter of the VQF family (Laidig and Seel 2023, section 3): the gyroscope is
// integrated into an almost-inertial frame, the specific force is low-passed there and
// levels it, and heading is a separate angle, so that a disturbed field never tilts
// the probe. There are two small Kalman filters as well: one learns the gyroscope's
// bias and three scales from what levelling had to correct and from how the field
// turns, one the field of the place and the probe's own, which turns with it; and how
// late field readings are is learned from turns. Samples make windows of 100 ms; all
// but the integration is done once a window, in stages that no two samples share.
#ifndef FUSE_H
#define FUSE_H

#include "core/fusion/calibrate.h"
#include "core/fusion/kalman.h"
#include "core/fusion/lowpass.h"
#include "core/fusion/quality.h"
#include "core/math/matrix.h"
#include "core/math/quat.h"

enum {
    FUSE_FIELD_STATES = 6,
    FUSE_FIELD_PAIRS = FUSE_FIELD_STATES * (FUSE_FIELD_STATES + 1) / 2,
    FUSE_MOTION_STATES = 7,
    FUSE_TURNS = 6,  // states that turn the probe: bias and scales
    FUSE_MOTION_PAIRS = FUSE_MOTION_STATES * (FUSE_MOTION_STATES + 1) / 2,
};

// Derived from the sample rate, once.
struct fuse_coefficients {
    uint8_t window;           // samples in a window
    uint8_t stride;           // samples between two stages of it
    uint8_t middle;           // of the samples whose readings stage 1 takes
    q2_30_t share;            // 1 / window
    int32_t half_lead_s_q35;  // of the motion before what was integrated
};

// The probe's own field that its calibration left, in steps of 0.25 uT.
struct own_field {
    int16_t axis[3];
    uint16_t sigma;  // of an axis, at most OWN_FIELD_SIGMA_MAX; 0: it is not known
};
enum { OWN_FIELD_SIGMA_MAX = 40 };  // 10 uT

// What tilts the level frame about x or y.
struct fuse_tilt {
    // What a bias and scales of the gyroscope would turn the vertical by: a row of the
    // rotation to the level frame, and rates in 500 deg/s.
    struct lowpass_short regressor;
    struct lowpass_axis taken_off;  // by the estimates, from what levelling corrects
    q7_25_t corrected_rad_s;        // what levelling had to correct, as a rate
};

// How good the calibration in force is.
struct fuse_settings {
    int16_t own_variance;    // 16ths of 1 uT2, of the probe's own field before readings
    q2_30_t level_variance;  // rad2, of the level by the accelerometer's own error
    // The field in which it was calibrated, to the north and up, 0.25 uT; 0: not known.
    int16_t known_north, known_up;
};

// Whether a sensor gives the same measurement again and again.
struct fuse_repeats {
    uint8_t sum;    // of its axes
    uint8_t count;  // in a row, held at 255
};

// State that changes with every sample. The smaller and the busier a member, the
// further up: the AVR reaches the first 64 bytes of a struct in one instruction.
struct fuse_state {
    int32_t lag_s_q35;  // how far field readings are behind the gyroscope
    uint16_t warming;  // 32nds of a step: by how much a bias that warms up wanders more
    // A restart forgets all from here to bias_rad_s_q25.
    uint8_t in_window, stage;  // of the window that runs
    uint8_t in_stride;         // samples since one that was for a stage
    uint8_t windows;           // since the start, at most 254; 255: begin again
    uint8_t clipped;           // samples of this window that lost motion
    uint8_t unsettled;         // windows until levelling tells of bias again
    uint8_t rest_looks;        // in a row that saw no motion
    uint8_t settled_looks;     // up to one more than the low-pass takes to settle
    uint8_t next_axis;         // whose bias or own field is read next
    uint8_t field_age;         // windows since the last reading, held at 255
    uint8_t field_learnt;      // readings whose mean is the place's field
    uint8_t field_count;       // readings in field_sum
    uint8_t doubts;            // enum fuse_doubt of force and place
    uint8_t field_plain;       // readings in a row that are not doubtful where it is
    bool is_own_unknown;       // the place was, so that the own field may be anything
    uint8_t warmth;            // 1.28 K from the accelerometer's calibration
    struct fuse_repeats acc, mag;  // of accelerations, every look at rest
    bool has_reading;
    bool is_turned;            // the last one surprised by its direction only
    uint16_t field_surprise;   // squared, mean, 64ths of 1 uT2
    uint16_t field_astray;     // share of late readings that surprise, 65536ths
    q13_19_t field_noise;      // of this reading, uT2
    q2_30_t heading_variance;  // rad2; 1: no field has told the heading yet
    q2_30_t drift_square;      // (rad/s)^2, of what levelling keeps correcting
    // 1024ths of 1 uT, across the field and along it: how readings keep surprising.
    int16_t across_mean, along_mean;
    int32_t drifting;  // 2^20ths of 1 uT2: by how much the square across is more
    // Half of what a heading error of 4 degrees changes across the horizontal field,
    // uT, and the unit vector there.
    q2_14_t turned_by, across[2];
    uint16_t turned_q17;   // (4 deg)^2: growth of the heading's variance in this window
    int16_t drift_q18[2];  // rad/s, what levelling keeps correcting about x and y
    q2_14_t up[FUSE_TURNS];  // by how much each state turns it about the vertical
    // Sums over the window in the inertial frame, m/s2 and rad/s; of the rate, one for
    // each axis of the body.
    struct vector force_sum_q13, turn_sum_q15[3];
    struct vector field_sum_q11;      // uT, of its readings
    struct vector rate_rad_s_q25;     // of the last sample, without bias and scale
    struct quat inertial_from_body;   // integrated gyroscope
    struct quat level_from_inertial;  // the correction of its tilt
    struct quat world_from_inertial;  // and of its heading
    struct lowpass force;             // inertial frame
    struct fuse_tilt tilt[2];         // about x and y
    struct lowpass rest_rate, rest_force;
    struct quat middle_attitude;  // inertial from body
    // The mean of a window's field readings, in the inertial frame until stage 2, then
    // in the level frame, as the mean rate is.
    struct vector reading_ut_q18;
    struct vector reading_rad_s_q25;
    struct matrix level_from_body;
    q13_19_t field_covariance[FUSE_FIELD_PAIRS];  // uT2
    // Bias of the rates that were measured, and the covariance of the bias in 4ths of
    // 1 deg/s, of the scales in 500ths and of the heading's error in 4 deg.
    struct vector bias_rad_s_q25;
    q2_30_t scale[3];                    // of the rates that were measured, less 1
    struct vector calibrated_rad_s_q25;  // the bias that the start-up calibration found
    q11_21_t motion_covariance[FUSE_MOTION_PAIRS];
    q13_19_t lag_variance;  // half of that of the lag in ms2
    // The field of the place in the level frame, then that of the probe in the body.
    union {
        q14_18_t field_ut[FUSE_FIELD_STATES];
        struct {
            struct vector place_ut_q18, own_ut_q18;
        };
    };
};

struct fuse {
    struct fuse_coefficients coefficients;
    struct fuse_settings settings;
    struct fuse_state state;
    // A setting, too, which is seldom needed: what 1.28 K from its calibration add to
    // the accelerometer's sigma, 1e-4 m/s2.
    uint8_t drift;
};

// For 100 to 800 samples a second, of a gyroscope whose rates come `gyr_delay_us` (at
// most 7.5 ms) behind the motion.
void fuse_init(struct fuse *fuse, uint16_t rate_hz, uint16_t gyr_delay_us);

// A calibration comes into force, which tells how good it is; before the first sample,
// or later if the axes stay the same. Without it the own field is known to 0.8 uT,
// gravity well, scales of the gyroscope to 1 %. The own field that was found is that of
// the calibration before, and is taken for part of this one.
void fuse_set_accuracy(struct fuse *fuse, const struct calibration *calibration);

// How far the field's readings are behind the rates, us, as far as the sensor's data
// sheet says; at most 15 ms. Without it 5 ms. Turning the probe tells better.
void fuse_set_mag_lag(struct fuse *fuse, uint16_t lag_us);

// Begins with what an earlier run found as the probe's own field, where that is better
// than the calibration; after fuse_set_accuracy().
void fuse_use_own(struct fuse *fuse, const struct own_field *own);

// Orientation lost: forgets it, but keeps the bias and the reference field.
void fuse_restart(struct fuse *fuse);

// One sample, `interval_us` after the one before it. Longer intervals than 60 ms are
// integrated for 60 ms only: the rest of the motion is lost. Where that or clipping
// loses more than a little, the filter finds level and heading again, as after a start.
void fuse_step(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us);

// The same in two: a measurement is on the stack only until it is taken, not while a
// stage of the window works.
void fuse_take(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us);
void fuse_work(struct fuse *fuse);

// A calibration at rest has found the gyroscope's bias, which from there on is taken
// for rest within 2 deg/s of it. Before, the bias is found in rests and from motion.
// Each axis is held within +-3.4 rad/s, ten times what the calibration takes for a
// bias.
void fuse_set_bias(struct fuse *fuse, const struct vector *bias_rad_s_q25);

// It is known to move: a slow stroke may look like a rest, whose mean rate would be
// taken for bias. Holds for 1.5 s.
void fuse_deny_rest(struct fuse *fuse);

// By how much the mean force has changed in the inertial frame, m/s2 q15, from a rest
// to another one `windows` of 100 ms later, which the bias explains. `noise_q30`:
// variance of an axis of it, (m/s2)^2. `axis`: of the level frame, 0 or 1; each tells
// once.
void fuse_learn_drift(struct fuse *fuse, uint8_t axis, const struct vector *delta_q15,
                      uint32_t noise_q30, uint8_t windows);

// Unit quaternion, world_from_body, at the time of the last sample; world is east,
// north, up.
void fuse_orientation(const struct fuse *fuse, struct quat *out);

// The probe's own field as it is known now, to begin with it later. False where the
// filter does not know it to 2 uT an axis, or a calibration tells it better.
bool fuse_read_own(const struct fuse *fuse, struct own_field *out);

void fuse_quality(const struct fuse *fuse, struct attitude_quality *out);

#endif
