// SPDX-License-Identifier: MIT
// The quality of an orientation, as the filter that found it states it.
#ifndef QUALITY_H
#define QUALITY_H

#include "core/wire/messages.h"

struct attitude_quality {
    uint16_t tilt_sigma_cdeg;     // UINT16_MAX: not known
    uint16_t heading_sigma_cdeg;  // UINT16_MAX: heading is free, or not known
    // What of a pose's flags it states: all but POSE_UNCALIBRATED, POSE_CLIPPED,
    // POSE_GAP and POSE_TARED.
    uint16_t flags;
};

#endif
