// SPDX-License-Identifier: MIT
// See fuse_twin.h. Written from the equations, with libm's functions throughout.
#include "fuse_twin.h"

#include <math.h>
#include <string.h>

#include "fuse_twin_parts.h"

#define LOOK_S (2 * FUSE_WINDOW_S)  // of an axis, at what levelling corrects

static void follow_gravity(struct twin *t) {
    double up[3];
    twin_rotate(t->level, t->force.level, up);
    const double norm = sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]);
    t->tilting[0] = t->tilting[1] = 0;
    if (norm < FUSE_FORCE_MIN_M_S2) {
        return;
    }
    t->tilting[0] = up[1] / norm / FUSE_WINDOW_S;
    t->tilting[1] = -up[0] / norm / FUSE_WINDOW_S;
    double turn[4] = {1 + up[2] / norm, up[1] / norm, -up[0] / norm, 0};
    if (up[0] == 0 && up[1] == 0 && up[2] < 0) {
        turn[1] = 1;
    }
    twin_multiply(turn, t->level, t->level);
}

void twin_read_motion(struct twin *t, const double *row, double noise, double unit,
                      double surprise) {
    static const double units[STATES] = {0.25, 0.25, 0.25, 1, 1, 1, 4};
    double gain[STATES];
    twin_kalman(STATES, t->motion, row, noise, units, unit, gain);
    for (int i = 0; i < 3; ++i) {
        t->bias[i] =
            twin_clamp(t->bias[i] + gain[BIAS + i] * surprise, FUSE_BIAS_MAX_RAD_S);
        t->scale[i] = twin_clamp(
            t->scale[i] + gain[SCALE + i] * surprise / DEGREE / 500, FUSE_SCALE_MAX);
    }
}

// The rate, rad/s, by which bias and scales that are as estimated turn the level frame.
static double effect(const struct twin *t, const double *bias_row,
                     const double *scale_row) {
    double sum = 0;
    for (int i = 0; i < 3; ++i) {
        sum += bias_row[i] * t->bias[i] + scale_row[i] * t->scale[i] * 500 * DEGREE;
    }
    return sum;
}

// The surprise of levelling is that of an error that has always been there: what was
// estimated at the time of each correction has been taken off it.
static void stage_motion(struct twin *t, int axis, bool is_resting) {
    const double *bias_row = t->bias_row[axis].level;
    const double *scale_row = t->scale_row[axis].level;
    if (t->windows <= FUSE_WINDOWS(FUSE_LEVEL_TAU_S)) {
        return;
    }
    const double surprise = twin_clamp(t->tilting[axis] + t->used[axis].level[0] -
                                           effect(t, bias_row, scale_row),
                                       FUSE_TILTING_MAX_DPS * DEGREE);
    t->drift[axis] += (surprise - t->drift[axis]) * LOOK_S / FUSE_DRIFT_TAU_S;
    if (axis == 1) {
        const double square = (pow(t->drift[0], 2) + pow(t->drift[1], 2)) / 2;
        t->drift_square +=
            (square - t->drift_square) * LOOK_S / FUSE_DRIFT_SQUARE_TAU_S;
    }
    if (!is_resting) {
        const double row[STATES] = {bias_row[0],  bias_row[1],  bias_row[2],
                                    scale_row[0], scale_row[1], scale_row[2]};
        const double drift =
            fmin(t->drift_square / DEGREE / DEGREE, FUSE_MOTION_DRIFT_MAX_DPS2);
        twin_read_motion(
            t, row, (FUSE_MOTION_NOISE_DPS2_S + FUSE_MOTION_DRIFT_S * drift) / LOOK_S,
            1, surprise);
    }
}

