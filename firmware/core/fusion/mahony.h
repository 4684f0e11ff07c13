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

// The functions of fuse.h; rate and delay are ignored. Between two field readings
// only the vertical corrects: no reading is used twice, or after a rotation that it
// does not include.
void mahony_init(struct mahony *mahony, uint16_t rate_hz, uint16_t gyr_delay_us);
void mahony_restart(struct mahony *mahony);
void mahony_step(struct mahony *mahony, const struct measurement *measurement,
                 uint32_t interval_us);
void mahony_set_bias(struct mahony *mahony, const struct vector *bias_rad_s_q25);
void mahony_orientation(const struct mahony *mahony, struct quat *out);
void mahony_quality(const struct mahony *mahony, struct attitude_quality *out);

#endif
