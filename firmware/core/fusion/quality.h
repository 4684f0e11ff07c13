// SPDX-License-Identifier: MIT
// The quality of an orientation, as the filter that found it states it.
#ifndef QUALITY_H
#define QUALITY_H

#include <stdbool.h>
#include <stdint.h>

struct attitude_quality {
    uint16_t tilt_sigma_cdeg;     // UINT16_MAX: not known
    uint16_t heading_sigma_cdeg;  // UINT16_MAX: heading is free, or not known
    bool is_starting;
    bool is_at_rest;
    bool is_mag_disturbed;
    bool is_mag_absent;
    bool is_heading_free;
};

#endif
