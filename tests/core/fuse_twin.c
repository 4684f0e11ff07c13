// SPDX-License-Identifier: MIT
// See fuse_twin.h. Written from the equations, with libm's functions throughout.
#include "fuse_twin.h"

#include <math.h>
#include <string.h>

static const double degree = 3.14159265358979323846 / 180;

struct lowpass3 {
    double band[3], level[3];
};

static void lowpass(struct lowpass3 *f, double step_s, double tau, const double *in,
                    int width, int count) {
    const double g = tan(step_s / (tau * sqrt(2)));
    const double feedback = 1 / (1 + g * (g + sqrt(2)));
    for (int i = 0; i < width; ++i) {
        const double error = in[i] - f->level[i];
        if (count <= (int)(tau / step_s + 1e-9)) {
            f->level[i] += error / count;
            continue;
        }
        const double middle = (f->band[i] + error * g) * feedback;
        f->level[i] += 2 * middle * g;
        f->band[i] = 2 * middle - f->band[i];
    }
}

static void multiply(const double *a, const double *b, double *out) {
    const double q[4] = {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                         a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                         a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                         a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
    const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; ++i) {
        out[i] = q[i] / norm;
    }
}

static void rotate(const double *q, const double *v, double *out) {
    const double t[3] = {2 * (q[2] * v[2] - q[3] * v[1]),
                         2 * (q[3] * v[0] - q[1] * v[2]),
                         2 * (q[1] * v[1] - q[2] * v[0])};
    const double turned[3] = {v[0] + q[0] * t[0] + q[2] * t[2] - q[3] * t[1],
                              v[1] + q[0] * t[1] + q[3] * t[0] - q[1] * t[2],
                              v[2] + q[0] * t[2] + q[1] * t[1] - q[2] * t[0]};
    memcpy(out, turned, sizeof turned);
}

static void turn_by(const double *rate, double seconds, double *out) {
    double angle = 0;
    for (int i = 0; i < 3; ++i) {
        angle += rate[i] * rate[i];
    }
    angle = sqrt(angle) * seconds;
    const double gain =
        fabs(angle) > 1e-12 ? sin(angle / 2) / angle * seconds : seconds / 2;
    out[0] = cos(angle / 2);
    for (int i = 0; i < 3; ++i) {
        out[i + 1] = rate[i] * gain;
    }
}

static double clamp(double value, double limit) {
    return fmax(-limit, fmin(limit, value));
}

static double distance(const double *a, const double *b) {
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}

static void matrix_of(const double *q, double matrix[3][3]) {
    for (int j = 0; j < 3; ++j) {
        const double unit[3] = {j == 0, j == 1, j == 2};
        double column[3];
        rotate(q, unit, column);
        for (int i = 0; i < 3; ++i) {
            matrix[i][j] = column[i];
        }
    }
}

// One scalar reading: changes the covariance, gives the gains, at most 1 in the units
// of fuse.c, of which the states have `units` and the reading has `unit`.
static void kalman(int states, double *covariance, const double *row, double noise,
                   const double *units, double unit, double *gain) {
    double shared[7];
    double spread = noise;
    for (int a = 0; a < states; ++a) {
        shared[a] = 0;
        for (int b = 0; b < states; ++b) {
            shared[a] += covariance[a * states + b] * row[b];
        }
        spread += row[a] * shared[a];
    }
    for (int a = 0; a < states; ++a) {
        const double limit = units[a] / unit;
        gain[a] = clamp(shared[a] / spread, limit);
        shared[a] = clamp(shared[a], limit * spread);
    }
    for (int a = 0; a < states; ++a) {
        for (int b = 0; b <= a; ++b) {
            covariance[a * states + b] -= gain[a] * shared[b];
            covariance[b * states + a] = covariance[a * states + b];
        }
    }
}

enum {
    BIAS = 0,     // states of the gyroscope's filter: bias, deg/s
    SCALE = 3,    // scales, 500ths
    HEADING = 6,  // error of the integrated heading, deg
    STATES = 7,
};

