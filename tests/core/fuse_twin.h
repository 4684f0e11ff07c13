// SPDX-License-Identifier: MIT
// The filter of firmware/core/fuse.h in doubles, to tell what fixed point costs.
#ifndef FUSE_TWIN_H
#define FUSE_TWIN_H

#include <stdbool.h>

// Runs `count` samples: gyr rad/s, acc m/s2, mag uT, rows of 3; has_mag; interval_s from
// the sample before; writes rows of w x y z. The bias is set at sample `calibrated_at`
// to `bias`, as the start-up calibration would.
void fuse_twin_run(int count, int rate_hz, double gyr_delay_s, const double *gyr,
                   const double *acc, const double *mag, const bool *has_mag,
                   const double *interval_s, int calibrated_at, const double *bias,
                   double *quaternions);

#endif
