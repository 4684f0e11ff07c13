// SPDX-License-Identifier: MIT
// Mahony's explicit complementary filter (Mahony, Hamel and Pflimlin 2008, section V),
// with the parameters of the NECTEC paper (section 6.1): Kp 15, Ki 0, accelerometer and
// magnetometer, a quaternion stepped to first order every 5 ms.
#ifndef MAHONY_H
#define MAHONY_H

#include "core/fusion/paper_filter.h"

struct mahony {
    struct paper_filter common;
    struct quat world_from_body;
};

// Between two field readings only the vertical corrects: no reading is used twice, or
// after a rotation that it does not include.
PAPER_FILTER(mahony);

#endif
