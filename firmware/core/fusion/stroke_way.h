// SPDX-License-Identifier: MIT
// From the sums of a stroke to its way and the sigmas of it. Private to the strokes.
#ifndef STROKE_WAY_H
#define STROKE_WAY_H

#include "core/fusion/stroke.h"
#include "core/math/constant.h"

#define STROKE_WINDOW_S 0.1  // the filter's window

// A velocity in m/s as a sum of force over windows, and a way in m as twice such a sum.
#define STROKE_SPEED_Q15(speed) Q15((speed) / STROKE_WINDOW_S)
#define STROKE_WAY_Q15(way) Q15(2 * (way) / SQUARE(STROKE_WINDOW_S))

// Limit of the velocity at an end, plus an amount for each window of a stroke.
#define STROKE_STOP_Q15 ((uint32_t)STROKE_SPEED_Q15(0.03))
#define STROKE_STOP_STEP_Q15 ((uint32_t)STROKE_SPEED_Q15(0.003))

// |v|^2 as q2_30 of v in q15, whose numbers are held within +-0.5.
uint32_t stroke_square(const struct vector *v_q15);

// The square of a window's noise that gates and errors are made of.
uint32_t stroke_noise(const struct stroke *stroke);

// What these sigmas of the params' records do to strokes.
void stroke_take_errors(struct stroke *stroke, uint16_t acc_sigma, uint16_t gyr_sigma);

// Takes the force of a window, less that of the rest, into the sums.
void stroke_add(const struct stroke *stroke, const struct stroke_force *force,
                struct vector *velocity, struct vector *twice_way);

// The mean force of the windows that are held back, the middle one as heavy as the
// others together.
void stroke_late_mean(const struct stroke *stroke, struct vector *out);

// Where it is while it moves, those windows included that are held back.
void stroke_find_open(struct stroke *stroke, const struct stroke_window *window);

// Its whole way, ended by a rest, whose windows are held back: `first` is the first of
// them, or the window before, which is then none of the stroke's. False where it did
// not end at rest, or did not begin so.
bool stroke_find_closed(struct stroke *stroke, const struct stroke_window *window,
                        const struct stroke_force *first);

// Its errors, of what either of these has found.
void stroke_find_sigma(struct stroke *stroke);

#endif
