// SPDX-License-Identifier: MIT
// Functions of firmware/core/ over whole arrays, for tests that ask thousands of times.
#ifndef LOOPS_H
#define LOOPS_H

#include <stdbool.h>
#include <stdint.h>

#include "core/fusion/attitude.h"
#include "core/fusion/fuse.h"
#include "core/fusion/paper_filter.h"
#include "core/fusion/pose.h"
#include "core/math/fixed.h"
#include "core/math/quat.h"
#include "core/math/vector.h"

void loop_mul_q30(int count, const int32_t *a, const int32_t *b, int32_t *out);
void loop_mul_q32(int count, const int32_t *a, const int32_t *b, int32_t *out);
void loop_umul_q32(int count, const uint32_t *a, const uint32_t *b, uint32_t *out);
void loop_ratio(int count, const uint32_t *numerator, const uint32_t *denominator,
                q2_30_t *out);
void loop_rsqrt(int count, const uint32_t *x, q2_30_t *out);
void loop_sqrt(int count, const uint32_t *x, uint16_t *out);
void loop_atan2(int count, const int32_t *y, const int32_t *x, turn32_t *out);
void loop_sincos(int count, const turn32_t *angle, q2_30_t *sine, q2_30_t *cosine);

void loop_square_q30(int count, const struct vector *v, int32_t *out);
void loop_square_q32(int count, const struct vector *v, uint32_t *out);
void loop_normalise(int count, const struct vector *v, struct vector *unit,
                    int32_t *norm);
void loop_scale(int count, const struct vector *v, const q2_30_t *gain,
                struct vector *out);

void loop_multiply(int count, const struct quat *a, const struct quat *b,
                   struct quat *out);
void loop_renormalise(int count, struct quat *q);
void loop_small_angle(int count, const struct vector *angle, struct quat *out);
void loop_rotate(int count, const struct quat *q, const struct vector *v,
                 struct vector *out);
void loop_from_heading(int count, const turn32_t *heading, struct quat *out);
void loop_about_z(int count, const int32_t *cosine, const int32_t *sine,
                  struct quat *out);
void loop_to_no_heading(int count, const struct quat *q, struct quat *out);

void loop_axes(int count, const struct quat *q, struct vector *rows);
void loop_quat_of_axes(int count, const struct vector *rows, struct quat *out);

void loop_calibrate(const struct calibration *calibration,
                    const struct calibration_scale *scale, int count,
                    const struct sample *samples, struct measurement *out);

// One step a measurement; `level` is level_from_inertial * inertial_from_body, which
// no field may tilt.
void loop_fuse(struct fuse *fuse, int count, const struct measurement *measurements,
               const uint32_t *interval_us, struct quat *orientation,
               struct quat *level, struct attitude_quality *quality);

// The same of any filter.
void loop_attitude(struct attitude *attitude, int count,
                   const struct measurement *measurements, const uint32_t *interval_us,
                   struct quat *orientation, struct attitude_quality *quality);

// What an image of one filter has inline.
uint8_t loop_kind(const struct attitude *attitude);

// One step and one pose a sample; `results` as pose_step() gave them.
void loop_pose(struct pose_tracker *tracker, int count, const struct sample *samples,
               struct message_pose *poses, int32_t *results);

// One step a sample. `held`: whether the button is held for a stroke from that sample
// on. What is told of strokes, and after which sample; returns how many times.
int loop_strokes(struct pose_tracker *tracker, int count, const struct sample *samples,
                 const bool *held, struct message_stroke *told, int32_t *after);

#endif
