// SPDX-License-Identifier: MIT
// Which windows a stroke is made of: rest, start, end, and what ends it; see stroke.h.
#include "core/fusion/stroke.h"

#include <string.h>

#include "core/fusion/stroke_way.h"

enum {
    SETTLED = 4,          // windows in the mean force of a rest
    SETTLED_ENOUGH = 2,   // of which a stroke can start
    STEADY = 4,           // windows without a turn that make a rest
    PRESS_WINDOWS = 3,    // until the window of a press is no longer held back
    CALM_WINDOWS = 1,     // that a stroke waits after a press while nothing moves
    RELEASE_WINDOWS = 3,  // of rest after the window before a release
    NOTED = 16,           // windows in the mean noise of rests
    NOTED_START = 4,      // for as many counts the noise that it starts from
};

#define TURN_LIMIT_Q15 Q_RAD(2, 15)          // deg/s
#define HAND_FORCE_Q15 Q15(0.5)              // m/s2
#define FORCE_LIMIT_Q15 Q15(16)              // m/s2
#define SPEED_LIMIT_Q15 STROKE_SPEED_Q15(3)  // m/s
#define WAY_LIMIT_Q15 STROKE_WAY_Q15(2)      // m
// The square of a window's noise, (m/s2)^2 about all axes, until rests have shown it,
// and its limits: a quarter of the quietest sensor's (60 ug/rtHz), and a hand's.
#define NOISE_START_Q30 ((uint32_t)Q30(SQUARE(0.02)))
#define NOISE_MIN_Q30 ((uint32_t)Q30(SQUARE(0.0012)))
#define NOISE_MAX_Q30 ((uint32_t)Q30(SQUARE(0.2)))

void stroke_begin(struct stroke *stroke, uint16_t acc_sigma, uint16_t gyr_sigma) {
    memset(stroke, 0, sizeof *stroke);
    stroke->noise_q30 = NOISE_START_Q30;
    stroke->quiet_q30 = NOISE_MAX_Q30;
    stroke->noted = NOTED_START;
    stroke_take_errors(stroke, acc_sigma, gyr_sigma);
}

// A stroke ends without a result, and with it the path.
static void lose(struct stroke *stroke, uint8_t end) {
    stroke->phase = STROKE_LOST;
    stroke->end = end;
    stroke->is_near = false;
    stroke->is_placed = false;
    stroke->settled = 0;
    stroke->steady = 0;
}

void stroke_refuse(struct stroke *stroke, uint8_t end) {
    ++stroke->number;
    stroke->windows = 0;
    stroke->countdown = 0;
    lose(stroke, end);
}

void stroke_by_button(struct stroke *stroke, bool is_by_button) {
    stroke->is_by_button = is_by_button;
    stroke->is_held = false;
    stroke->countdown = 0;
    lose(stroke, STROKE_END_CHANGED);
}

void stroke_hold(struct stroke *stroke, bool is_held) {
    if (!stroke->is_by_button || stroke->is_held == is_held) {
        return;
    }
    stroke->is_held = is_held;
    if (stroke->phase == STROKE_MOVES) {
        // A release that bounces does so within its window.
        stroke->is_near |= is_held && stroke->countdown < RELEASE_WINDOWS;
        stroke->countdown = is_held ? 0 : RELEASE_WINDOWS;
    } else {
        // A press that is over before its stroke has begun is a click.
        stroke->countdown = is_held ? PRESS_WINDOWS + CALM_WINDOWS + 1 : 0;
    }
}

void stroke_place(struct stroke *stroke, const struct vector *path_um) {
    stroke->path_um = *path_um;
    stroke->path_sigma = (struct stroke_sigma){0, 0};
    stroke->is_placed = true;
}

static uint32_t square_apart(const struct vector *a, const struct vector *b) {
    struct vector apart;
    vector_subtract(a, b, &apart);
    return stroke_square(&apart);
}

