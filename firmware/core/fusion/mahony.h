// SPDX-License-Identifier: MIT
// Mahony's explicit complementary filter (Mahony, Hamel and Pflimlin 2008, section V),
// as the NECTEC paper runs it (section 6.1): Kp 15, Ki 0, accelerometer and
// magnetometer, a quaternion stepped to first order every 5 ms.
#ifndef MAHONY_H
#define MAHONY_H

#include "core/fusion/paper_filter.h"

struct mahony {
    struct paper_filter common;
    struct quat world_from_body;
};

// The functions of fuse.h; rate and delay make no difference. Between two readings of
// the field the vertical alone corrects: no reading is used twice, nor turned by a
// rotation that it does not know of.
void mahony_init(struct mahony *mahony, uint16_t rate_hz, uint16_t gyr_delay_us);
void mahony_restart(struct mahony *mahony);
void mahony_step(struct mahony *mahony, const struct measurement *measurement,
                 uint32_t interval_us);
void mahony_set_bias(struct mahony *mahony, const struct vector *bias_rad_s_q25);
void mahony_orientation(const struct mahony *mahony, struct quat *out);
void mahony_quality(const struct mahony *mahony, struct attitude_quality *out);

#endif