struct twin {
    const struct fuse_twin_params *params;
    double inertial[4], level[4], world[4];
    double force_sum[3];
    double turn_sum[3][3];  // by axis of the body, in the inertial frame
    struct lowpass3 force, rest_rate, rest_force;
    struct lowpass3 bias_row[2], scale_row[2], used[2];
    double tilting[2], drift[2], drift_square;  // rad/s
    double bias[3], calibrated[3], scale[3], motion[STATES * STATES];
    double turned;  // deg2: growth of the heading's variance in this frame
    double rate[3];
    int frames, rest, looks, rest_axis;
    double attitude[4], reading[3], rows[3][3];
    bool has_reading, is_turned;
    double place[3], own[3], field[36], noise, astray;
    double lag, lag_variance, slope[3];  // s, s2, uT/s: of the reading by the lag
    double residual, heading_variance;   // uT2, rad2
    int learnt;
};

static void follow_gravity(struct twin *t, double frame_s) {
    double up[3];
    rotate(t->level, t->force.level, up);
    const double norm = sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]);
    t->tilting[0] = t->tilting[1] = 0;
    if (norm < 1) {
        return;
    }
    t->tilting[0] = up[1] / norm / frame_s;
    t->tilting[1] = -up[0] / norm / frame_s;
    double turn[4] = {1 + up[2] / norm, up[1] / norm, -up[0] / norm, 0};
    if (up[0] == 0 && up[1] == 0 && up[2] < 0) {
        turn[1] = 1;
    }
    multiply(turn, t->level, t->level);
}

static void read_motion(struct twin *t, const double *row, double noise, double unit,
                        double surprise) {
    static const double units[STATES] = {0.25, 0.25, 0.25, 1, 1, 1, 4};
    double gain[STATES];
    kalman(STATES, t->motion, row, noise, units, unit, gain);
    for (int i = 0; i < 3; ++i) {
        t->bias[i] = clamp(t->bias[i] + gain[BIAS + i] * surprise, 3.4);
        t->scale[i] =
            clamp(t->scale[i] + gain[SCALE + i] * surprise / degree / 500, 0.08);
    }
}

// The rate, rad/s, by which bias and scales that are as estimated turn the level frame.
static double effect(const struct twin *t, const double *bias_row,
                     const double *scale_row) {
    double sum = 0;
    for (int i = 0; i < 3; ++i) {
        sum += bias_row[i] * t->bias[i] + scale_row[i] * t->scale[i] * 500 * degree;
    }
    return sum;
}

// The surprise of levelling is that of an error that has always been there: what was
// estimated at the time of each correction has been taken off it.
static void stage_motion(struct twin *t, int axis, bool is_resting) {
    const double *bias_row = t->bias_row[axis].level;
    const double *scale_row = t->scale_row[axis].level;
    if (t->frames <= 30) {
        return;
    }
    const double surprise = clamp(t->tilting[axis] + t->used[axis].level[0] -
                                      effect(t, bias_row, scale_row),
                                  5 * degree);
    t->drift[axis] += (surprise - t->drift[axis]) / 20;
    if (axis == 1) {
        const double square = (pow(t->drift[0], 2) + pow(t->drift[1], 2)) / 2;
        t->drift_square += (square - t->drift_square) / 64;
    }
    if (!is_resting) {
        const double row[STATES] = {bias_row[0],  bias_row[1],  bias_row[2],
                                    scale_row[0], scale_row[1], scale_row[2]};
        const double drift = fmin(t->drift_square / degree / degree, 3.057);
        read_motion(t, row,
                    (t->params->motion_noise + t->params->motion_drift * drift) / 0.1,
                    1, surprise);
    }
}

// The uncertainty that a frame adds to bias, scales and heading. `up` is the part of
// each state in the rate about the vertical.
static void predict_motion(struct twin *t, const double *up) {
    const struct fuse_twin_params *params = t->params;
    const double frame_s = 0.1;
    double *heading = t->motion + STATES * HEADING;
    double before = 0;
    double after = 0;
    for (int i = 0; i < 3; ++i) {
        double *bias = &t->motion[(STATES + 1) * (BIAS + i)];
        double *scale = &t->motion[(STATES + 1) * (SCALE + i)];
        const double wander =
            params->bias_wander + params->warm_wander * exp(-t->frames / 256.0);
        *bias = fmin(*bias + wander * frame_s, pow(params->bias_sd, 2));
        *scale = fmin(*scale + 1e-5, pow(500 * params->scale_sd, 2));
    }
    for (int i = 0; i < HEADING; ++i) {
        double product = 0;
        for (int j = 0; j < HEADING; ++j) {
            product += t->motion[STATES * i + j] * up[j];
        }
        before += up[i] * heading[i];
        heading[i] += frame_s * product;
        t->motion[STATES * i + HEADING] = heading[i];
        after += up[i] * heading[i];
    }
    t->turned = fmax(0, fmin(6, frame_s * (before + after)));
    heading[HEADING] = fmin(heading[HEADING] + t->turned, 400);
}

