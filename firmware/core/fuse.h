// SPDX-License-Identifier: MIT
// The filter: measurements in, orientation and its quality out, one step a sample.
//
// Of the VQF family (Laidig and Seel 2023, section 3): the gyroscope is integrated into
// an almost-inertial frame, the specific force is low-passed there and levels it, and
// heading is one angle beside it, so that a disturbed field never tilts the probe.
// The field's norm and vertical part at the start are the reference; the further a
// reading is from it the less it weighs.
#ifndef FUSE_H
#define FUSE_H

#include "calibrate.h"
#include "quat.h"

// Second-order Butterworth low-pass of a vector as two trapezoidal integrators, which
// needs no more precision than its input has. Mean of its input until tau has passed.
struct lowpass {
    struct vector band, level;
};

struct lowpass_gain {
    q2_30_t integrator;  // tan(T / (sqrt(2) tau))
    q2_30_t feedback;    // 1 / (1 + g (g + sqrt(2)))
    uint16_t settle;     // samples in tau
};

// Derived from the sample rate, once.
struct fuse_coefficients {
    uint16_t rate_hz;
    struct lowpass_gain level;  // of the specific force, almost-inertial frame
    struct lowpass_gain rest;   // of rates and force, body frame
    struct lowpass_gain field;  // of the field's norm and vertical part
    q2_30_t rate_square_gain;   // of the mean square of the rate
    q12_20_t bias_forgetting;   // of the rest bias' variance, a sample
    uint16_t rest_needed;       // still looks, one every other sample, for a rest
    uint16_t field_lag;         // of a field reading, 256ths of a sample
    int32_t lead_s_q35;         // of the motion before what was integrated
    uint8_t history_stride;     // samples between the orientations remembered
};

enum { FUSE_HISTORY = 4 };

struct fuse {
    struct fuse_coefficients coefficients;
    struct quat inertial_from_body;     // integrated gyroscope
    struct quat level_from_inertial;    // the correction of its tilt
    struct quat level_from_body;        // their product
    struct quat history[FUSE_HISTORY];  // it and earlier ones, latest first
    uint8_t history_phase;              // samples since the latest of them
    struct lowpass force;               // inertial frame
    struct lowpass rest_rate, rest_force;
    struct vector bias_rad_s_q25;
    struct vector calibrated_rad_s_q25;  // the bias that the start-up calibration found
    struct vector rate_rad_s_q25;        // of the last sample, bias removed
    q12_20_t bias_variance;              // over that of one reading at rest
    uint16_t rest_samples;               // looks in a row that saw no motion
    uint16_t rest_looks;  // up to one more than the low-pass takes to settle
    bool is_rest_due, is_level_due, has_waited;
    struct lowpass field;            // x: its norm, y: its vertical part
    struct vector reference_ut_q18;  // the same, undisturbed
    uint16_t field_samples;          // up to the length of the reference's mean
    turn32_t heading;          // of the almost-inertial frame's y axis, from north
    q2_30_t heading_variance;  // rad2; 1: no field has told the heading yet
    q2_30_t field_weight;      // of the last reading
    uint32_t field_age_us;     // since the last reading
    q14_18_t rate_square;      // (rad/s)^2, mean over 3 s
    uint16_t samples;          // since the start, held where it no longer matters
};

// The quality of what the filter says.
struct fuse_quality {
    uint16_t tilt_sigma_cdeg;     // UINT16_MAX: not known
    uint16_t heading_sigma_cdeg;  // UINT16_MAX: heading is free
    bool is_starting;
    bool is_at_rest;
    bool is_mag_disturbed;
    bool is_mag_absent;
    bool is_heading_free;
};

// For 100 to 800 samples a second, of a gyroscope whose rates come `gyr_delay_us` (at
// most 7.5 ms) behind the motion.
void fuse_init(struct fuse *fuse, uint16_t rate_hz, uint16_t gyr_delay_us);

// Forgets the orientation, which has changed unseen; keeps the bias and the reference
// field.
void fuse_restart(struct fuse *fuse);

// One sample, `interval_us` after the one before it. Longer intervals than 60 ms are
// integrated for 60 ms only: the rest of the motion is lost.
void fuse_step(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us);

// A calibration at rest has found the gyroscope's bias. The filter follows it from
// there by at most 2 deg/s; before, it believes in a bias of at most 2 deg/s. Each axis
// is held within +-4 rad/s, ten times what the calibration takes for a bias.
void fuse_set_bias(struct fuse *fuse, const struct vector *bias_rad_s_q25);

// Unit quaternion, world_from_body, at the time of the last sample; world is east,
// north, up.
void fuse_orientation(const struct fuse *fuse, struct quat *out);

void fuse_quality(const struct fuse *fuse, struct fuse_quality *out);

#endif