// The uncertainty that a window adds to bias, scales and heading. `up` is the part of
// each state in the rate about the vertical.
static void predict_motion(struct twin *t, const double *up) {
    double *heading = t->motion + STATES * HEADING;
    double before = 0;
    double after = 0;
    for (int i = 0; i < 3; ++i) {
        double *bias = &t->motion[(STATES + 1) * (BIAS + i)];
        double *scale = &t->motion[(STATES + 1) * (SCALE + i)];
        const double wander =
            FUSE_BIAS_WANDER_DPS2_S +
            FUSE_WARMING_DPS2_S * exp(-t->age * FUSE_WINDOW_S / FUSE_WARMING_TAU_S);
        *bias = fmin(*bias + FUSE_PER_WINDOW(wander), pow(FUSE_BIAS_SIGMA_DPS, 2));
        *scale = fmin(*scale + FUSE_PER_WINDOW(FUSE_SCALE_WANDER_S) * 500 * 500,
                      pow(500 * FUSE_SCALE_SIGMA, 2));
    }
    for (int i = 0; i < HEADING; ++i) {
        double product = 0;
        for (int j = 0; j < HEADING; ++j) {
            product += t->motion[STATES * i + j] * up[j];
        }
        before += up[i] * heading[i];
        heading[i] += FUSE_PER_WINDOW(product);
        t->motion[STATES * i + HEADING] = heading[i];
        after += up[i] * heading[i];
    }
    const double most = pow(FUSE_TURNED_SIGMA_MAX_DEG, 2);
    const double growth = fmax(0, FUSE_PER_WINDOW(before + after));
    t->turned = fmin(FUSE_TURNED_STEP_MAX_DEG2, growth);
    if (heading[HEADING] + growth > most) {
        for (int i = 0; i < HEADING; ++i) {
            t->motion[STATES * i + HEADING] = heading[i] = 0;
        }
    }
    heading[HEADING] = fmin(heading[HEADING] + growth, most);
}

// How errors of bias and scale turn the level frame, about its x and y and about the
// vertical.
static void find_regressors(struct twin *t, int window) {
    double attitude[4];
    double turn[3][3];
    double up[HEADING];
    twin_multiply(t->level, t->inertial, attitude);
    twin_matrix_of(attitude, t->rows);
    memset(t->slope, 0, sizeof t->slope);
    for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 3; ++i) {
            turn[j][i] = t->turn_sum[j][i] / window / DEGREE / 500;
            t->turn_sum[j][i] = 0;
        }
        twin_rotate(t->level, turn[j], turn[j]);
        for (int i = 0; i < 3; ++i) {
            t->slope[i] += turn[j][i] * 500 * DEGREE;
            turn[j][i] = twin_clamp(turn[j][i], FUSE_TURN_MAX);
        }
        up[BIAS + j] = t->rows[2][j];
        up[SCALE + j] = -turn[j][2];
    }
    for (int i = 0; i < 2; ++i) {
        double bias_row[3];
        double scale_row[3];
        for (int j = 0; j < 3; ++j) {
            bias_row[j] = -t->rows[i][j];
            scale_row[j] = turn[j][i];
        }
        const double used = effect(t, bias_row, scale_row);
        twin_lowpass(&t->bias_row[i], FUSE_WINDOW_S, FUSE_LEVEL_TAU_S, bias_row, 3,
                     t->windows);
        twin_lowpass(&t->scale_row[i], FUSE_WINDOW_S, FUSE_LEVEL_TAU_S, scale_row, 3,
                     t->windows);
        twin_lowpass(&t->used[i], FUSE_WINDOW_S, FUSE_LEVEL_TAU_S, &used, 1,
                     t->windows);
    }
    predict_motion(t, up);
}

// The bias that a calibration at rest found has turned the inertial frame until then.
static void begin_again(struct twin *t) {
    memset(&t->force, 0, sizeof t->force);
    for (int i = 0; i < 2; ++i) {
        memset(&t->bias_row[i], 0, sizeof t->bias_row[i]);
        memset(&t->scale_row[i], 0, sizeof t->scale_row[i]);
        memset(&t->used[i], 0, sizeof t->used[i]);
    }
    t->windows = t->learnt = 0;
    t->heading_variance = INFINITY;
}

