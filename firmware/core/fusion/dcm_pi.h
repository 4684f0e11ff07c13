// SPDX-License-Identifier: MIT
// Baranek's filter ("Inertial Measurement Unit - Data Fusion and Visualization using
// MATLAB"): a rotation matrix stepped to first order, its rows kept orthonormal, and
// two PI controllers whose outputs are the gyroscope's offsets (equations 6 to 16).
//
// It uses no magnetometer: the first field reading gives north, and heading drifts from
// then on. The paper's equations contradict each other; we read z in equations 12 to 14
// as the world's axis, a row as in equations 7 to 11, and x and y as the gyroscope's
// own axes. With only columns or only rows of the matrix the loop diverges for half of
// all headings.
#ifndef DCM_PI_H
#define DCM_PI_H

#include "core/fusion/paper_filter.h"

struct dcm_pi {
    struct paper_filter common;
    struct vector rows[3];  // of world_from_body: the world's axes in the body
    q2_30_t sum_x_rad_s, sum_y_rad_s;  // the controllers' integral parts, +-1 rad/s
};

PAPER_FILTER(dcm_pi);

#endif