static void surprise_of(const struct twin *t, double *out) {
    for (int i = 0; i < 3; ++i) {
        out[i] = t->reading[i] - t->place[i];
        for (int j = 0; j < 3; ++j) {
            out[i] -= t->rows[i][j] * t->own[j];
        }
    }
}

static void learn_place(struct twin *t, bool is_resting) {
    const double own = pow(t->params->own_sd, 2);
    double away[3];
    surprise_of(t, away);
    for (int i = 0; i < STATES; ++i) {
        t->motion[STATES * i + HEADING] = t->motion[STATES * HEADING + i] = 0;
    }
    ++t->learnt;
    memset(t->field, 0, sizeof t->field);
    for (int i = 0; i < 3; ++i) {
        t->place[i] += away[i] / t->learnt;
        t->field[7 * i] = own + pow(t->params->place_sd, 2) + (is_resting ? 0 : 9);
        t->field[7 * (i + 3)] = own;
        for (int j = 0; j < 3; ++j) {
            t->field[6 * i + 3 + j] = t->field[6 * (3 + j) + i] = -own * t->rows[i][j];
        }
    }
}

// The field of the place, seen from a body that turns, moves by place x rate: what of
// it readings surprise by is an error of the lag.
static void read_lag(struct twin *t, const double *away) {
    const double *rate = t->slope;
    double square = 0;
    double along = 0;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3;
        const int k = (i + 2) % 3;
        const double slope =
            clamp(t->place[j], 200) * rate[k] - clamp(t->place[k], 200) * rate[j];
        square += slope * slope;
        along += slope * clamp(away[i], t->params->field_step);
    }
    const double noise = 2 * t->noise;
    const double gain = t->lag_variance / (noise + t->lag_variance * square);
    t->lag = fmax(0, fmin(0.03, t->lag - gain * along));
    t->lag_variance *= 1 - gain * square;
}

// The uncertainty that a frame adds to the field: that of the place turns with an error
// of the heading, and both fields wander, the probe's more where readings keep
// surprising.
static void predict_field(struct twin *t, bool is_resting) {
    const struct fuse_twin_params *params = t->params;
    const double frame_s = 0.1;
    const double wander = !t->has_reading ? 0.3
                          : t->is_turned  ? params->turned_wander
                                          : params->heading_wander;
    const double turn = (wander * frame_s + t->turned) * degree * degree;
    const double x = clamp(t->place[0], 60);
    const double y = clamp(t->place[1], 60);
    if (t->field[0] + t->field[7] < 60) {
        t->field[0] += turn * y * y;
        t->field[7] += turn * x * x;
        t->field[1] -= turn * x * y;
        t->field[6] = t->field[1];
    }
    for (int i = 0; i < 6; ++i) {
        const bool is_astray = t->astray > params->astray_share && !is_resting;
        t->field[7 * i] += i < 3       ? params->place_wander * frame_s
                           : is_astray ? params->astray_wander * frame_s
                                       : pow(2, -19);
        t->field[7 * i] = fmin(t->field[7 * i], 81);
    }
}

// uT2: the vertical field, seen through a level that goes on being corrected.
static double leaning(const struct twin *t) {
    return pow(clamp(t->place[2], 60), 2) * t->drift_square;
}

