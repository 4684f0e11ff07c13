// SPDX-License-Identifier: MIT
// The complementary filter of the TIPS thesis of 2016: its noise filter (section 6,
// table I), roll and pitch by the gyroscope and the vertical (equations 7.1 to 7.5,
// alpha 0.9), yaw by the field alone (equations 7.6 to 7.8).
//
// We implement it as printed, with these consequences: equation 7.2 gives no roll
// beyond 90 degrees, so upside down is not recognised, and is wrong if there is pitch
// as well (by a degree at 17 and 23 degrees); each rate changes only its own angle;
// both constants apply to one iteration, whatever its length (15 ms in the thesis).
#ifndef COMPLEMENTARY_H
#define COMPLEMENTARY_H

#include "core/fusion/paper_filter.h"

struct complementary {
    struct paper_filter common;
    struct vector force_m_s2_q21;  // after the noise filter
    struct vector field_ut_q18;    // after the noise filter
    q7_25_t roll_rad, pitch_rad;   // up to 21 rad; a rate's format
    turn32_t yaw;                  // from north, counter-clockwise
};

// Yaw stays constant between two field readings: in the thesis no rate changes it.
PAPER_FILTER(complementary);

#endif
