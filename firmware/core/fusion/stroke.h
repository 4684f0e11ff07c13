// SPDX-License-Identifier: MIT
// Strokes: how far the probe has moved between two rests, or while its button is held.
//
// Works on the filter's windows of 100 ms: the mean specific force of each, in the
// inertial frame. Between two rests of force f0 and f1 (world_from_inertial turns all)
//
//     d = P - V T / 2 + K (f1 - f0) T^2 / 12
//
// with V and P the first and second integral of the force less f0. A constant error of
// the force cancels; one that grows evenly, as a gyroscope's bias tilts the frame,
// shows in f1 - f0. K is the share of f1 - f0 that such a tilt explains, the rest of it
// is noise. Every end is measured over a window, so that tremor averages out.
#ifndef STROKE_H
#define STROKE_H

#include "core/fusion/fuse.h"
#include "core/wire/messages.h"

enum {
    STROKE_LATE = 3,          // windows that are held back: a start is found that late
    STROKE_WINDOWS_MAX = 50,  // 5 s
};

// The specific force in a window, inertial frame, m/s2, each number within +-1000.
struct stroke_force {
    struct vector mean_q15;
    // Twice the mean over the window of the velocity that it gains from its start on, a
    // window of velocity being the unit: the mean, if the force does not change.
    struct vector gained_q15;
};

// The filter's data of a window.
struct stroke_window {
    struct stroke_force force;
    struct vector turn_q15;  // mean rate, rad/s, inertial frame
    uint32_t time_us;        // of its end
    // Of the gyroscope's bias, mean of the axes, as the filter has it: in 4ths of 1
    // deg/s.
    q11_21_t bias_variance;
    bool is_settled;  // the filter has found its level
    uint8_t fault;    // enum stroke_end: what makes it useless; or running
    // When it is taken.
    const struct quat *inertial_from_body;
    const struct quat *world_from_inertial;
};

enum stroke_phase {
    STROKE_LOST = 0,  // until a rest is found
    STROKE_RESTS = 1,
    STROKE_MOVES = 2,
};

// Of the window that runs: the sum of the filter's sums of force, a sample each.
struct stroke_sums {
    struct vector force_q5;
};

// Takes the sample that the filter took last. The window that the filter has just
// completed, all but time_us, fault and the attitudes; call it between fuse_take() and
// fuse_work(). False where it has completed none.
bool stroke_listen(struct stroke_sums *sums, const struct fuse *fuse,
                   struct stroke_window *out);

// Variances of a tilt, (1e-5 m)^2, in the level and up; `is_open`: of a stroke whose
// end is not known.
struct stroke_tilt {
    uint32_t level, up;
    bool is_open;
};

// Sigmas in 1e-5 m, of each horizontal axis and of the vertical one.
struct stroke_sigma {
    uint16_t horizontal, vertical;
};

// What the sigmas of a module's params do to a stroke.
struct stroke_errors {
    // Variance of the force that a turn of 1 rad brings, eight times, (m/s2)^2.
    q2_30_t turn_level, turn_up;
    // Of lengths, um to 1e-5 m: the scale of the accelerometer, and of the other axes'
    // length the direction of its rest.
    q2_30_t scale, lean;
};

struct stroke {
    uint8_t phase;
    uint8_t end;        // enum stroke_end, of the last one, or running
    uint8_t windows;    // of the stroke, without those that are held back
    uint8_t filled;     // of those that are held back
    uint8_t settled;    // windows in `rest`, at most 4
    uint8_t steady;     // windows in a row that did not turn, at most 4
    uint8_t countdown;  // windows until a press or a release is reached
    bool is_by_button;  // strokes are what the button is held for
    bool is_held;
    bool is_near;          // it was pressed again before the stroke's end was measured
    bool is_placed;        // the path has an origin, and nothing has broken it
    uint8_t noted;         // windows in `noise_q30`, at most 16
    uint16_t number;       // strokes since the start
    int16_t start_q14[4];  // inertial_from_body at the start
    uint32_t start_us;     // end of the window in which its start was found
    uint32_t noise_q30;    // of a window: mean square from `rest`, (m/s2)^2, three axes
    uint32_t quiet_q30;    // the same of the quietest rests: what is the sensor's
    uint32_t sway_q30;     // mean square rate of rests, (rad/s)^2, three axes
    uint32_t began_q30;    // the same just before the stroke
    struct stroke_errors errors;            // of the module
    struct stroke_force late[STROKE_LATE];  // the newest is the last
    uint32_t late_turn_q30[STROKE_LATE];    // their square rates, (rad/s)^2, three axes
    struct vector rest_q15;                 // force
    // Sums over windows of 100 ms: of the force less `rest`, and of the sums before and
    // after each window.
    struct vector velocity, twice_way;
    // Of the last stroke: by how much the force at its end was another than before it,
    // and the variance of that, of an axis, without what a bias adds.
    struct vector delta_q15;
    uint32_t delta_noise_q30;
    struct vector moved_um;     // world: of this stroke, or of the last one
    struct vector speed_um;     // a window, while it moves
    struct vector path_um;      // world: from the origin to where the stroke began
    struct stroke_tilt tilt;    // of moved_um
    struct stroke_sigma sigma;  // the same, since stroke_state()
    struct stroke_sigma path_sigma;
};

// Forgets all; strokes are those between rests. The sigmas are those of params'
// records: 1e-4 m/s2 of the accelerometer, 1e-5 of the gyroscope's scale; held at those
// of a module that is not calibrated.
void stroke_begin(struct stroke *stroke, uint16_t acc_sigma, uint16_t gyr_sigma);

// Whether strokes are what the button is held for. Ends one that runs otherwise.
void stroke_by_button(struct stroke *stroke, bool is_by_button);

// A press can't begin a stroke: `end` says why.
void stroke_refuse(struct stroke *stroke, uint8_t end);

// The button is pressed for a stroke, or released.
void stroke_hold(struct stroke *stroke, bool is_held);

// The next window. True where there is something to tell: a stroke runs, has ended, or
// was refused; call stroke_state() first, before the next window.
bool stroke_step(struct stroke *stroke, const struct stroke_window *window);

// The errors of what there is to tell. Apart, since both together take too long.
void stroke_state(struct stroke *stroke);

// The place of the sensor is `path_um` from now on.
void stroke_place(struct stroke *stroke, const struct vector *path_um);

// Where it is, world frame, um, `since` (q2_30) of a window after the last one. False,
// and nothing written, where that is not known.
bool stroke_position(const struct stroke *stroke, q2_30_t since, struct vector *out);

#endif
