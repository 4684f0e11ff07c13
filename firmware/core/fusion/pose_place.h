// SPDX-License-Identifier: MIT
// The parts of a pose that strokes and tip make. Private to core/fusion/: pose.c calls
// them, and not the other way round. None does anything in a build without strokes.
#ifndef POSE_PLACE_H
#define POSE_PLACE_H

#include "core/fusion/pose.h"

// What a pose and a stroke have as flags, but for those of an origin and those that
// samples latch.
static inline uint16_t pose_place_flags(const struct pose_tracker *tracker,
                                        const struct attitude_quality *quality) {
    return (uint16_t)(quality->flags |
                      (tracker->is_calibrated ? 0 : POSE_UNCALIBRATED));
}

#ifdef POSE_WITHOUT_STROKES
#define pose_place_begin(tracker) ((void)(tracker))
#define pose_place_origin(tracker) ((void)(tracker))
#define pose_place_break(tracker) ((void)(tracker))
#define pose_place_step(tracker, sample) ((void)(tracker))
#define pose_place_read(tracker, q, out) ((void)(tracker))
#else

// With the calibration of the tracker.
void pose_place_begin(struct pose_tracker *tracker);

// The origin has changed.
void pose_place_origin(struct pose_tracker *tracker);

// The orientation was found again.
void pose_place_break(struct pose_tracker *tracker);

// A sample was taken, and not yet worked on.
void pose_place_step(struct pose_tracker *tracker, const struct sample *sample);

// Position and normal, where they are known; q: world_from_body, not from an origin.
void pose_place_read(const struct pose_tracker *tracker, const struct quat *q,
                     struct message_pose *out);

#endif
#endif
