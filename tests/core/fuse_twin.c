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

// One scalar reading: changes the covariance, gives the gains.
static void kalman(int states, double *covariance, const double *row, double noise,
                   double *gain) {
    double shared[6];
    double spread = noise;
    for (int a = 0; a < states; ++a) {
        shared[a] = 0;
        for (int b = 0; b < states; ++b) {
            shared[a] += covariance[a * states + b] * row[b];
        }
        spread += row[a] * shared[a];
    }
    for (int a = 0; a < states; ++a) {
        gain[a] = clamp(shared[a] / spread, 1);
        shared[a] = clamp(shared[a], spread);
    }
    for (int a = 0; a < states; ++a) {
        for (int b = 0; b <= a; ++b) {
            covariance[a * states + b] -= gain[a] * shared[b];
            covariance[b * states + a] = covariance[a * states + b];
        }
    }
}

struct twin {
    const struct fuse_twin_params *params;
    double inertial[4], level[4], world[4];
    double force_sum[3], turn_sum[3];
    struct lowpass3 force, rest_rate, rest_force, regressor[2], turn[2];
    double tilting[2];
    double bias[3], calibrated[3], scale, motion[16];
    double rate[3];
    int frames, rest, looks, rest_axis;
    double attitude[4], reading[3], rows[3][3];
    bool has_reading, is_turned;
    double place[3], own[3], field[36], noise, astray;
    double lag, lag_variance, slope[3];  // s, s2, uT/s: of the reading by the lag
    double rate_square, heading_variance;
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

static void read_motion(struct twin *t, const double *row, double noise,
                        double surprise) {
    double gain[4];
    kalman(4, t->motion, row, noise, gain);
    for (int i = 0; i < 3; ++i) {
        t->bias[i] = clamp(t->bias[i] + gain[i] * surprise, 3.4);
    }
    t->scale = clamp(t->scale + gain[3] * surprise / degree / 500, 0.02);
}

static void stage_motion(struct twin *t, int axis) {
    const double *level = t->regressor[axis].level;
    if (t->frames <= 30) {
        return;
    }
    const double row[4] = {level[0], level[1], level[2],
                           clamp(t->turn[axis].level[0] / degree, 750) / 500};
    read_motion(t, row, t->params->motion_noise / 0.1,
                clamp(t->tilting[axis], 5 * degree));
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
static void read_lag(struct twin *t, const double *away, double distance) {
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
    const double noise = fmin(t->params->lag_noise * distance, 1800);
    const double gain = t->lag_variance / (noise + t->lag_variance * square);
    t->lag = fmax(0, fmin(0.03, t->lag - gain * along));
    t->lag_variance *= 1 - gain * square;
}

static void stage_field(struct twin *t, bool is_resting) {
    const struct fuse_twin_params *params = t->params;
    const double frame_s = 0.1;
    double away[3];
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
    const double wander = !t->has_reading ? 0.3
                          : t->is_turned  ? params->turned_wander
                                          : params->heading_wander;
    const double turn =
        (wander + 20 * (t->motion[0] + t->motion[5] + t->motion[10]) / 3) * degree *
        degree * frame_s;
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
    if (!t->has_reading) {
        return;
    }
    double d2 = 0;
    surprise_of(t, away);
    for (int i = 0; i < 3; ++i) {
        away[i] = clamp(away[i], 90);
        d2 += pow(away[i] / params->surprise, 2);
    }
    const double longer = away[0] * (away[0] + 2 * x) + away[1] * (away[1] + 2 * y);
    t->is_turned =
        d2 > 8 && fabs(away[2]) < 3 && fabs(longer) < 6 * (fabs(x) + fabs(y));
    t->noise = params->field_noise / frame_s * sqrt(1 + d2);
    if (is_resting) {
        t->noise *= params->rest_factor;
    } else {
        t->astray += ((d2 > 1 && !t->is_turned) - t->astray) / 16;
    }
    t->noise = fmin(t->noise, 900);
    if (!is_resting) {
        read_lag(t, away, sqrt(1 + d2));
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
    kalman(6, t->field, row, t->noise, gain);
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
    const double leaning = t->place[2] * t->params->level_error * degree;
    t->heading_variance =
        (t->params->covariance_share * across + leaning * leaning) / (norm * norm);
}

static void run_stage(struct twin *t, int stage, int frame) {
    const bool is_resting = t->rest == 150;
    double v[4], row[4] = {0, 0, 0, 0};
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
    case 1: {
        double turn[3];
        for (int i = 0; i < 3; ++i) {
            turn[i] = t->turn_sum[i] / frame;
            t->turn_sum[i] = 0;
            t->motion[5 * i] =
                fmin(t->motion[5 * i] + 1e-5, pow(t->params->bias_sd, 2));
        }
        t->motion[15] = fmin(t->motion[15] + 1e-5, pow(500 * t->params->scale_sd, 2));
        double square = 0;
        for (int i = 0; i < 3; ++i) {
            square += pow(t->rate[i] / degree, 2);
        }
        t->rate_square += (square - t->rate_square) / 30;
        rotate(t->level, turn, turn);
        multiply(t->level, t->inertial, v);
        matrix_of(v, t->rows);
        for (int i = 0; i < 2; ++i) {
            for (int j = 0; j < 3; ++j) {
                v[j] = -t->rows[i][j];
            }
            lowpass(&t->regressor[i], 0.1, 3, v, 3, t->frames);
            lowpass(&t->turn[i], 0.1, 3, &turn[i], 1, t->frames);
        }
        break;
    }
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
            read_motion(t, row, 0.03 * 0.03, t->rest_rate.level[axis] - t->bias[axis]);
            t->rest_axis = (axis + 1) % 3;
        } else {
            stage_motion(t, 0);
        }
        break;
    case 4:
        if (!is_resting) {
            stage_motion(t, 1);
        }
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
        .lag_noise = 100,
        .lead_share = 1,
        .bias_sd = 0.5,
        .scale_sd = 0.003,
        .motion_noise = 0.3,
        .own_sd = sqrt(0.625),
        .place_sd = 0.5,
        .place_wander = 0.03,
        .heading_wander = 0.05,
        .turned_wander = 40,
        .surprise = 3,
        .field_noise = 5,
        .field_step = 6,
        .rest_factor = 4,
        .astray_share = 0.5,
        .astray_wander = 16,
        .tilt_floor = 0.28,
        .tilt_rate = 0.20,
        .heading_floor = 0.6,
        .covariance_share = 0.15,
        .level_error = 0.3,
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
                     .world = {1, 0, 0, 0},
                     .motion = {[0] = bias_variance,
                                [5] = bias_variance,
                                [10] = bias_variance,
                                [15] = pow(500 * params->scale_sd, 2)}};
    const int frame = rate_hz / 10;
    const int stride = frame / 10;
    int in_frame = 0;
    int stage = 10;
    for (int k = 0; k < count; ++k) {
        double turn[4], v[3], limited[3];
        if (k == calibrated_at) {
            memset(t.motion, 0, 15 * sizeof *t.motion);
            for (int i = 0; i < 3; ++i) {
                t.bias[i] = t.calibrated[i] = bias_found[i];
                t.motion[5 * i] = 1e-4;
            }
            for (int i = 0; i < 3; ++i) {
                t.motion[12 + i] = 0;
            }
        }
        for (int i = 0; i < 3; ++i) {
            limited[i] = clamp(gyr[3 * k + i], 10);
            t.rate[i] = gyr[3 * k + i] - t.bias[i];
        }
        if (k == 0) {
            memcpy(t.force.level, acc, 3 * sizeof *acc);
            follow_gravity(&t, 0.1);
            memcpy(t.world, t.level, sizeof t.world);
        } else {
            turn_by(t.rate, interval_s[k] * (1 + t.scale), turn);
            multiply(t.inertial, turn, t.inertial);
        }
        rotate(t.inertial, acc + 3 * k, v);
        for (int i = 0; i < 3; ++i) {
            t.force_sum[i] += v[i];
        }
        rotate(t.inertial, t.rate, v);
        for (int i = 0; i < 3; ++i) {
            t.turn_sum[i] += v[i];
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
            sigmas_deg[2 * k] = sqrt(pow(params->tilt_floor, 2) +
                                     pow(params->tilt_rate / 100, 2) * t.rate_square);
            sigmas_deg[2 * k + 1] = sqrt(pow(params->heading_floor, 2) +
                                         t.heading_variance / (degree * degree));
        }
    }
}