// The bias is known this well, whatever else is known.
static void know_bias(struct twin *t, double sigma_dps) {
    for (int i = 0; i < STATES; ++i) {
        for (int j = 0; j < 3; ++j) {
            t->motion[STATES * i + j] = t->motion[STATES * j + i] = 0;
        }
    }
    for (int i = 0; i < 3; ++i) {
        t->motion[(STATES + 1) * i] = pow(sigma_dps, 2);
    }
}

// The mean rate at rest is the bias of one axis; the more it surprises, the less: a
// slow turn looks like a rest.
static void read_rest(struct twin *t) {
    const int axis = t->next_axis;
    const double surprise = t->rest_rate.level[axis] - t->bias[axis];
    const double off = fmin(fabs(surprise) / DEGREE, FUSE_REST_DOUBT_MAX_DPS);
    double row[STATES] = {0};
    if (fabs(surprise) > FUSE_REST_AGAINST_DPS * DEGREE &&
        t->settings->own_sigma_ut > FUSE_OWN_CALIBRATED_SIGMA_UT) {
        know_bias(t, FUSE_BIAS_SIGMA_DPS);
        t->learnt = 0;
        t->heading_variance = INFINITY;
    }
    row[axis] = 1;
    twin_read_motion(t, row, pow(FUSE_REST_SIGMA_DPS, 2) + FUSE_REST_DOUBT * off * off,
                     0.25, surprise);
    t->next_axis = (axis + 1) % 3;
}

// The mean of the readings so far, in the inertial frame, is the one of this window.
static void take_mean(struct twin *t) {
    if (t->field_count == 0) {
        return;
    }
    for (int i = 0; i < 3; ++i) {
        t->reading[i] = t->field_sum[i] / t->field_count;
        t->field_sum[i] = 0;
    }
    t->field_count = 0;
    t->has_reading = true;
}

// To the level frame. The lag has turned it by the mean rate.
static void turn_reading(struct twin *t) {
    double back[3], turn[4], v[4];
    for (int i = 0; i < 3; ++i) {
        back[i] = twin_clamp(t->slope[i] * -t->lag, FUSE_LAG_ANGLE_MAX_RAD);
    }
    twin_turn_by(back, 1, turn);
    twin_multiply(turn, t->level, turn);
    twin_rotate(turn, t->reading, t->reading);
    twin_multiply(turn, t->middle, v);
    twin_matrix_of(v, t->rows);
}

static void run_stage(struct twin *t, int stage, int window) {
    const bool is_resting = t->rest == FUSE_LOOKS(FUSE_REST_S);
    double v[4];
    switch (stage) {
    case 0:
        if (t->windows == BEGIN_AGAIN) {
            begin_again(t);
        }
        ++t->windows;
        ++t->age;
        for (int i = 0; i < 3; ++i) {
            v[i] = t->force_sum[i] / window;
            t->force_sum[i] = 0;
        }
        twin_lowpass(&t->force, FUSE_WINDOW_S, FUSE_LEVEL_TAU_S, v, 3, t->windows);
        follow_gravity(t);
        break;
    case 1:
        find_regressors(t, window);
        take_mean(t);
        break;
    case 2:
        turn_reading(t);
        break;
    case 3:
        if (is_resting) {
            read_rest(t);
        }
        stage_motion(t, t->windows % 2, is_resting);
        break;
    case 4:
        twin_stage_field(t, is_resting);
        break;
    case 5:
        twin_stage_turning(t);
        break;
    case 9: {
        twin_stage_own(t, is_resting);
        const double heading = atan2(t->place[0], t->place[1]);
        const double about_z[4] = {cos(heading / 2), 0, 0, sin(heading / 2)};
        twin_multiply(about_z, t->level, t->world);
        twin_find_heading_variance(t);
        t->has_reading = false;
        if (t->windows == 1 && is_resting) {
            t->windows = FUSE_WINDOWS(FUSE_LEVEL_TAU_S);
        }
        break;
    }
    default:
        twin_stage_field_axis(t, stage - 6);
        break;
    }
}