// The mean velocity over a window, the last one of a rest, is what is called none.
static void call_still(struct stroke *stroke, const struct stroke_force *last) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t rest = stroke->rest_q15.axis[axis];
        const int32_t mean = last->mean_q15.axis[axis] - rest;
        stroke->velocity.axis[axis] = mean - (last->gained_q15.axis[axis] - rest) / 2;
    }
}

// `square`: by how much the force of a window is not the mean of a rest. Of a mean of n
// windows the next is off by 1 + 1/n times their noise.
static void take_noise(struct stroke *stroke, uint32_t square) {
    const uint32_t limit = stroke_noise(stroke) * 8;
    square = square < limit ? square : limit;
    if (stroke->noted < NOTED) {
        ++stroke->noted;
    }
    stroke->noise_q30 +=
        (uint32_t)((int32_t)(square - stroke->noise_q30) / stroke->noted);
    if (stroke->noise_q30 < NOISE_MIN_Q30) {
        stroke->noise_q30 = NOISE_MIN_Q30;
    } else if (stroke->noise_q30 > NOISE_MAX_Q30) {
        stroke->noise_q30 = NOISE_MAX_Q30;
    }
    if (stroke->noted == NOTED && stroke->noise_q30 < stroke->quiet_q30) {
        stroke->quiet_q30 = stroke->noise_q30;
    }
}

// The window that is no longer held back is one of a rest.
static void take_rest(struct stroke *stroke, const struct stroke_force *before) {
    const struct vector *force = &before->mean_q15;
    struct vector apart;
    if (stroke->settled == 0) {
        stroke->rest_q15 = *force;
    }
    vector_subtract(force, &stroke->rest_q15, &apart);
    if (vector_exceeds(&apart, HAND_FORCE_Q15)) {
        stroke->rest_q15 = *force;
        stroke->settled = 0;
        memset(&apart, 0, sizeof apart);
    }
    if (stroke->settled > 0) {
        take_noise(stroke, square_apart(force, &stroke->rest_q15));
    }
    if (stroke->settled < SETTLED) {
        ++stroke->settled;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        stroke->rest_q15.axis[axis] += apart.axis[axis] / stroke->settled;
    }
    call_still(stroke, before);
}

static void start(struct stroke *stroke, const struct stroke_window *window) {
    const int32_t *q = &window->inertial_from_body->w;
    stroke->phase = STROKE_MOVES;
    stroke->end = STROKE_END_RUNNING;
    stroke->windows = 0;
    stroke->countdown = 0;
    stroke->start_us = window->time_us;
    for (uint8_t i = 0; i < 4; ++i) {
        stroke->start_q14[i] = (int16_t)fixed_scale_down(q[i], 16);
    }
    memset(&stroke->twice_way, 0, sizeof stroke->twice_way);
    ++stroke->number;
}

// What of this window shows: a turn, or a force that is not that of a rest.
static bool has_moved(const struct stroke *stroke, const struct stroke_window *window) {
    const uint32_t square = square_apart(&window->force.mean_q15, &stroke->rest_q15);
    return stroke->steady == 0 || square / 12 > stroke_noise(stroke);
}

// What is held back is not the rest of a hand: the force changes.
static bool is_unstill(const struct stroke *stroke) {
    struct vector apart;
    vector_subtract(&stroke->late[0].mean_q15, &stroke->late[2].mean_q15, &apart);
    return vector_exceeds(&apart, HAND_FORCE_Q15);
}

// The windows that are held back and the one before are those of a rest.
static bool rests(const struct stroke *stroke, const struct stroke_force *before) {
    const struct vector *newest = &stroke->late[2].mean_q15;
    const uint32_t limit = stroke_noise(stroke) * 8;
    return stroke->steady == STEADY &&
           square_apart(&before->mean_q15, newest) < limit &&
           square_apart(&stroke->late[0].mean_q15, newest) < limit &&
           square_apart(&stroke->late[1].mean_q15, newest) < limit;
}

