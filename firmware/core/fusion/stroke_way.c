// SPDX-License-Identifier: MIT
// The closed form, and what is known of its error; see stroke_way.h.
//
// Errors are those of: the noise of a window, white, as the rests have it; what the end
// shows of a tilt that grew; what a module's scales and axes do in a turn; the level.
#include "core/fusion/stroke_way.h"

// m/s2 q15, summed twice over windows, to um. A window has as many microseconds as the
// samples say.
#define WAY_GAIN_Q30 Q15(1e6 * SQUARE(STROKE_WINDOW_S) / 2)
#define WINDOW_US UINT32_C(100000)
// (g * 0.25 deg/s * 0.1 s)^2, by which a gyroscope's bias tilts in a window, from its
// variance; at least that of 0.01 deg/s. A quarter by the button: what the filter
// allows a bias is for minutes, and from one rest to the next half of its sigma is
// enough. Without it a slow stroke may have looked like a rest to the filter.
#define BIAS_TILT_Q30 Q_RAD2(512 * SQUARE(GRAVITY_M_S2 * 0.25 * STROKE_WINDOW_S), 30)
#define BY_BUTTON_SHARE 4
#define BIAS_VARIANCE_MIN Q21(SQUARE(0.01 * 4))
// What a hand turns at rest is in the bias that the filter finds there: a fifth of its
// rate, at most 0.03 deg/s, whose variance is 4/3 of this.
#define SWAY_MAX_Q30 ((uint32_t)Q30(2.109e-5))
// Eight times the square of the force that a turn of 1 rad brings, (m/s2)^2 q2_30:
// g^2 (s^2 + a^2 + b^2) in the level and g^2 ((s / 2)^2 + b^2) up, for errors s of the
// scales, a of the angles between axes and b of the bias, g. They are 0.05 %, 0.05 deg
// and 1 mg of a calibrated module, 1 %, 0.5 deg and 20 mg of another. 1 - w of the turn
// is an eighth of its square. tests/core/test_constant.py computes them within 0.3 %.
#define TURN_LEVEL_Q30 Q30(0.001547)
#define TURN_UP_Q30 Q30(0.0008177)
#define RAW_TURN_LEVEL_Q30 Q30(0.4424)
#define RAW_TURN_UP_Q30 Q30(0.326)
// Of the noise of one axis of a window: that of the difference of two rests.
#define REST_SHARE_Q30 Q30((0.375 + 0.15) / 3)
// Sums of white noise in 1e-5 m.
#define NOISE_GAIN_Q32 Q32_UNSIGNED(1e-4 / (3 * 12 * 1e-10 * 1073741824))
// A tilt that grew, the same.
#define TILT_GAIN_Q32 Q32_UNSIGNED(1e-4 / (144 * 1e-10 * 1073741824))
// Of lengths, um to 1e-5 m: 0.4 deg of level, and the scale of the module.
#define LEVEL_ERROR_Q30 Q_RAD(0.4 / 10, 30)
#define SCALE_ERROR_Q30 Q30(0.001 / 10)
#define RAW_SCALE_ERROR_Q30 Q30(0.01 / 10)
#define DELTA_FREE_Q30 ((uint32_t)Q30(SQUARE(0.005)))  // (m/s2)^2
#define FLOOR_SQUARE UINT32_C(900)                     // (0.3 mm)^2
#define SQUARE_MAX UINT32_C(1000000000)

// Variances of what a tilt that grows adds to the force until the end, (m/s2)^2 q2_30.
struct tilts {
    uint32_t level, up;
};

void stroke_add(const struct stroke *stroke, const struct stroke_force *force,
                struct vector *velocity, struct vector *twice_way) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t rest = stroke->rest_q15.axis[axis];
        twice_way->axis[axis] +=
            2 * velocity->axis[axis] + force->gained_q15.axis[axis] - rest;
        velocity->axis[axis] += force->mean_q15.axis[axis] - rest;
    }
}

uint32_t stroke_square(const struct vector *v_q15) {
    struct vector v;
    uint32_t sum = 0;
    vector_clamp(v_q15, INT32_C(16384), &v);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        sum += (uint32_t)(v.axis[axis] * v.axis[axis]);
    }
    return sum;
}

