// SPDX-License-Identifier: MIT
// The complementary filter of the TIPS thesis of 2016: its noise filter (section 6,
// table I), roll and pitch by the gyroscope and the vertical (equations 7.1 to 7.5,
// alpha 0.9), yaw by the field alone (equations 7.6 to 7.8).
//
// As printed: equation 7.2 leaves no roll beyond a quarter turn, so that nothing upside
// down is told, and is not the roll of three angles where there is pitch as well (a
// degree at 17 and 23); a rate turns its own angle, whatever the other; both constants
// are of an iteration, whatever its length, 15 ms there.
#ifndef COMPLEMENTARY_H
#define COMPLEMENTARY_H

#include "core/fusion/paper_filter.h"

struct complementary {
    struct paper_filter common;
    struct vector force_m_s2_q21;  // as the noise filter lets it through
    struct vector field_ut_q18;    // the same
    q7_25_t roll_rad, pitch_rad;   // up to 21 rad, the format being that of a rate
    turn32_t yaw;                  // from north, counter-clockwise
};

// The functions of fuse.h; rate and delay make no difference. Yaw is held between two
// readings of the field: the thesis has no rate for it.
void complementary_init(struct complementary *complementary, uint16_t rate_hz,
                        uint16_t gyr_delay_us);
void complementary_restart(struct complementary *complementary);
void complementary_step(struct complementary *complementary,
                        const struct measurement *measurement, uint32_t interval_us);
void complementary_set_bias(struct complementary *complementary,
                            const struct vector *bias_rad_s_q25);
void complementary_orientation(const struct complementary *complementary,
                               struct quat *out);
void complementary_quality(const struct complementary *complementary,
                           struct attitude_quality *out);

#endif