// The same, since what has shown the start is no longer held back.
static bool has_come_to_rest(const struct stroke *stroke,
                             const struct stroke_force *before) {
    return stroke->windows > STROKE_LATE && rests(stroke, before);
}

// The force is that of a rest, but for its noise.
static bool is_calm(const struct stroke *stroke, const struct stroke_force *force,
                    const struct vector *rest) {
    return square_apart(&force->mean_q15, rest) < stroke_noise(stroke) * 4;
}

static uint16_t root_of_sum(uint16_t a, uint16_t b) {
    const uint32_t sum = (uint32_t)a * a + (uint32_t)b * b;
    return a > 45000 || b > 45000 ? UINT16_MAX : fixed_sqrt(sum);
}

// The stroke has ended at rest, and the next one starts from it.
static void finish(struct stroke *stroke, const struct stroke_force *before) {
    stroke->phase = STROKE_RESTS;
    stroke->end = stroke->is_by_button ? STROKE_END_BUTTON : STROKE_END_REST;
    stroke->settled = SETTLED;
    stroke->countdown = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        stroke->path_um.axis[axis] += stroke->moved_um.axis[axis];
    }
    stroke_late_mean(stroke, &stroke->rest_q15);
    call_still(stroke, before);
}

void stroke_state(struct stroke *stroke) {
    struct stroke_sigma *path = &stroke->path_sigma;
    if (stroke->end > STROKE_END_BUTTON) {
        return;  // without a length
    }
    stroke_find_sigma(stroke);
    if (stroke->phase == STROKE_RESTS) {
        path->horizontal = root_of_sum(path->horizontal, stroke->sigma.horizontal);
        path->vertical = root_of_sum(path->vertical, stroke->sigma.vertical);
    }
}

// The window that is no longer held back is one of the rest already, at which the
// stroke has ended.
static bool ends_before(struct stroke *stroke, const struct stroke_window *window,
                        const struct stroke_force *before) {
    const bool may_end =
        stroke->is_by_button
            ? !stroke->is_held && stroke->countdown == 1 && !is_unstill(stroke)
            : has_come_to_rest(stroke, before);
    struct vector rest;
    stroke_late_mean(stroke, &rest);
    return may_end && stroke->windows > 0 && is_calm(stroke, before, &rest) &&
           stroke_find_closed(stroke, window, before);
}

static void move(struct stroke *stroke, const struct stroke_window *window,
                 const struct stroke_force *before) {
    struct vector apart;
    if (ends_before(stroke, window, before)) {
        finish(stroke, before);
        return;
    }
    vector_subtract(&before->mean_q15, &stroke->rest_q15, &apart);
    stroke_add(stroke, before, &stroke->velocity, &stroke->twice_way);
    ++stroke->windows;
    if (vector_exceeds(&apart, FORCE_LIMIT_Q15) ||
        vector_exceeds(&stroke->velocity, SPEED_LIMIT_Q15) ||
        vector_exceeds(&stroke->twice_way, WAY_LIMIT_Q15)) {
        lose(stroke, STROKE_END_TOO_FAST);
        return;
    }
    if (stroke->is_by_button && !stroke->is_held) {
        --stroke->countdown;
        if (stroke->countdown == 0) {
            if (is_unstill(stroke) ||
                !stroke_find_closed(stroke, window, stroke->late)) {
                lose(stroke, STROKE_END_MOVING);
            } else {
                finish(stroke, before);
            }
            return;
        }
    } else if (!stroke->is_by_button && has_come_to_rest(stroke, before) &&
               stroke_find_closed(stroke, window, stroke->late)) {
        finish(stroke, before);
        return;
    }
    if (stroke->windows == STROKE_WINDOWS_MAX) {
        lose(stroke, STROKE_END_TOO_LONG);
        return;
    }
    stroke_find_open(stroke, window);
}