// The factor from sums to um. `windows`: that were taken or left out since the start.
static q2_30_t gain_of(const struct stroke *stroke, uint8_t windows, uint32_t now_us) {
    const uint32_t nominal_us = (windows - 1u) * WINDOW_US;
    const uint32_t elapsed_us = now_us - stroke->start_us;
    q2_30_t ratio = Q2_30_ONE;
    // A clock is never off by a quarter.
    if (elapsed_us > nominal_us - nominal_us / 4 &&
        elapsed_us < nominal_us + nominal_us / 4) {
        ratio = fixed_ratio(elapsed_us, nominal_us);
    }
    return fixed_mul_q30(fixed_mul_q30(ratio, WAY_GAIN_Q30), ratio);
}

static void to_world(const struct stroke_window *window, q2_30_t gain,
                     struct vector *v) {
    vector_scale(v, gain, v);
    quat_rotate(window->world_from_inertial, v, v);
}

static uint32_t bias_tilt(const struct stroke *stroke,
                          const struct stroke_window *window) {
    const uint32_t sway =
        stroke->sway_q30 < SWAY_MAX_Q30 ? stroke->sway_q30 : SWAY_MAX_Q30;
    int32_t variance = (int32_t)(sway * 4 / 3);
    if (variance < window->bias_variance) {
        variance = window->bias_variance;
    }
    if (variance < BIAS_VARIANCE_MIN) {
        variance = BIAS_VARIANCE_MIN;
    }
    const int32_t tilt = fixed_mul_q30(variance, BIAS_TILT_Q30);
    return (uint32_t)(stroke->is_by_button ? tilt / BY_BUTTON_SHARE : tilt);
}

static struct tilts tilts_of(const struct stroke *stroke, uint8_t windows,
                             const struct stroke_window *window) {
    const int32_t *q = &window->inertial_from_body->w;
    int32_t w = 0;
    for (uint8_t i = 0; i < 4; ++i) {
        w += fixed_mul_q30(q[i], stroke->start_q14[i] * INT32_C(65536));
    }
    const int32_t turned = Q2_30_ONE - (int32_t)fixed_magnitude(w);
    const int32_t miss = turned > 0 ? turned : 0;
    const bool is_raw = !stroke->is_calibrated;
    const int32_t level = is_raw ? RAW_TURN_LEVEL_Q30 : TURN_LEVEL_Q30;
    const int32_t up = is_raw ? RAW_TURN_UP_Q30 : TURN_UP_Q30;
    return (struct tilts){
        .level = bias_tilt(stroke, window) * windows * windows +
                 (uint32_t)fixed_mul_q30(miss, level),
        .up = (uint32_t)fixed_mul_q30(miss, up),
    };
}

// (gain * force_square * pairs^2) / 2^32, in (1e-5 m)^2, held at SQUARE_MAX.
static uint32_t square_of(uint32_t force_square, uint32_t gain, uint32_t pairs) {
    const uint32_t part = fixed_umul_q32(force_square, gain * pairs);
    return part > SQUARE_MAX / pairs ? SQUARE_MAX : part * pairs;
}

static uint32_t add_held(uint32_t a, uint32_t b) {
    return a + b > SQUARE_MAX ? SQUARE_MAX : a + b;
}

static uint32_t square_of_length(int32_t length_um, q2_30_t share) {
    const uint32_t error = fixed_magnitude(fixed_mul_q30(length_um, share));
    return error > 20000 ? SQUARE_MAX / 2 : error * error;
}

// `noise` and `level`, `up`: of the sums and of the tilt, (1e-5 m)^2.
static void state_sigma(struct stroke *stroke, uint32_t noise, uint32_t level,
                        uint32_t up) {
    const struct vector *way = &stroke->moved_um;
    const q2_30_t scale = stroke->is_calibrated ? SCALE_ERROR_Q30 : RAW_SCALE_ERROR_Q30;
    uint32_t all = add_held(noise, FLOOR_SQUARE);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        all = add_held(all, square_of_length(way->axis[axis], scale));
    }
    uint32_t tipped = square_of_length(way->z, LEVEL_ERROR_Q30);
    stroke->sigma.horizontal = fixed_sqrt(add_held(add_held(all, level), tipped));
    tipped = add_held(square_of_length(way->x, LEVEL_ERROR_Q30),
                      square_of_length(way->y, LEVEL_ERROR_Q30));
    stroke->sigma.vertical = fixed_sqrt(add_held(add_held(all, up), tipped));
}

