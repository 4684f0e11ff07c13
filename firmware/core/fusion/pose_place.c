// SPDX-License-Identifier: MIT
// Where the tip is, and the strokes that lead there; see pose.h.
#include "core/fusion/pose_place.h"

#include <stddef.h>
#include <string.h>

#ifndef POSE_WITHOUT_STROKES

static bool has_tip(const struct pose_tracker *tracker) {
    return tracker->tip.offset_um[0] != POSE_POSITION_NULL;
}

// The vector from the sensor to the tip, um.
static void find_arm(const struct pose_tracker *tracker, struct vector *out) {
    struct quat q;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = has_tip(tracker) ? tracker->tip.offset_um[axis] : 0;
    }
    attitude_orientation(&tracker->attitude, &q);
    quat_rotate(&q, out, out);
}

// To the world whose north is that of the origin.
static void turn_to_origin(const struct pose_tracker *tracker, struct vector *v) {
    if (tracker->origin == POSE_ORIGIN_HEADING) {
        quat_rotate(&tracker->to_origin, v, v);
    }
}

static void put_vector(const struct pose_tracker *tracker, struct vector *v,
                       int32_t out[3]) {
    turn_to_origin(tracker, v);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out[axis] = v->axis[axis];
    }
}

void pose_place_begin(struct pose_tracker *tracker) {
    const struct calibration *calibration = tracker->calibration;
    stroke_begin(&tracker->stroke, calibration->acc.sigma, calibration->gyr.sigma);
    tracker->tip =
        (struct pose_tip){{POSE_POSITION_NULL, 0, 0}, {POSE_NORMAL_NULL, 0, 0}};
    tracker->has_stroke = false;
    tracker->fault = STROKE_END_RUNNING;
    tracker->work = POSE_WORK_NONE;
    tracker->sums = (struct stroke_sums){.force_q5 = {.x = 0}};
}

void pose_place_origin(struct pose_tracker *tracker) {
    struct vector place;
    if (tracker->origin == POSE_ORIGIN_NONE) {
        tracker->stroke.is_placed = false;
        return;
    }
    find_arm(tracker, &place);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        place.axis[axis] = -place.axis[axis];
    }
    stroke_place(&tracker->stroke, &place);
}

static void tell(struct pose_tracker *tracker) {
    stroke_state(&tracker->stroke);
    tracker->has_stroke = true;
}

void pose_place_break(struct pose_tracker *tracker) {
    tracker->fault = STROKE_END_GAP;
    if (tracker->work == POSE_WORK_TELL) {
        tell(tracker);
    }
    tracker->work = POSE_WORK_NONE;
    tracker->sums = (struct stroke_sums){.force_q5 = {.x = 0}};
}

// The filter has completed a window.
static void take_window(struct pose_tracker *tracker, const struct sample *sample) {
    struct stroke_window *window = &tracker->window;
    if (tracker->fault == STROKE_END_RUNNING &&
        !(window->is_settled && tracker->is_calibrated)) {
        tracker->fault = STROKE_END_LOST;
    }
    window->time_us = sample->time_us;
    window->fault = tracker->fault;
    tracker->fault = STROKE_END_RUNNING;
    tracker->work = POSE_WORK_STEP;
    if (tracker->stroke.is_held) {
        attitude_deny_rest(&tracker->attitude);
    }
}

static void learn_drift(struct pose_tracker *tracker, uint8_t axis) {
    const struct stroke *stroke = &tracker->stroke;
    attitude_learn_drift(&tracker->attitude, axis, &stroke->delta_q15,
                         stroke->delta_noise_q30, stroke->windows);
}

// The next part of what the last window brought.
static void work(struct pose_tracker *tracker, const struct fuse *fuse) {
    struct stroke_window *window = &tracker->window;
    switch (tracker->work) {
    case POSE_WORK_STEP:
        window->inertial_from_body = &fuse->state.inertial_from_body;
        window->world_from_inertial = &fuse->state.world_from_inertial;
        tracker->work =
            stroke_step(&tracker->stroke, window) ? POSE_WORK_TELL : POSE_WORK_NONE;
        break;
    case POSE_WORK_TELL:
        tell(tracker);
        tracker->work = tracker->stroke.end == STROKE_END_BUTTON ? POSE_WORK_LEARN_X
                                                                 : POSE_WORK_NONE;
        break;
    case POSE_WORK_LEARN_X:
        learn_drift(tracker, 0);
        tracker->work = POSE_WORK_LEARN_Y;
        break;
    case POSE_WORK_LEARN_Y:
        learn_drift(tracker, 1);
        tracker->work = POSE_WORK_NONE;
        break;
    default:
        break;
    }
}

void pose_place_step(struct pose_tracker *tracker, const struct sample *sample) {
    const struct fuse *fuse = attitude_fuse(&tracker->attitude);
    if (sample->has_gap) {
        tracker->fault = STROKE_END_GAP;
    } else if (tracker->fault == STROKE_END_RUNNING &&
               (sample->acc_clipped || sample->gyr_clipped)) {
        tracker->fault = STROKE_END_CLIPPED;
    }
    if (fuse == NULL) {
        return;
    }
    if (stroke_listen(&tracker->sums, fuse, &tracker->window)) {
        take_window(tracker, sample);
    } else if ((uint8_t)(fuse->state.in_stride + 1) == fuse->coefficients.stride) {
        work(tracker, fuse);
    }
}