// A stroke begins with the window that is no longer held back, if there is a rest
// before it.
static void start_after_rest(struct stroke *stroke, const struct stroke_window *window,
                             const struct stroke_force *before) {
    start(stroke, window);
    if (stroke->settled < SETTLED_ENOUGH) {
        lose(stroke, STROKE_END_MOVING);
        return;
    }
    move(stroke, window, before);
}

static void average(uint32_t *mean, uint32_t next, uint8_t count) {
    *mean += (uint32_t)((int32_t)(next - *mean) / count);
}

// At rest, as far as is known; `turn_q30`: of the window that is no longer held back.
// True where there is something to tell.
static bool wait(struct stroke *stroke, const struct stroke_window *window,
                 const struct stroke_force *before, uint32_t turn_q30) {
    const bool is_pressed =
        stroke->countdown > 0 && --stroke->countdown <= CALM_WINDOWS &&
        (stroke->countdown == 0 || !is_calm(stroke, before, &stroke->rest_q15));
    const bool has_moved_now = stroke->settled > 0 && has_moved(stroke, window);
    if (stroke->is_by_button ? is_pressed : has_moved_now) {
        start_after_rest(stroke, window, before);
        return true;
    }
    take_rest(stroke, before);
    average(&stroke->sway_q30, turn_q30, 8);
    average(&stroke->began_q30, turn_q30, STROKE_LATE);
    if (stroke->settled == 1) {
        stroke->is_placed = false;
    }
    return false;
}

static void hold_back(struct stroke *stroke, const struct stroke_window *window) {
    stroke->late[0] = stroke->late[1];
    stroke->late[1] = stroke->late[2];
    stroke->late[2] = window->force;
    stroke->late_turn_q30[0] = stroke->late_turn_q30[1];
    stroke->late_turn_q30[1] = stroke->late_turn_q30[2];
    stroke->late_turn_q30[2] = stroke_square(&window->turn_q15);
    if (vector_exceeds(&window->turn_q15, TURN_LIMIT_Q15)) {
        stroke->steady = 0;
    } else if (stroke->steady < STEADY) {
        ++stroke->steady;
    }
}

bool stroke_step(struct stroke *stroke, const struct stroke_window *window) {
    const struct stroke_force before = stroke->late[0];
    const uint32_t turn_q30 = stroke->late_turn_q30[0];
    const bool was_moving = stroke->phase == STROKE_MOVES;
    hold_back(stroke, window);
    if (window->fault != STROKE_END_RUNNING) {
        stroke->filled = 0;
        if (!was_moving && stroke->countdown > 0 && --stroke->countdown == 0) {
            stroke_refuse(stroke, window->fault == STROKE_END_LOST ? STROKE_END_NO_REST
                                                                   : window->fault);
            return true;
        }
        lose(stroke, window->fault);
        return was_moving;
    }
    if (stroke->is_near) {
        stroke->countdown = stroke->is_held ? PRESS_WINDOWS + CALM_WINDOWS : 0;
        lose(stroke, STROKE_END_TOO_NEAR);
        return true;
    }
    if (stroke->filled < STROKE_LATE) {
        ++stroke->filled;
        return false;
    }
    if (was_moving) {
        move(stroke, window, &before);
        return true;
    }
    if (stroke->phase == STROKE_LOST) {
        if (!stroke->is_by_button && !rests(stroke, &before)) {
            return false;
        }
        stroke->phase = STROKE_RESTS;
    }
    return wait(stroke, window, &before, turn_q30);
}

bool stroke_position(const struct stroke *stroke, q2_30_t since, struct vector *out) {
    if (!stroke->is_placed) {
        return false;
    }
    *out = stroke->path_um;
    if (stroke->phase == STROKE_MOVES) {
        for (uint8_t axis = 0; axis < 3; ++axis) {
            out->axis[axis] += stroke->moved_um.axis[axis] +
                               fixed_mul_q30(stroke->speed_um.axis[axis], since);
        }
    }
    return true;
}
