// SPDX-License-Identifier: MIT
// Sample to pose: calibration, start-up calibration, filter and origin, in one struct
// that a probe runs and a host runs again from the raw log.
#ifndef POSE_H
#define POSE_H

#include "core/fusion/attitude.h"
#include "core/fusion/calibrate.h"
#include "core/wire/messages.h"

enum pose_origin {
    POSE_ORIGIN_FULL = 0,     // q * conj(q0)
    POSE_ORIGIN_HEADING = 1,  // q turned about the vertical, so that q0's heading is 0
    POSE_ORIGIN_NONE = 2,
};

// What a sample brought to the start-up calibration.
enum pose_result {
    POSE_OK = 0,
    POSE_CALIBRATED = 1,
    POSE_MOVED = 2,  // refused, see calibrator.span_counts
};

struct pose_tracker {
    const struct calibration *calibration;
    const struct sensor_identity *identity;
    uint32_t last_us;
    uint16_t latched_flags;  // clipped and gap since the last pose
    bool is_calibrated;
    bool has_sample;
    uint8_t origin;  // enum pose_origin
    struct calibration_scale scale;
    struct attitude attitude;
    struct gyro_calibrator calibrator;
    struct quat to_origin;  // multiplies from the right, with a heading from the left
};

// Begins anew: calibration at rest, filter and origin. Both pointers must stay valid.
// Returns false and changes nothing where this build lacks the filter.
bool pose_begin(struct pose_tracker *tracker, const struct calibration *calibration,
                const struct sensor_identity *identity, int32_t filter);

enum pose_result pose_step(struct pose_tracker *tracker, const struct sample *sample);

// The pose of the last sample; has the flags of all samples since the last call.
void pose_read(struct pose_tracker *tracker, struct message_pose *out);

void pose_set_origin(struct pose_tracker *tracker, enum pose_origin origin);

#endif