// Since the last window that the stroke has taken, as a share of one.
static q2_30_t since_window(const struct pose_tracker *tracker,
                            const struct fuse *fuse) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    const uint8_t samples =
        (uint8_t)(fuse->state.in_window +
                  (tracker->work == POSE_WORK_STEP ? coefficients->window : 0));
    return samples * coefficients->share;
}

void pose_place_read(const struct pose_tracker *tracker, const struct quat *q,
                     struct message_pose *out) {
    struct vector v;
    struct vector arm;
    const struct fuse *fuse = attitude_fuse(&tracker->attitude);
    if (tracker->tip.axis[0] != POSE_NORMAL_NULL) {
        for (uint8_t axis = 0; axis < 3; ++axis) {
            v.axis[axis] = tracker->tip.axis[axis] * INT32_C(32768);  // q2_29
        }
        quat_rotate(q, &v, &v);
        turn_to_origin(tracker, &v);
        for (uint8_t axis = 0; axis < 3; ++axis) {
            out->normal[axis] =
                (int16_t)fixed_clamp(fixed_scale_down(v.axis[axis], 15), INT16_MAX);
        }
    }
    if (fuse == NULL || !has_tip(tracker) ||
        !stroke_position(&tracker->stroke, since_window(tracker, fuse), &v)) {
        return;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        arm.axis[axis] = tracker->tip.offset_um[axis];
    }
    quat_rotate(q, &arm, &arm);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        v.axis[axis] += arm.axis[axis];
    }
    put_vector(tracker, &v, out->position);
}

// Not inline, so that a sample without a stroke needs no room for it.
__attribute__((noinline)) static uint16_t flags_of(const struct pose_tracker *tracker) {
    struct attitude_quality quality;
    attitude_quality(&tracker->attitude, &quality);
    const bool is_tared = tracker->origin != POSE_ORIGIN_NONE;
    return (uint16_t)(pose_place_flags(tracker, &quality) |
                      (is_tared ? POSE_TARED : 0));
}

bool pose_read_stroke(struct pose_tracker *tracker, struct message_stroke *out) {
    const struct stroke *stroke = &tracker->stroke;
    struct vector v = stroke->moved_um;
    if (!tracker->has_stroke) {
        return false;
    }
    tracker->has_stroke = false;
    out->stroke_flags = flags_of(tracker);
    out->stroke = stroke->number;
    out->end = stroke->end;
    out->windows = stroke->windows;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->displacement[axis] = STROKE_DISPLACEMENT_NULL;
        out->path[axis] = STROKE_PATH_NULL;
    }
    for (uint8_t i = 0; i < 2; ++i) {
        out->displacement_sigma[i] = STROKE_DISPLACEMENT_SIGMA_NULL;
        out->path_sigma[i] = STROKE_PATH_SIGMA_NULL;
    }
    if (stroke->end <= STROKE_END_BUTTON) {
        put_vector(tracker, &v, out->displacement);
        out->displacement_sigma[0] = stroke->sigma.horizontal;
        out->displacement_sigma[1] = stroke->sigma.vertical;
    }
    if (stroke_position(stroke, 0, &v)) {
        put_vector(tracker, &v, out->path);
        out->path_sigma[0] = stroke->path_sigma.horizontal;
        out->path_sigma[1] = stroke->path_sigma.vertical;
    }
    return true;
}

void pose_set_tip(struct pose_tracker *tracker, const struct pose_tip *tip,
                  bool is_by_button) {
    struct stroke *stroke = &tracker->stroke;
    // Without the struct's padding.
    if (memcmp(&tracker->tip, tip,
               offsetof(struct pose_tip, axis) + sizeof tip->axis) != 0) {
        tracker->tip = *tip;
        stroke->is_placed = false;
    }
    if (stroke->is_by_button != is_by_button) {
        tracker->has_stroke |= stroke->phase == STROKE_MOVES;
        stroke_by_button(stroke, is_by_button);
    }
}

void pose_hold(struct pose_tracker *tracker, bool is_held) {
    if (is_held && !tracker->stroke.is_placed && tracker->stroke.is_by_button &&
        tracker->has_sample) {
        const uint8_t origin = tracker->origin;
        tracker->origin = POSE_ORIGIN_HEADING;
        pose_place_origin(tracker);
        tracker->origin = origin;
    }
    stroke_hold(&tracker->stroke, is_held);
    if (tracker->stroke.is_held) {
        attitude_deny_rest(&tracker->attitude);
        if (is_held && attitude_fuse(&tracker->attitude) == NULL) {
            stroke_refuse(&tracker->stroke, STROKE_END_NO_FILTER);
            tracker->has_stroke = true;
        }
    }
}
#endif
