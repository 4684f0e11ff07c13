// SPDX-License-Identifier: MIT
// The filter of fuse.c once more, in doubles and from the same equations: what fixed
// point is compared with, and what its parameters are chosen with.
#ifndef FUSE_TWIN_H
#define FUSE_TWIN_H

#include <stdbool.h>

// What fuse.c has as constants; fuse_twin_defaults gives those.
struct fuse_twin_params {
    double lag_s;          // of a field reading behind the gyroscope, at the start
    double lag_sd;         // s, of it; 0: not estimated
    double lead_share;     // of the gyroscope's delay that the pose makes up: 1
    double bias_sd;        // deg/s, where nothing is known of it
    double bias_wander;    // (deg/s)^2/s, of a gyroscope that is warm
    double warm_wander;    // (deg/s)^2/s more at the start, which decay in 25.6 s
    double scale_sd;       // of each axis of the gyroscope; 0: not estimated
    double motion_noise;   // (deg/s)^2 s, of what levelling corrects
    double motion_drift;   // s, of the square of what levelling goes on to correct
    double turning_share;  // of the field's noise in what it tells of the gyroscope
    double turning_drift;  // s2, of the vertical field by what levelling corrects there
    double own_sd;         // uT: of the probe's field after its calibration
    double own_doubt;      // uT: of it without a magnet, at each frame; own_sd up to 2
    double own_near;       // uT: an axis at most, without a magnet
    double place_sd;       // uT: of the first readings' mean at rest
    double place_wander;   // uT2/s
    double heading_wander;  // deg2/s
    double turned_wander;   // deg2/s, where readings say that the heading is wrong
    double surprise;        // uT: the unit of a reading's distance
    double field_noise;     // uT2 s
    double field_drift;     // s2, of the vertical field by what levelling corrects
    double field_step;      // uT: of an axis of a reading, at most
    double rest_factor;     // of the noise of readings at rest
    double astray_length;   // uT, of a reading, that neither tilt nor turn explains
    double astray_share;    // of surprising readings above which the probe has changed
    double astray_wander;   // uT2/s of the probe's field then
    double tilt_floor;      // deg: the stated tilt error's part that is always there
    double tilt_drift;      // s, of what levelling goes on to correct
    double heading_floor;   // deg
    double covariance_share;  // of the field's covariance in the stated heading error
    double level_drift;       // s, of what levelling goes on to correct: its part in it
    double level_start;       // deg/s: what levelling goes on to correct, at the start
    double residual_share;    // of the square by which readings go on to surprise
    double residual_free;     // uT2 of it that are noise
    double strange_share;     // of surprising readings above which heading is unsure
    double strange_sd;        // uT: by how much then
    double rest_doubt;        // of the square by which a rest's rate surprises: noise
    double level_sd;          // deg: of the level, as a calibration leaves it
};

void fuse_twin_defaults(struct fuse_twin_params *params);

// The same where no sensor is calibrated.
void fuse_twin_uncalibrated(struct fuse_twin_params *params);

// `count` samples in SI units (rad/s, m/s2, uT), as rows of three; the calibration at
// rest finds `bias_found` before sample `calibrated_at` (-1: never). Writes rows of w,
// x, y, z and, unless NULL, of the tilt's and the heading's stated error, deg; NAN
// where it states none.
void fuse_twin_run(const struct fuse_twin_params *params, int count, int rate_hz,
                   double gyr_delay_s, const double *gyr, const double *acc,
                   const double *mag, const bool *has_mag, const double *interval_s,
                   int calibrated_at, const double *bias_found, double *quaternions,
                   double *sigmas_deg);

#endif