void fuse_twin_set_accuracy(struct fuse_twin_settings *settings, bool is_calibrated) {
    settings->own_sigma_ut =
        is_calibrated ? FUSE_OWN_KNOWN_SIGMA_UT : FUSE_OWN_UNKNOWN_SIGMA_UT;
    settings->level_sigma_deg = is_calibrated ? 0.058 : FUSE_LEVEL_SIGMA_G / DEGREE;
}

// A calibration at rest has found the bias, within 0.01 deg/s.
static void take_calibration(struct twin *t, const double *bias) {
    know_bias(t, FUSE_BIAS_FOUND_SIGMA_DPS);
    for (int i = 0; i < 3; ++i) {
        t->bias[i] = t->calibrated[i] = bias[i];
    }
    if (t->windows > 0) {
        t->windows = BEGIN_AGAIN;
        t->rest = FUSE_LOOKS(FUSE_REST_S);
    }
}

// The errors of tilt and heading, deg; NAN: not known.
static void state_errors(const struct twin *t, double *sigma_deg) {
    const bool is_levelling =
        t->windows < FUSE_WINDOWS(FUSE_LEVEL_TAU_S) || t->windows == BEGIN_AGAIN;
    const bool is_learning = t->learnt > 0 && t->learnt < FUSE_WINDOWS(FUSE_LEARN_S);
    const double force = twin_length(t->force.level);
    const bool has_no_tilt = is_levelling || t->same_force >= FUSE_REPEATS_FORCE ||
                             force < FUSE_GRAVITY_MIN_M_S2 ||
                             force > FUSE_GRAVITY_MAX_M_S2;
    const double tilt =
        sqrt(pow(FUSE_TILT_FLOOR_DEG, 2) + pow(t->settings->level_sigma_deg, 2) +
             pow(FUSE_TILT_DRIFT_S / DEGREE, 2) * t->drift_square);
    const double heading =
        sqrt(pow(FUSE_HEADING_FLOOR_DEG, 2) + t->heading_variance / (DEGREE * DEGREE));
    sigma_deg[0] = has_no_tilt ? NAN : tilt;
    sigma_deg[1] = has_no_tilt || is_learning || t->doubt != PLAIN ||
                           heading > (twin_is_unknown(t) ? FUSE_HEADING_FREE_UNKNOWN_DEG
                                                         : FUSE_HEADING_FREE_DEG)
                       ? NAN
                       : heading;
}

static bool is_same(const double *a, const double *b) {
    return memcmp(a, b, 3 * sizeof *a) == 0;
}

// Adds a field reading in the inertial frame, but of a sensor that gives one for ever.
static void add_reading(struct twin *t, const double *field) {
    double v[3];
    t->same_field =
        t->last_field && is_same(field, t->last_field) ? t->same_field + 1 : 0;
    t->last_field = field;
    if (t->same_field >= FUSE_REPEATS_FIELD) {
        t->learnt = 0;
        t->heading_variance = INFINITY;
        return;
    }
    twin_rotate(t->inertial, field, v);
    for (int i = 0; i < 3; ++i) {
        t->field_sum[i] += v[i];
    }
    ++t->field_count;
}

