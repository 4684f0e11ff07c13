// SPDX-License-Identifier: MIT
// Madgwick's filter ("An efficient orientation filter for inertial and
// inertial/magnetic sensor arrays", 2010), used in the paper by Rozanowski and others
// (section III.E). They found beta by trial and do not state it; we use Madgwick's own
// value for nine axes.
#ifndef MADGWICK_H
#define MADGWICK_H

#include "core/fusion/paper_filter.h"

struct madgwick {
    struct paper_filter common;
    struct quat earth_from_body;  // earth: x north, z up, as in Madgwick's report
};

// The functions of fuse.h; rate and delay are ignored. Between two field readings
// the six-axis form corrects: no reading is used twice, or after a rotation that it
// does not include.
void madgwick_init(struct madgwick *madgwick, uint16_t rate_hz, uint16_t gyr_delay_us);
void madgwick_restart(struct madgwick *madgwick);
void madgwick_step(struct madgwick *madgwick, const struct measurement *measurement,
                   uint32_t interval_us);
void madgwick_set_bias(struct madgwick *madgwick, const struct vector *bias_rad_s_q25);
void madgwick_orientation(const struct madgwick *madgwick, struct quat *out);
void madgwick_quality(const struct madgwick *madgwick, struct attitude_quality *out);

#endif