// A reading across the horizontal field tells by how much the heading was turned by
// errors of the gyroscope.
static void read_turning(struct twin *t, const double *away, double d2) {
    const struct fuse_twin_params *params = t->params;
    const double norm = hypot(t->place[0], t->place[1]);
    if (norm < 1) {
        return;
    }
    const double noise =
        params->turning_share * params->field_noise / 0.1 * fmin(1 + d2, 26) +
        fmin(params->turning_drift * leaning(t), 506);
    double row[6] = {-t->place[1] / norm, t->place[0] / norm, 0};
    double off = 0;
    double spread = 0;
    double across = 0;
    for (int i = 0; i < 3; ++i) {
        row[3 + i] = row[0] * t->rows[0][i] + row[1] * t->rows[1][i];
        off += row[i] * away[i];
    }
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < 6; ++j) {
            spread += row[i] * t->field[6 * i + j] * row[j];
            across += i < 3 ? row[i] * t->field[6 * i + j] * (j < 3 ? row[j] : 0) : 0;
        }
    }
    off = clamp(off, 10);
    t->residual += (off * off - t->residual) / 64;
    // Of the heading's variance, what the field's covariance has already.
    const double unit = fmin(norm, 50) * degree;  // uT a degree
    const double seen = unit * unit * t->motion[(STATES + 1) * HEADING];
    const double turn[STATES] = {[HEADING] = unit};
    read_motion(t, turn, fmax(noise + spread - fmin(seen, across), noise / 4), 2,
                clamp(off, params->field_step) * degree);
}

static void weigh_field(struct twin *t, bool is_resting) {
    const struct fuse_twin_params *params = t->params;
    double away[3];
    double d2 = 0;
    double longer = 0;
    double length = 0;
    surprise_of(t, away);
    for (int i = 0; i < 3; ++i) {
        away[i] = clamp(away[i], 90);
        d2 += pow(away[i] / params->surprise, 2);
        length += pow(clamp(t->place[i], 90), 2);
    }
    for (int i = 0; i < 2; ++i) {
        longer += away[i] * (away[i] + 2 * clamp(t->place[i], 90));
    }
    t->is_turned = d2 > 8 && fabs(away[2]) < 3 &&
                   fabs(longer) < 6 * (fabs(t->place[0]) + fabs(t->place[1]));
    longer += away[2] * (away[2] + 2 * clamp(t->place[2], 90));
    t->noise = params->field_noise / 0.1 * sqrt(1 + d2);
    if (is_resting) {
        t->noise *= params->rest_factor;
    } else {
        // An error of level or heading turns a reading, and leaves its length.
        const bool is_strange = d2 > 1 && !t->is_turned &&
                                fabs(longer) > 2 * params->astray_length * sqrt(length);
        t->astray += (is_strange - t->astray) / 16;
    }
    t->noise = fmin(t->noise + params->field_drift * leaning(t), 900);
    if (!is_resting) {
        read_lag(t, away);
    }
    read_turning(t, away, d2);
}

static void stage_field(struct twin *t, bool is_resting) {
    if (t->has_reading && t->frames == 30 && !is_resting) {
        t->learnt = 0;
    }
    if (t->has_reading && t->learnt < 20) {
        learn_place(t, is_resting);
        t->has_reading = false;
        return;
    }
    if (t->learnt == 0) {
        return;
    }
    predict_field(t, is_resting);
    if (t->has_reading) {
        weigh_field(t, is_resting);
    }
}

static void stage_field_axis(struct twin *t, int axis) {
    double away[3], gain[6];
    if (!t->has_reading) {
        return;
    }
    const double row[6] = {axis == 0,        axis == 1,        axis == 2,
                           t->rows[axis][0], t->rows[axis][1], t->rows[axis][2]};
    surprise_of(t, away);
    const double surprise = clamp(away[axis], t->params->field_step);
    static const double units[6] = {1, 1, 1, 1, 1, 1};
    kalman(6, t->field, row, t->noise, units, 1, gain);
    for (int i = 0; i < 3; ++i) {
        t->place[i] = clamp(t->place[i] + gain[i] * surprise, 3600);
        t->own[i] = clamp(t->own[i] + gain[3 + i] * surprise, 400);
    }
}

static void find_heading_variance(struct twin *t) {
    const double norm = hypot(t->place[0], t->place[1]);
    if (norm < 1) {
        t->learnt = 0;
        t->heading_variance = INFINITY;
        return;
    }
    const double x = t->place[0] / norm;
    const double y = t->place[1] / norm;
    const double across =
        y * y * t->field[0] - 2 * x * y * t->field[1] + x * x * t->field[7];
    const struct fuse_twin_params *params = t->params;
    t->heading_variance =
        (params->covariance_share * across + pow(params->level_drift, 2) * leaning(t) +
         params->residual_share * fmax(0, t->residual - params->residual_free)) /
        (norm * norm);
}

