// SPDX-License-Identifier: MIT
// The motion that the model of a sensor measures, the same for every model: asked for
// from a function, or held; and its value in counts.
#ifndef SIM_CHIPS_CHIP_MOTION_H
#define SIM_CHIPS_CHIP_MOTION_H

#include <stdbool.h>
#include <stdint.h>

#define STANDARD_GRAVITY 9.80665  // m/s2
#define RAD_PER_DEG 0.017453292519943295

enum chip_quantity {
    CHIP_GYR,  // rad/s
    CHIP_ACC,  // m/s2, specific force: +g on z when lying level
    CHIP_MAG,  // uT
};

// Writes the mean of the quantity over (from_ns, to_ns] to mean, or its value at that
// time where both are equal. from_ns may be negative.
typedef void (*chip_motion_function)(void *context, enum chip_quantity quantity,
                                     int64_t from_ns, int64_t to_ns, double mean[3]);

// Where motion comes from.
struct chip_motion_source {
    chip_motion_function function;  // null: it is held
    void *context;
    bool is_recorded;  // a sensor's low-pass is in the motion already
};

struct chip_motion {
    struct chip_motion_source source;
    double held[3][3];  // by chip_quantity
};

// The motion of that source or, where it has no function, lying still, level, in a
// field of (0, 20, -40) uT until chip_motion_hold().
struct chip_motion chip_motion_from(struct chip_motion_source source);
void chip_motion_hold(struct chip_motion *motion, const double gyr_rad_s[3],
                      const double acc_m_s2[3], const double mag_ut[3]);
// The mean over (from_ns, to_ns], as chip_motion_function gives it.
void chip_motion_mean(const struct chip_motion *motion, enum chip_quantity quantity,
                      int64_t from_ns, int64_t to_ns, double mean[3]);
// Nearest count, from -limit - 1 to limit: two's complement.
int16_t chip_motion_to_counts(double value, double limit);

#endif
