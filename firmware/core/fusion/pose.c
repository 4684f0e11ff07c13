// SPDX-License-Identifier: MIT
// Sample to pose; see pose.h.
#include "core/fusion/pose.h"

#include "core/fusion/pose_place.h"

// A gap after which the orientation is found again: a hand turns far in that time.
#define RESTART_US UINT32_C(250000)

bool pose_begin(struct pose_tracker *tracker, const struct calibration *calibration,
                const struct sensor_identity *identity, int32_t filter) {
    if (!attitude_has(filter)) {
        return false;
    }
    tracker->calibration = calibration;
    tracker->identity = identity;
    calibration_scale_of(identity, &tracker->scale);
    gyro_calibrator_begin(&tracker->calibrator);
    attitude_init(&tracker->attitude, (enum filter)filter, identity->rate_hz,
                  identity->gyr_delay_us);
    attitude_set_accuracy(&tracker->attitude, calibration);
#ifndef POSE_WITHOUT_MAG_LAG
    if (identity->mag_lag_us != 0) {
        attitude_set_mag_lag(&tracker->attitude, identity->mag_lag_us);
    }
#endif
    pose_place_begin(tracker);
    pose_set_origin(tracker, POSE_ORIGIN_NONE);
    tracker->latched_flags = 0;
    tracker->is_calibrated = false;
    tracker->has_sample = false;
    return true;
}

void pose_recalibrate(struct pose_tracker *tracker) {
    attitude_set_accuracy(&tracker->attitude, tracker->calibration);
    pose_place_break(tracker);
}

__attribute__((noinline)) static enum pose_result
calibrate_at_rest(struct pose_tracker *tracker, const struct sample *sample) {
    struct vector bias;
    switch (
        gyro_calibrator_step(&tracker->calibrator, sample, tracker->identity, &bias)) {
    case CALIBRATOR_DONE:
        tracker->is_calibrated = true;
        calibrate_rate(tracker->calibration, &tracker->scale, &bias);
        attitude_set_bias(&tracker->attitude, &bias);
        return POSE_CALIBRATED;
    case CALIBRATOR_MOVED:
        return POSE_MOVED;
    default:
        return POSE_OK;
    }
}

// Not inline, so that the measurement is off the stack when it was taken.
__attribute__((noinline)) static enum pose_result follow(struct pose_tracker *tracker,
                                                         const struct sample *sample) {
    enum pose_result result = POSE_OK;
    struct measurement measurement;
    uint32_t interval_us = sample->time_us - tracker->last_us;
    tracker->last_us = sample->time_us;
    if (!tracker->has_sample || interval_us > RESTART_US) {
        attitude_restart(&tracker->attitude);
        pose_place_break(tracker);
        tracker->has_sample = true;
        interval_us = UINT32_C(1000000) / tracker->identity->rate_hz;
    }
    if (!tracker->is_calibrated) {
        result = calibrate_at_rest(tracker, sample);
    }
    if (sample->acc_clipped || sample->gyr_clipped) {
        tracker->latched_flags |= POSE_CLIPPED;
    }
    if (sample->has_gap) {
        tracker->latched_flags |= POSE_GAP;
    }
    calibrate(tracker->calibration, &tracker->scale, sample, &measurement);
    attitude_take(&tracker->attitude, &measurement, interval_us);
    return result;
}

enum pose_result pose_step(struct pose_tracker *tracker, const struct sample *sample) {
    const enum pose_result result = follow(tracker, sample);
    pose_place_step(tracker, sample);
    attitude_work(&tracker->attitude);
    return result;
}

void pose_read(struct pose_tracker *tracker, struct message_pose *out) {
    struct attitude_quality quality;
    struct quat *const q = (struct quat *)out->q;
    _Static_assert(sizeof *q == sizeof out->q, "w, x, y, z");
    attitude_orientation(&tracker->attitude, q);
    attitude_quality(&tracker->attitude, &quality);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->position[axis] = POSE_POSITION_NULL;
        out->normal[axis] = POSE_NORMAL_NULL;
    }
    pose_place_read(tracker, q, out);
    out->pose_flags =
        (uint16_t)(tracker->latched_flags | pose_place_flags(tracker, &quality));
    tracker->latched_flags = 0;
    if (tracker->origin != POSE_ORIGIN_NONE) {
        if (tracker->origin == POSE_ORIGIN_FULL) {
            quat_multiply(q, &tracker->to_origin, q);
        } else {
            quat_multiply(&tracker->to_origin, q, q);
        }
        quat_renormalise(q);
        out->pose_flags |= POSE_TARED;
    }
    out->tilt_sigma = quality.tilt_sigma_cdeg;
    out->heading_sigma = quality.heading_sigma_cdeg;
}

void pose_set_origin(struct pose_tracker *tracker, enum pose_origin origin) {
    struct quat q;
    tracker->origin = (uint8_t)origin;
    if (origin !=
        POSE_ORIGIN_NONE) {  // which begins a pose, too, and is not to take long
        attitude_orientation(&tracker->attitude, &q);
        if (origin == POSE_ORIGIN_FULL) {
            quat_conjugate(&q, &tracker->to_origin);
        } else {
            quat_to_no_heading(&q, &tracker->to_origin);
        }
    }
    pose_place_origin(tracker);
}
