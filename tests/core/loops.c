// SPDX-License-Identifier: MIT
// See loops.h.
#include "loops.h"

void loop_mul_q30(int count, const int32_t *a, const int32_t *b, int32_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_mul_q30(a[i], b[i]);
    }
}

void loop_mul_q32(int count, const int32_t *a, const int32_t *b, int32_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_mul_q32(a[i], b[i]);
    }
}

void loop_umul_q32(int count, const uint32_t *a, const uint32_t *b, uint32_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_umul_q32(a[i], b[i]);
    }
}

void loop_ratio(int count, const uint32_t *numerator, const uint32_t *denominator,
                q2_30_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_ratio(numerator[i], denominator[i]);
    }
}

void loop_rsqrt(int count, const uint32_t *x, q2_30_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_rsqrt(x[i]);
    }
}

void loop_sqrt(int count, const uint32_t *x, uint16_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_sqrt(x[i]);
    }
}

void loop_atan2(int count, const int32_t *y, const int32_t *x, turn32_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = fixed_atan2(y[i], x[i]);
    }
}

void loop_sincos(int count, const turn32_t *angle, q2_30_t *sine, q2_30_t *cosine) {
    for (int i = 0; i < count; ++i) {
        fixed_sincos(angle[i], &sine[i], &cosine[i]);
    }
}

void loop_square_q30(int count, const struct vector *v, int32_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = vector_square_q30(&v[i]);
    }
}

void loop_square_q32(int count, const struct vector *v, uint32_t *out) {
    for (int i = 0; i < count; ++i) {
        out[i] = vector_square_q32(&v[i]);
    }
}

void loop_normalise(int count, const struct vector *v, struct vector *unit,
                    int32_t *norm) {
    for (int i = 0; i < count; ++i) {
        unit[i] = v[i];
        norm[i] = vector_normalise(&unit[i]);
    }
}

void loop_scale(int count, const struct vector *v, const q2_30_t *gain,
                struct vector *out) {
    for (int i = 0; i < count; ++i) {
        vector_scale(&v[i], gain[i], &out[i]);
    }
}

void loop_multiply(int count, const struct quat *a, const struct quat *b,
                   struct quat *out) {
    for (int i = 0; i < count; ++i) {
        quat_multiply(&a[i], &b[i], &out[i]);
    }
}

void loop_renormalise(int count, struct quat *q) {
    for (int i = 0; i < count; ++i) {
        quat_renormalise(&q[i]);
    }
}

void loop_small_angle(int count, const struct vector *angle, struct quat *out) {
    for (int i = 0; i < count; ++i) {
        quat_from_small_angle(&angle[i], &out[i]);
    }
}

void loop_rotate(int count, const struct quat *q, const struct vector *v,
                 struct vector *out) {
    for (int i = 0; i < count; ++i) {
        quat_rotate(&q[i], &v[i], &out[i]);
    }
}

void loop_from_heading(int count, const turn32_t *heading, struct quat *out) {
    for (int i = 0; i < count; ++i) {
        quat_from_heading(heading[i], &out[i]);
    }
}

void loop_about_z(int count, const int32_t *cosine, const int32_t *sine,
                  struct quat *out) {
    for (int i = 0; i < count; ++i) {
        quat_about_z(cosine[i], sine[i], &out[i]);
    }
}

void loop_to_no_heading(int count, const struct quat *q, struct quat *out) {
    for (int i = 0; i < count; ++i) {
        quat_to_no_heading(&q[i], &out[i]);
    }
}

void loop_axes(int count, const struct quat *q, struct vector *rows) {
    for (int i = 0; i < count; ++i) {
        quat_to_rows(&q[i], &rows[3 * i]);
    }
}

void loop_quat_of_axes(int count, const struct vector *rows, struct quat *out) {
    for (int i = 0; i < count; ++i) {
        quat_from_rows(&rows[3 * i], &out[i]);
    }
}

void loop_calibrate(const struct calibration *calibration,
                    const struct calibration_scale *scale, int count,
                    const struct sample *samples, struct measurement *out) {
    for (int i = 0; i < count; ++i) {
        calibrate(calibration, scale, &samples[i], &out[i]);
    }
}

void loop_fuse(struct fuse *fuse, int count, const struct measurement *measurements,
               const uint32_t *interval_us, struct quat *orientation,
               struct quat *level, struct attitude_quality *quality) {
    for (int i = 0; i < count; ++i) {
        fuse_step(fuse, &measurements[i], interval_us[i]);
        fuse_orientation(fuse, &orientation[i]);
        quat_multiply(&fuse->state.level_from_inertial, &fuse->state.inertial_from_body,
                      &level[i]);
        fuse_quality(fuse, &quality[i]);
    }
}

void loop_attitude(struct attitude *attitude, int count,
                   const struct measurement *measurements, const uint32_t *interval_us,
                   struct quat *orientation, struct attitude_quality *quality) {
    for (int i = 0; i < count; ++i) {
        attitude_step(attitude, &measurements[i], interval_us[i]);
        attitude_orientation(attitude, &orientation[i]);
        attitude_quality(attitude, &quality[i]);
    }
}

uint8_t loop_kind(const struct attitude *attitude) {
    return (uint8_t)attitude_kind(attitude);
}

void loop_pose(struct pose_tracker *tracker, int count, const struct sample *samples,
               struct message_pose *poses, int32_t *results) {
    for (int i = 0; i < count; ++i) {
        results[i] = pose_step(tracker, &samples[i]);
        pose_read(tracker, &poses[i]);
    }
}

int loop_strokes(struct pose_tracker *tracker, int count, const struct sample *samples,
                 const bool *held, struct message_stroke *told, int32_t *after) {
    int found = 0;
    for (int i = 0; i < count; ++i) {
        if (held[i] != (i > 0 && held[i - 1])) {
            pose_hold(tracker, held[i]);
        }
        (void)pose_step(tracker, &samples[i]);
        if (pose_read_stroke(tracker, &told[found])) {
            after[found] = i;
            ++found;
        }
    }
    return found;
}
