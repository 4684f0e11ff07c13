// SPDX-License-Identifier: MIT
// The output of a sensor's driver: one instant of all sensors, in the probe's body
// frame.
#ifndef SAMPLE_H
#define SAMPLE_H

#include <stdbool.h>
#include <stdint.h>

enum { SAMPLE_NO_TEMPERATURE = INT16_MIN };

// The axes by name, or by number in a loop.
struct counts {
    union {
        struct {
            int16_t x, y, z;
        };
        int16_t axis[3];
    };
};

struct sample {
    uint32_t time_us;   // device time of the data-ready edge, wraps after 71.6 min
    struct counts acc;  // specific force, +1 g up at rest
    struct counts gyr;
    struct counts mag;         // factory adjustment applied; only where has_mag
    int16_t temperature_cdeg;  // 0.01 degC, or SAMPLE_NO_TEMPERATURE
    bool has_mag;              // a magnetometer reading that was not there before
    bool mag_overflow;
    bool acc_clipped;
    bool gyr_clipped;
    bool has_gap;  // samples were missed before this one
};

#endif