// How errors of bias and scale turn the level frame, about its x and y and about the
// vertical.
static void find_regressors(struct twin *t, int frame) {
    double attitude[4];
    double turn[3][3];
    double up[HEADING];
    multiply(t->level, t->inertial, attitude);
    matrix_of(attitude, t->rows);
    for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 3; ++i) {
            turn[j][i] = t->turn_sum[j][i] / frame / degree / 500;
            t->turn_sum[j][i] = 0;
        }
        rotate(t->level, turn[j], turn[j]);
        for (int i = 0; i < 3; ++i) {
            turn[j][i] = clamp(turn[j][i], 1.5);
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
        lowpass(&t->bias_row[i], 0.1, 3, bias_row, 3, t->frames);
        lowpass(&t->scale_row[i], 0.1, 3, scale_row, 3, t->frames);
        lowpass(&t->used[i], 0.1, 3, &used, 1, t->frames);
    }
    predict_motion(t, up);
}

static void run_stage(struct twin *t, int stage, int frame) {
    const bool is_resting = t->rest == 150;
    double v[4];
    double row[STATES] = {0};
    switch (stage) {
    case 0:
        ++t->frames;
        for (int i = 0; i < 3; ++i) {
            v[i] = t->force_sum[i] / frame;
            t->force_sum[i] = 0;
        }
        lowpass(&t->force, 0.1, 3, v, 3, t->frames);
        follow_gravity(t, 0.1);
        break;
    case 1:
        find_regressors(t, frame);
        break;
    case 2:
        multiply(t->level, t->attitude, v);
        matrix_of(v, t->rows);
        rotate(v, t->reading, t->reading);
        rotate(v, t->slope, t->slope);
        break;
    case 3:
        if (is_resting) {
            const int axis = t->rest_axis;
            row[axis] = 1;
            read_motion(t, row, 0.03 * 0.03, 0.25,
                        t->rest_rate.level[axis] - t->bias[axis]);
            t->rest_axis = (axis + 1) % 3;
        }
        stage_motion(t, 0, is_resting);
        break;
    case 4:
        stage_motion(t, 1, is_resting);
        break;
    case 5:
        stage_field(t, is_resting);
        break;
    case 9: {
        const double heading = atan2(t->place[0], t->place[1]);
        const double about_z[4] = {cos(heading / 2), 0, 0, sin(heading / 2)};
        multiply(about_z, t->level, t->world);
        find_heading_variance(t);
        t->has_reading = false;
        break;
    }
    default:
        stage_field_axis(t, stage - 6);
        break;
    }
}

void fuse_twin_defaults(struct fuse_twin_params *params) {
    *params = (struct fuse_twin_params){
        .lag_s = 0.0125,
        .lag_sd = 0.005,
        .lead_share = 1,
        .bias_sd = 0.5,
        .bias_wander = 1.5e-4,
        .warm_wander = 5e-4,
        .scale_sd = 0.01,
        .motion_noise = 1,
        .motion_drift = 10,
        .turning_share = 0.7,
        .turning_drift = 8100,
        .own_sd = sqrt(0.625),
        .place_sd = 0.5,
        .place_wander = 0.02,
        .heading_wander = 0.05,
        .turned_wander = 40,
        .surprise = 3,
        .field_noise = 5.5,
        .field_drift = 810,
        .field_step = 6,
        .rest_factor = 4,
        .astray_length = 2,
        .astray_share = 0.5,
        .astray_wander = 16,
        .tilt_floor = 0.4,
        .tilt_drift = 10.44,
        .heading_floor = 0.4,
        .covariance_share = 0.25,
        .level_drift = 6,
        .residual_share = 1,
        .residual_free = 2,
    };
}

