// SPDX-License-Identifier: MIT
// See chip_motion.h.
#include "chip_motion.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

struct chip_motion chip_motion_from(struct chip_motion_source source) {
    return (struct chip_motion){
        .source = source,
        .held[CHIP_ACC] = {0.0, 0.0, STANDARD_GRAVITY},
        .held[CHIP_MAG] = {0.0, 20.0, -40.0},
    };
}

void chip_motion_hold(struct chip_motion *motion, const double gyr_rad_s[3],
                      const double acc_m_s2[3], const double mag_ut[3]) {
    memcpy(motion->held[CHIP_GYR], gyr_rad_s, sizeof motion->held[0]);
    memcpy(motion->held[CHIP_ACC], acc_m_s2, sizeof motion->held[0]);
    memcpy(motion->held[CHIP_MAG], mag_ut, sizeof motion->held[0]);
}

void chip_motion_mean(const struct chip_motion *motion, enum chip_quantity quantity,
                      int64_t from_ns, int64_t to_ns, double mean[3]) {
    const struct chip_motion_source *source = &motion->source;
    if (source->function != NULL) {
        source->function(source->context, quantity, from_ns, to_ns, mean);
    } else {
        memcpy(mean, motion->held[quantity], sizeof motion->held[0]);
    }
}

int16_t chip_motion_to_counts(double value, double limit) {
    const double counts = rint(value);
    if (counts > limit) {
        return (int16_t)limit;
    }
    if (counts < -limit - 1.0) {
        return (int16_t)(-limit - 1.0);
    }
    return (int16_t)counts;
}
