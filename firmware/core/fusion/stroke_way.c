// SPDX-License-Identifier: MIT
// The closed form, and what is known of its error; see stroke_way.h.
//
// Errors are those of: the sensor's noise in a window, white, as the quietest rests
// have it; what the end shows of a tilt that grew; the walk of the gyroscope; what a
// module's scales and axes do in a turn, and its scale and bias with the way; how a
// hand moves at both ends.
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
// Sigmas of a module that is not calibrated, as params' records have them: 0.2 m/s2 and
// 1.15 % of scale and axes.
#define RAW_ACC_SIGMA 2000
#define RAW_GYR_SIGMA 1150
// Eight times the square of the force, (m/s2)^2 q2_30, that a turn of 1 rad brings by
// the square of such a sigma: the accelerometer's s_a in the level, s_a^2 5 / 4 up; the
// gyroscope's g s_g in the level. 1 - w of the turn is an eighth of its square.
#define ACC_TURN ROUNDED(8 * 1e-8 * 1073741824)
#define GYR_TURN ROUNDED(8 * 1e-10 * SQUARE(GRAVITY_M_S2) * 1073741824)
// s_a / g of lengths, um to 1e-5 m, and at least 0.05 deg of the direction of a rest,
// which is a mean of four windows.
#define ACC_SHARE ROUNDED(1e-4 / GRAVITY_M_S2 / 10 * 1073741824)
#define LEAN_MIN_Q30 Q_RAD(0.05 / 10, 30)
// Of the noise of one axis of a window: that of the difference of two rests.
#define REST_SHARE_Q30 Q30((0.375 + 0.15) / 3)
// Sums of white noise in 1e-5 m.
#define NOISE_GAIN_Q32 Q32_UNSIGNED(1e-4 / (3 * 12 * 1e-10 * 1073741824))
// A tilt that grew, the same.
#define TILT_GAIN_Q32 Q32_UNSIGNED(1e-4 / (144 * 1e-10 * 1073741824))
// A hand at rest moves as it turns: by 0.30 m times its rate, an axis, at both ends
// (real hands at rest: 0.09 to 0.28 m, correlation 0.86), which no window shows. Half
// the square of that speed times 0.1 s, 1e-5 m, by the square rate of three axes.
#define HAND_M 0.30
#define HAND_GAIN_Q32                                                                  \
    Q32_UNSIGNED(SQUARE(HAND_M *STROKE_WINDOW_S) / 6 * 1e10 / 1073741824)
// A gyroscope's walk of 5 mdps/rtHz tilts by a force whose second integral has the
// variance g^2 q T^5 / 720, q half the square of its density; six times that where the
// end shows nothing of it. As many windows to the power of 5 are 1 (1e-5 m)^2.
#define WALK_SHARE UINT32_C(19690)
// m/s2 q15 to q2_30 of a right angle's sine; and what a rest may lean, 5 deg.
#define PER_GRAVITY_Q15 ROUNDED(32768 / GRAVITY_M_S2)
#define LEAN_MAX_Q15 Q15(0.85)
#define DELTA_FREE_Q30 ((uint32_t)Q30(SQUARE(0.005)))  // (m/s2)^2
#define FLOOR_SQUARE UINT32_C(100)                     // (0.1 mm)^2
// Of the square of a window's noise, (m/s2)^2: the least that gates and errors are made
// of. Between rests the gates are wider, since what they miss or find is a whole
// stroke.
#define NOISE_BUTTON_Q30 ((uint32_t)Q30(SQUARE(0.005)))
#define NOISE_RESTS_Q30 ((uint32_t)Q30(SQUARE(0.01)))
#define SQUARE_MAX UINT32_C(1000000000)

// Variances of what a tilt that grows adds to the force until the end, (m/s2)^2 q2_30.
struct tilts {
    uint32_t level, up;
};

uint32_t stroke_noise(const struct stroke *stroke) {
    const uint32_t least = stroke->is_by_button ? NOISE_BUTTON_Q30 : NOISE_RESTS_Q30;
    return stroke->noise_q30 > least ? stroke->noise_q30 : least;
}

void stroke_take_errors(struct stroke *stroke, uint16_t acc_sigma, uint16_t gyr_sigma) {
    const int32_t acc = acc_sigma < RAW_ACC_SIGMA ? acc_sigma : RAW_ACC_SIGMA;
    const int32_t gyr = gyr_sigma < RAW_GYR_SIGMA ? gyr_sigma : RAW_GYR_SIGMA;
    const q2_30_t turn = acc * acc * ACC_TURN;
    const q2_30_t share = acc * ACC_SHARE;
    stroke->errors = (struct stroke_errors){
        .turn_level = turn + gyr * gyr * GYR_TURN,
        .turn_up = turn + turn / 4,
        .scale = share,
        .lean = share > LEAN_MIN_Q30 ? share : LEAN_MIN_Q30,
    };
}

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

// By how much the force at rest leans from the filter's vertical, which the stroke may
// have moved, to the east and north.
struct lean {
    q2_30_t x, y;
};

static struct lean lean_of(const struct stroke *stroke,
                           const struct stroke_window *window) {
    struct vector rest;
    quat_rotate(window->world_from_inertial, &stroke->rest_q15, &rest);
    return (struct lean){
        .x = fixed_clamp(rest.x, LEAN_MAX_Q15) * PER_GRAVITY_Q15,
        .y = fixed_clamp(rest.y, LEAN_MAX_Q15) * PER_GRAVITY_Q15,
    };
}