void fuse_twin_run(const struct fuse_twin_params *params, int count, int rate_hz,
                   double gyr_delay_s, const double *gyr, const double *acc,
                   const double *mag, const bool *has_mag, const double *interval_s,
                   int calibrated_at, const double *bias_found, double *quaternions,
                   double *sigmas_deg) {
    const double bias_variance = pow(params->bias_sd, 2);
    struct twin t = {.params = params,
                     .lag = params->lag_s,
                     .lag_variance = pow(params->lag_sd, 2),
                     .inertial = {1, 0, 0, 0},
                     .level = {1, 0, 0, 0},
                     .world = {1, 0, 0, 0}};
    for (int i = 0; i < 3; ++i) {
        t.motion[(STATES + 1) * (BIAS + i)] = bias_variance;
        t.motion[(STATES + 1) * (SCALE + i)] = pow(500 * params->scale_sd, 2);
    }
    const int frame = rate_hz / 10;
    const int stride = frame / 10;
    int in_frame = 0;
    int stage = 10;
    for (int k = 0; k < count; ++k) {
        double turn[4], v[3], limited[3];
        if (k == calibrated_at) {
            for (int i = 0; i < STATES * STATES; ++i) {
                const int state = i / (STATES + 1);
                const bool is_variance = i % (STATES + 1) == 0;
                if (!is_variance || state < SCALE) {
                    t.motion[i] = is_variance ? 1e-4 : 0;
                }
            }
            for (int i = 0; i < 3; ++i) {
                t.bias[i] = t.calibrated[i] = bias_found[i];
            }
        }
        for (int i = 0; i < 3; ++i) {
            limited[i] = clamp(gyr[3 * k + i], 10);
            t.rate[i] = (gyr[3 * k + i] - t.bias[i]) * (1 + t.scale[i]);
        }
        if (k == 0) {
            memcpy(t.force.level, acc, 3 * sizeof *acc);
            follow_gravity(&t, 0.1);
            memcpy(t.world, t.level, sizeof t.world);
        } else {
            turn_by(t.rate, interval_s[k], turn);
            multiply(t.inertial, turn, t.inertial);
        }
        rotate(t.inertial, acc + 3 * k, v);
        for (int i = 0; i < 3; ++i) {
            t.force_sum[i] += v[i];
        }
        for (int j = 0; j < 3; ++j) {
            const double along[3] = {[0] = j == 0 ? t.rate[0] : 0,
                                     [1] = j == 1 ? t.rate[1] : 0,
                                     [2] = j == 2 ? t.rate[2] : 0};
            rotate(t.inertial, along, v);
            for (int i = 0; i < 3; ++i) {
                t.turn_sum[j][i] += v[i];
            }
        }
        if (has_mag[k] && !t.has_reading && (stage == 1 || stage == 2)) {
            double back[3];
            for (int i = 0; i < 3; ++i) {
                back[i] = clamp(t.rate[i] * -t.lag, 0.3);
            }
            turn_by(back, 1, turn);
            multiply(t.inertial, turn, t.attitude);
            memcpy(t.reading, mag + 3 * k, sizeof t.reading);
            memcpy(t.slope, t.rate, sizeof t.slope);
            t.has_reading = true;
        }
        if ((in_frame + 1) % frame % stride == stride - 1) {
            ++t.looks;
            lowpass(&t.rest_rate, 0.01, 0.5, limited, 3, t.looks);
            lowpass(&t.rest_force, 0.01, 0.5, acc + 3 * k, 3, t.looks);
            bool is_still = distance(limited, t.rest_rate.level) < 2 * degree &&
                            distance(acc + 3 * k, t.rest_force.level) < 0.5;
            for (int i = 0; i < 3; ++i) {
                is_still = is_still &&
                           fabs(t.rest_rate.level[i] - t.calibrated[i]) <= 2 * degree;
            }
            t.rest = is_still ? (t.rest < 150 ? t.rest + 1 : 150) : 0;
        }
        ++in_frame;
        if (in_frame == frame) {
            in_frame = 0;
            stage = 0;
        }
        if (stage < 10 && in_frame % stride == 0) {
            run_stage(&t, stage, frame);
            ++stage;
        }
        double *out = quaternions + 4 * k;
        multiply(t.world, t.inertial, out);
        turn_by(t.rate, params->lead_share * (gyr_delay_s - 0.5 / rate_hz), turn);
        multiply(out, turn, out);
        if (sigmas_deg != NULL) {
            sigmas_deg[2 * k] =
                sqrt(pow(params->tilt_floor, 2) +
                     pow(params->tilt_drift / degree, 2) * t.drift_square);
            sigmas_deg[2 * k + 1] = sqrt(pow(params->heading_floor, 2) +
                                         t.heading_variance / (degree * degree));
        }
    }
}
