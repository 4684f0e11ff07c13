// SPDX-License-Identifier: MIT
// The filter of fuse.c once more, in doubles and from the same equations: what fixed
// point is compared with.
#ifndef FUSE_TWIN_H
#define FUSE_TWIN_H

#include <stdbool.h>

// What a calibration sets; all other numbers are those of core/fusion/fuse_params.h.
struct fuse_twin_settings {
    double own_sigma_ut;     // of the probe's own field, an axis
    double level_sigma_deg;  // of the level, by the accelerometer's error
    double known_ut[2];      // field of the calibration, north and up; 0: not known
};

// Those of the calibration of scenes.py, and where no sensor is calibrated.
void fuse_twin_set_accuracy(struct fuse_twin_settings *settings, bool is_calibrated);

// `count` samples in SI units (rad/s, m/s2, uT), as rows of three; the calibration at
// rest finds `bias_found` before sample `calibrated_at` (-1: never). Writes rows of w,
// x, y, z and, unless NULL, of the tilt's and the heading's stated error, deg; NAN
// where it states none.
void fuse_twin_run(const struct fuse_twin_settings *settings, int count, int rate_hz,
                   double gyr_delay_s, const double *gyr, const double *acc,
                   const double *mag, const bool *has_mag, const double *interval_s,
                   int calibrated_at, const double *bias_found, double *quaternions,
                   double *sigmas_deg);

#endif