// To the world, whose vertical is that of the force at rest. It leans by so little that
// the rotation is linear.
static void to_world(const struct stroke_window *window, const struct lean *lean,
                     q2_30_t gain, struct vector *v) {
    vector_scale(v, gain, v);
    quat_rotate(window->world_from_inertial, v, v);
    const int32_t up = v->z;
    v->z += fixed_mul_q30(v->x, lean->x) + fixed_mul_q30(v->y, lean->y);
    v->x -= fixed_mul_q30(up, lean->x);
    v->y -= fixed_mul_q30(up, lean->y);
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
    const struct stroke_errors *errors = &stroke->errors;
    return (struct tilts){
        .level = bias_tilt(stroke, window) * windows * windows +
                 (uint32_t)fixed_mul_q30(miss, errors->turn_level),
        .up = (uint32_t)fixed_mul_q30(miss, errors->turn_up),
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

// Mean square rate of the rests at both ends, (rad/s)^2 q2_30, three axes: at least
// that of rests in general. While it moves, of the first one.
static uint32_t hand_turn(const struct stroke *stroke, bool is_open) {
    uint32_t mean = stroke->began_q30;
    if (!is_open) {
        mean /= 2;
        for (uint8_t i = 0; i < STROKE_LATE; ++i) {
            mean += stroke->late_turn_q30[i] / (2 * STROKE_LATE);
        }
    }
    return mean > stroke->sway_q30 ? mean : stroke->sway_q30;
}

static uint32_t square_of_length(int32_t length_um, q2_30_t share) {
    const uint32_t error = fixed_magnitude(fixed_mul_q30(length_um, share));
    return error > 20000 ? SQUARE_MAX / 2 : error * error;
}

// Of what the end shows of a tilt it shows `kept`.
static uint32_t walk_square(uint8_t windows, q2_30_t kept) {
    const uint32_t square = (uint32_t)windows * windows;
    const uint32_t walk = square * square * windows / WALK_SHARE;
    return walk * 6 - (uint32_t)fixed_mul_q30((int32_t)(walk * 5), kept);
}

// Where the end is not known, noise has four times the variance, and a speed at the
// start twice.
void stroke_find_sigma(struct stroke *stroke) {
    const bool is_open = stroke->tilt.is_open;
    const uint8_t windows = (uint8_t)(stroke->windows + (is_open ? STROKE_LATE : 0));
    const struct vector *way = &stroke->moved_um;
    const struct stroke_errors *errors = &stroke->errors;
    const uint32_t quiet =
        stroke->quiet_q30 < stroke->noise_q30 ? stroke->quiet_q30 : stroke->noise_q30;
    // The least of many means of 16 windows is low by a fifth.
    const uint32_t noise =
        square_of(quiet + quiet / 4, NOISE_GAIN_Q32 * windows, windows);
    const uint32_t hand = square_of(hand_turn(stroke, is_open), HAND_GAIN_Q32, windows);
    uint32_t all = add_held(is_open ? noise * 4 : noise, FLOOR_SQUARE);
    all = add_held(all, is_open ? hand * 2 : hand);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        all = add_held(all, square_of_length(way->axis[axis], errors->scale));
    }
    uint32_t tipped = square_of_length(way->z, errors->lean);
    stroke->sigma.horizontal =
        fixed_sqrt(add_held(add_held(all, stroke->tilt.level), tipped));
    tipped = add_held(square_of_length(way->x, errors->lean),
                      square_of_length(way->y, errors->lean));
    stroke->sigma.vertical =
        fixed_sqrt(add_held(add_held(all, stroke->tilt.up), tipped));
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
    const struct lean lean = lean_of(stroke, window);
    to_world(window, &lean, gain, &way);
    to_world(window, &lean, gain, &velocity);
    stroke->moved_um = way;
    stroke->speed_um = velocity;
    const struct tilts tilts = tilts_of(stroke, windows, window);
    const uint32_t pairs = (uint32_t)windows * windows;
    // What grew, integrated twice without an end condition.
    stroke->tilt = (struct stroke_tilt){
        .level = square_of(tilts.level, TILT_GAIN_Q32 * 4, pairs),
        .up = square_of(tilts.up, TILT_GAIN_Q32 * 4, pairs),
        .is_open = true,
    };
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
        (uint32_t)fixed_mul_q30((int32_t)stroke_noise(stroke), REST_SHARE_Q30);
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
    const struct lean lean = lean_of(stroke, window);
    to_world(window, &lean, gain, &way);
    to_world(window, &lean, gain, &delta);
    way.x += fixed_mul_q30(delta.x, level);
    way.y += fixed_mul_q30(delta.y, level);
    way.z += fixed_mul_q30(delta.z, up);
    stroke->moved_um = way;
    // What a turn brings does not grow evenly: three tenths of it remain.
    const uint32_t uneven = (stroke->delta_noise_q30 - rest) / 11;
    const uint32_t tilt = (uint32_t)fixed_mul_q30(level, (int32_t)rest) + uneven;
    const uint32_t tilt_up = (uint32_t)fixed_mul_q30(up, (int32_t)rest) + tilts.up / 14;
    stroke->tilt = (struct stroke_tilt){
        .level = square_of(tilt, TILT_GAIN_Q32, pairs) + walk_square(windows, level),
        .up = square_of(tilt_up, TILT_GAIN_Q32, pairs),
        .is_open = false,
    };
    return true;
}