void fuse_twin_run(const struct fuse_twin_settings *settings, int count, int rate_hz,
                   double gyr_delay_s, const double *gyr, const double *acc,
                   const double *mag, const bool *has_mag, const double *interval_s,
                   int calibrated_at, const double *bias_found, double *quaternions,
                   double *sigmas_deg) {
    const double bias_variance = pow(FUSE_BIAS_SIGMA_DPS, 2);
    struct twin t = {.settings = settings,
                     .lag = FUSE_LAG_S,
                     .lag_variance = pow(FUSE_LAG_SIGMA_S, 2),
                     .heading_variance = INFINITY,
                     .drift_square = pow(FUSE_DRIFT_START_DPS * DEGREE, 2),
                     .inertial = {1, 0, 0, 0},
                     .level = {1, 0, 0, 0},
                     .world = {1, 0, 0, 0}};
    for (int i = 0; i < 3; ++i) {
        t.motion[(STATES + 1) * (BIAS + i)] = bias_variance;
        t.motion[(STATES + 1) * (SCALE + i)] = pow(500 * FUSE_SCALE_SIGMA, 2);
    }
    const int window = rate_hz / FUSE_WINDOWS(1);
    const int stride = window / 10;
    int in_window = 0;
    int stage = 10;
    for (int k = 0; k < count; ++k) {
        double turn[4], v[3], limited[3];
        if (k == calibrated_at) {
            take_calibration(&t, bias_found);
        }
        for (int i = 0; i < 3; ++i) {
            limited[i] = twin_clamp(gyr[3 * k + i], FUSE_REST_RATE_MAX_RAD_S);
            t.rate[i] = (gyr[3 * k + i] - t.bias[i]) * (1 + t.scale[i]);
        }
        if (k == 0) {
            memcpy(t.force.level, acc, 3 * sizeof *acc);
            follow_gravity(&t);
            memcpy(t.world, t.level, sizeof t.world);
        } else {
            twin_turn_by(t.rate, interval_s[k], turn);
            twin_multiply(t.inertial, turn, t.inertial);
        }
        twin_rotate(t.inertial, acc + 3 * k, v);
        for (int i = 0; i < 3; ++i) {
            t.force_sum[i] += v[i];
        }
        for (int j = 0; j < 3; ++j) {
            const double along[3] = {[0] = j == 0 ? t.rate[0] : 0,
                                     [1] = j == 1 ? t.rate[1] : 0,
                                     [2] = j == 2 ? t.rate[2] : 0};
            twin_rotate(t.inertial, along, v);
            for (int i = 0; i < 3; ++i) {
                t.turn_sum[j][i] += v[i];
            }
        }
        if (has_mag[k]) {
            add_reading(&t, mag + 3 * k);
        }
        if ((in_window + 1) % window % stride == stride - 1) {
            ++t.looks;
            t.same_force = k >= stride && is_same(acc + 3 * k, acc + 3 * (k - stride))
                               ? t.same_force + 1
                               : 0;
            twin_lowpass(&t.rest_rate, FUSE_LOOK_S, FUSE_REST_TAU_S, limited, 3,
                         t.looks);
            twin_lowpass(&t.rest_force, FUSE_LOOK_S, FUSE_REST_TAU_S, acc + 3 * k, 3,
                         t.looks);
            bool is_still =
                twin_distance(limited, t.rest_rate.level) <
                    FUSE_REST_RATE_DPS * DEGREE &&
                twin_distance(acc + 3 * k, t.rest_force.level) < FUSE_REST_FORCE_M_S2;
            for (int i = 0; i < 3; ++i) {
                is_still = is_still && fabs(t.rest_rate.level[i] - t.calibrated[i]) <=
                                           FUSE_REST_RATE_DPS * DEGREE;
            }
            t.rest =
                is_still ? (t.rest < FUSE_LOOKS(FUSE_REST_S) ? t.rest + 1 : t.rest) : 0;
        }
        ++in_window;
        if (in_window == window / 2 + stride) {
            memcpy(t.middle, t.inertial, sizeof t.middle);
        }
        if (in_window == window) {
            in_window = 0;
            stage = 0;
        }
        if (stage < 10 && in_window % stride == 0) {
            run_stage(&t, stage, window);
            ++stage;
        }
        double *out = quaternions + 4 * k;
        twin_multiply(t.world, t.inertial, out);
        twin_turn_by(t.rate, gyr_delay_s - 0.5 / rate_hz, turn);
        twin_multiply(out, turn, out);
        if (sigmas_deg != NULL) {
            state_errors(&t, sigmas_deg + 2 * k);
        }
    }
}