void stroke_find_open(struct stroke *stroke, const struct stroke_window *window) {
    const uint8_t windows = (uint8_t)(stroke->windows + STROKE_LATE);
    const q2_30_t gain = gain_of(stroke, stroke->windows, window->time_us);
    struct vector velocity = stroke->velocity;
    struct vector way = stroke->twice_way;
    for (uint8_t i = 0; i < STROKE_LATE; ++i) {
        stroke_add(stroke, &stroke->late[i], &velocity, &way);
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        velocity.axis[axis] *= 2;
    }
    to_world(window, gain, &way);
    to_world(window, gain, &velocity);
    stroke->moved_um = way;
    stroke->speed_um = velocity;
    const struct tilts tilts = tilts_of(stroke, windows, window);
    const uint32_t pairs = (uint32_t)windows * windows;
    // Integrated twice, without an end condition: 4 times the noise's square, and 4
    // times that of what grew.
    const uint32_t noise =
        square_of(stroke->noise_q30, NOISE_GAIN_Q32 * windows, windows) * 4;
    state_sigma(stroke, noise, square_of(tilts.level, TILT_GAIN_Q32 * 4, pairs),
                square_of(tilts.up, TILT_GAIN_Q32 * 4, pairs));
}

void stroke_late_mean(const struct stroke *stroke, struct vector *out) {
    const struct stroke_force *late = stroke->late;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] =
            (late[0].mean_q15.axis[axis] + 2 * late[1].mean_q15.axis[axis] +
             late[2].mean_q15.axis[axis]) /
            4;
    }
}

// The mean force of the rest that is held back, less that before the stroke.
static void find_delta(const struct stroke *stroke, struct vector *delta) {
    stroke_late_mean(stroke, delta);
    vector_subtract(delta, &stroke->rest_q15, delta);
}

bool stroke_find_closed(struct stroke *stroke, const struct stroke_window *window,
                        const struct stroke_force *first) {
    const uint8_t windows = stroke->windows;
    const uint8_t left_out = first == stroke->late ? 0 : 1;
    const q2_30_t gain =
        gain_of(stroke, (uint8_t)(windows + left_out), window->time_us);
    const uint32_t pairs = (windows + 1u) * (windows + 2u);
    const struct tilts tilts = tilts_of(stroke, windows, window);
    const uint32_t rest =
        (uint32_t)fixed_mul_q30((int32_t)stroke->noise_q30, REST_SHARE_Q30);
    const q2_30_t level = fixed_ratio(tilts.level, tilts.level + rest);
    const q2_30_t up = fixed_ratio(tilts.up, tilts.up + rest);
    struct vector way;
    struct vector delta;
    find_delta(stroke, &delta);
    stroke->delta_q15 = delta;
    stroke->delta_noise_q30 =
        rest + tilts.level - bias_tilt(stroke, window) * windows * windows;
    // Between a rest and a motion it is far more than noise and tilt explain.
    if (stroke_square(&delta) / 32 > tilts.level + tilts.up + rest + DELTA_FREE_Q30) {
        return false;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        // The mean velocity over the first window of the rest, which is none but for
        // what grew.
        const int32_t end =
            stroke->velocity.axis[axis] +
            (first->gained_q15.axis[axis] - stroke->rest_q15.axis[axis]) / 2;
        const int32_t grown =
            fixed_mul_q30(delta.axis[axis], level) * (windows + 1) / 2;
        if (fixed_magnitude(end - grown) >
            STROKE_STOP_Q15 + STROKE_STOP_STEP_Q15 * windows) {
            return false;
        }
        way.axis[axis] = stroke->twice_way.axis[axis] - windows * end;
        delta.axis[axis] = delta.axis[axis] * (int32_t)pairs / 6;
    }
    to_world(window, gain, &way);
    to_world(window, gain, &delta);
    way.x += fixed_mul_q30(delta.x, level);
    way.y += fixed_mul_q30(delta.y, level);
    way.z += fixed_mul_q30(delta.z, up);
    stroke->moved_um = way;
    const uint32_t noise =
        square_of(stroke->noise_q30, NOISE_GAIN_Q32 * windows, windows);
    // What a turn brings does not grow evenly: three tenths of it remain.
    const uint32_t uneven = (stroke->delta_noise_q30 - rest) / 11;
    const uint32_t tilt = (uint32_t)fixed_mul_q30(level, (int32_t)rest) + uneven;
    state_sigma(
        stroke, noise, square_of(tilt, TILT_GAIN_Q32, pairs),
        square_of((uint32_t)fixed_mul_q30(up, (int32_t)rest), TILT_GAIN_Q32, pairs));
    return true;
}
