// SPDX-License-Identifier: MIT
// What the filters of the papers share: the bias, the first attitude, a rotation step
// to first order, and the little that they know of their own quality.
#ifndef CLASSIC_H
#define CLASSIC_H

#include "core/fusion/calibrate.h"
#include "core/fusion/quality.h"
#include "core/math/quat.h"

struct classic {
    struct vector bias_rad_s_q25;
    uint32_t age_us;        // since the start, held where it no longer matters
    uint32_t field_age_us;  // since the last reading, the same
    bool has_level;         // a specific force has told the vertical
    bool has_heading;       // and a field north
};

void classic_init(struct classic *classic);

// Forgets all but the bias.
void classic_restart(struct classic *classic);

// Each axis is held within +-4 rad/s.
void classic_set_bias(struct classic *classic, const struct vector *bias_rad_s_q25);

// Counts time and readings.
void classic_step(struct classic *classic, const struct measurement *measurement,
                  uint32_t interval_us);

// At rest and disturbed are never told; heading is free where no field has come for a
// second.
void classic_quality(const struct classic *classic, struct attitude_quality *out);

// True until a force has told the vertical, and for each field until one has told
// north.
bool classic_wants_start(const struct classic *classic,
                         const struct measurement *measurement);

// The papers begin anywhere and wait. Here the first force levels q, with the body's x
// axis to the east, and the first field turns it to north. True where the sample is
// used up for that, or where there has been no force at all: then q is not to be
// stepped. Only where it is wanted.
bool classic_start(struct classic *classic, const struct measurement *measurement,
                   struct quat *world_from_body);

// Seconds times 2^33, so that rad/s q7_25 gives rad q4_28, which read as q2_30 is a
// quarter of it. Of longer intervals than 50 ms only that is taken.
int32_t classic_seconds_q33(uint32_t interval_us);

// The rate less the bias, each axis within 42 rad/s.
void classic_rate(const struct classic *classic, const struct measurement *measurement,
                  struct vector *rate_rad_s_q25);

// Half of q + q * (0, angle / 2), the first-order step. Needs |q| <= 1 + 1e-6 and a
// quarter of the angle at most 1.3: then no component leaves q2_30.
void classic_half_step(const struct quat *q, const struct vector *quarter_rad_q30,
                       struct quat *out);

// q / |q|, its norm within 1e-7 of 1. Returns false and leaves q where it is zero. No
// component may be INT32_MIN.
bool classic_normalise(struct quat *q);

// The world's axes in the body: rows of the matrix of q, whose norm is within 1e-6
// of 1.
void classic_axes(const struct quat *q, struct vector rows[3]);

// The unit quaternion of rows that are orthogonal within 0.1 and whose norms are within
// 0.1 of 1 and not above it by more than 1e-6.
void classic_quat(const struct vector rows[3], struct quat *out);

// The horizontal and the vertical part of a field, a unit vector in the body: the
// reference that both Mahony's and Madgwick's filter take from each reading, so that a
// field which is not the Earth's turns their heading alone in the end (Madgwick 2010,
// equations 45 and 46).
void classic_field(const struct vector rows[3], const struct vector *field,
                   q2_30_t *horizontal, q2_30_t *vertical);

// Of vectors q2_30 the product of whose norms is below 2: so is the result.
q2_30_t classic_dot(const struct vector *a, const struct vector *b);
void classic_cross(const struct vector *a, const struct vector *b, struct vector *out);

#endif
