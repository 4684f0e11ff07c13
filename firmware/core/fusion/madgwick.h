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

// Between two field readings the six-axis form corrects: no reading is used twice, or
// after a rotation that it does not include.
PAPER_FILTER(madgwick);

#endif
