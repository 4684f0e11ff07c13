// SPDX-License-Identifier: MIT
// Sample to pose: calibration, start-up calibration, filter and origin, in one struct
// that a probe runs and a host runs again from the raw log.
#ifndef POSE_H
#define POSE_H

#include "core/fusion/attitude.h"
#include "core/fusion/calibrate.h"
#include "core/fusion/stroke.h"
#include "core/wire/messages.h"

// A build with POSE_WITHOUT_STROKES has no strokes: no position and no normal.
#ifdef POSE_WITHOUT_STROKES
enum { POSE_HAS_STROKES = false };
#else
enum { POSE_HAS_STROKES = true };
#endif

// A build with POSE_WITHOUT_OWN_FIELD begins with no magnetic field of the probe
// itself.

enum pose_origin {
    POSE_ORIGIN_FULL = 0,     // q * conj(q0)
    POSE_ORIGIN_HEADING = 1,  // q turned about the vertical, so that q0's heading is 0
    POSE_ORIGIN_NONE = 2,
};

// Effect of a sample on the start-up calibration.
enum pose_result {
    POSE_OK = 0,
    POSE_CALIBRATED = 1,
    POSE_MOVED = 2,  // refused, see calibrator.span_counts
};

// In the body frame, as the record of the params has them, with its nulls.
struct pose_tip {
    int32_t offset_um[3];
    q2_14_t axis[3];
};

// What a complete window brings, one of them in each sample in which the filter has
// least to do, so that none takes too long.
enum pose_work {
    POSE_WORK_NONE = 0,
    POSE_WORK_STEP = 1,     // of the stroke
    POSE_WORK_TELL = 2,     // of it
    POSE_WORK_LEARN_X = 3,  // from its end, what turned the frame about an axis
    POSE_WORK_LEARN_Y = 4,
};

struct pose_tracker {
    const struct calibration *calibration;
    const struct sensor_identity *identity;
    uint32_t last_us;
    uint8_t latched_flags;  // clipped and gap since the last pose
    bool is_calibrated;
    bool has_sample;
    uint8_t origin;  // enum pose_origin
    struct calibration_scale scale;
    struct attitude attitude;
    struct gyro_calibrator calibrator;
    struct quat to_origin;  // multiplies from the right, with a heading from the left
#ifndef POSE_WITHOUT_STROKES
    bool has_stroke;  // there is something to tell of one
    uint8_t fault;    // enum stroke_end: of the window that runs
    uint8_t work;     // enum pose_work: what is to be done next
    struct pose_tip tip;
    struct stroke_sums sums;
    struct stroke_window window;  // the last one that is complete
    struct stroke stroke;
#endif
};

// Restarts calibration at rest, filter and origin. Both pointers must stay valid.
// Returns false and changes nothing where this build lacks the filter.
bool pose_begin(struct pose_tracker *tracker, const struct calibration *calibration,
                const struct sensor_identity *identity, int32_t filter);

// The calibration has become a better one of the same axes, so that the filter can go
// on.
void pose_recalibrate(struct pose_tracker *tracker);

enum pose_result pose_step(struct pose_tracker *tracker, const struct sample *sample);

// The pose of the last sample; has the flags of all samples since the last call.
void pose_read(struct pose_tracker *tracker, struct message_pose *out);

// The current tip also becomes the origin of positions; without an origin, positions
// are unknown.
void pose_set_origin(struct pose_tracker *tracker, enum pose_origin origin);

// After pose_begin(): begins with what was kept of the probe's own field.
static inline void pose_use_own(struct pose_tracker *tracker,
                                const struct own_field *own) {
    attitude_use_own(&tracker->attitude, own);
}

#ifndef POSE_WITHOUT_STROKES

// After pose_begin(), which forgets them: the tip, and whether strokes are what the
// button is held for. Where they are others than before, positions have no origin.
void pose_set_tip(struct pose_tracker *tracker, const struct pose_tip *tip,
                  bool is_by_button);

// The button is pressed for a stroke, or released. Where the place is not known, a
// press makes it the origin of positions.
void pose_hold(struct pose_tracker *tracker, bool is_held);

// True once for each window in which there is something to tell of a stroke.
bool pose_read_stroke(struct pose_tracker *tracker, struct message_stroke *out);

#endif

#endif
