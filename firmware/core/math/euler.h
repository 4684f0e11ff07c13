// SPDX-License-Identifier: MIT
// A quaternion as three angles, for displays and for programs that want them: at the
// edge, nothing in the flow computes with them. docs/pose-details.md has the
// conventions side by side. As a matrix, and back: quat_to_rows() and quat_from_rows()
// of paper_filter.h.
#ifndef EULER_H
#define EULER_H

#include "core/math/quat.h"

// Tait-Bryan angles. yaw and roll wrap at half a turn, pitch is within a quarter.
struct euler {
    turn32_t yaw, pitch, roll;
};

// Each angle is within 5e-6 rad, of any q whose norm is within 1e-6 of 1. A step of q
// itself (9.3e-10) turns yaw and roll by up to 2e-9 / cos(pitch) rad.
//
// Gimbal lock: where x is within 1e-5 rad of the vertical, pitch is a quarter turn,
// roll is 0 and yaw has the whole turn, so that the three still say the attitude within
// 2e-5 rad. NECTEC's names are exchanged: there yaw is 0 and roll has the turn.

// Euler angles of world_from_body, z-y'-x'' intrinsic, east-north-up and x ahead,
// y left, z up: yaw counter-clockwise from east, pitch with x down, roll with y up.
void euler_from_quat(const struct quat *q, struct euler *out);

// The same of aircraft, north-east-down and x ahead, y right, z down (ISO 1151-1): yaw
// clockwise from north, pitch with x up, roll with the right side down.
void euler_aerospace(const struct quat *q, struct euler *out);

// As NECTEC's paper (section 6.2.2) defines them: of q as it is, and what others call
// roll is its yaw, what others call yaw its roll.
void euler_nectec(const struct quat *q, struct euler *out);

#endif
