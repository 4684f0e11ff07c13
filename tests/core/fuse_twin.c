// SPDX-License-Identifier: MIT
// See fuse_twin.h. Written from the equations, with libm's functions throughout.
#include "fuse_twin.h"

#include <math.h>
#include <string.h>

#include "fuse_twin_parts.h"

static void follow_gravity(struct twin *t, double frame_s) {
    double up[3];
    twin_rotate(t->level, t->force.level, up);
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
    twin_multiply(turn, t->level, t->level);
}

void twin_read_motion(struct twin *t, const double *row, double noise, double unit,
                      double surprise) {
    static const double units[STATES] = {0.25, 0.25, 0.25, 1, 1, 1, 4};
    double gain[STATES];
    twin_kalman(STATES, t->motion, row, noise, units, unit, gain);
    for (int i = 0; i < 3; ++i) {
        t->bias[i] = twin_clamp(t->bias[i] + gain[BIAS + i] * surprise, 3.4);
        t->scale[i] =
            twin_clamp(t->scale[i] + gain[SCALE + i] * surprise / DEGREE / 500, 0.08);
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
    if (t->frames <= 30) {
        return;
    }
    const double surprise = twin_clamp(t->tilting[axis] + t->used[axis].level[0] -
                                           effect(t, bias_row, scale_row),
                                       5 * DEGREE);
    t->drift[axis] += (surprise - t->drift[axis]) / 10;
    if (axis == 1) {
        const double square = (pow(t->drift[0], 2) + pow(t->drift[1], 2)) / 2;
        t->drift_square += (square - t->drift_square) / 32;
    }
    if (!is_resting) {
        const double row[STATES] = {bias_row[0],  bias_row[1],  bias_row[2],
                                    scale_row[0], scale_row[1], scale_row[2]};
        const double drift = fmin(t->drift_square / DEGREE / DEGREE, 3.057);
        twin_read_motion(
            t, row, (t->params->motion_noise + t->params->motion_drift * drift) / 0.2,
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
            params->bias_wander + params->warm_wander * exp(-t->age / 256.0);
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
    const double growth = fmax(0, frame_s * (before + after));
    t->turned = fmin(6, growth);
    if (heading[HEADING] + growth > 400) {
        for (int i = 0; i < HEADING; ++i) {
            t->motion[STATES * i + HEADING] = heading[i] = 0;
        }
    }
    heading[HEADING] = fmin(heading[HEADING] + growth, 400);
}

// How errors of bias and scale turn the level frame, about its x and y and about the
// vertical.
static void find_regressors(struct twin *t, int frame) {
    double attitude[4];
    double turn[3][3];
    double up[HEADING];
    twin_multiply(t->level, t->inertial, attitude);
    twin_matrix_of(attitude, t->rows);
    for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 3; ++i) {
            turn[j][i] = t->turn_sum[j][i] / frame / DEGREE / 500;
            t->turn_sum[j][i] = 0;
        }
        twin_rotate(t->level, turn[j], turn[j]);
        for (int i = 0; i < 3; ++i) {
            turn[j][i] = twin_clamp(turn[j][i], 1.5);
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
        twin_lowpass(&t->bias_row[i], 0.1, 3, bias_row, 3, t->frames);
        twin_lowpass(&t->scale_row[i], 0.1, 3, scale_row, 3, t->frames);
        twin_lowpass(&t->used[i], 0.1, 3, &used, 1, t->frames);
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
    t->frames = t->learnt = 0;
    t->heading_variance = INFINITY;
}

// The mean rate at rest is the bias of one axis; the more it surprises, the less: a
// slow turn looks like a rest.
static void read_rest(struct twin *t) {
    const int axis = t->next_axis;
    const double surprise = t->rest_rate.level[axis] - t->bias[axis];
    const double off = fmin(fabs(surprise) / DEGREE, 4);
    double row[STATES] = {0};
    row[axis] = 1;
    twin_read_motion(t, row, 0.03 * 0.03 + t->params->rest_doubt * off * off, 0.25,
                     surprise);
    t->next_axis = (axis + 1) % 3;
}

static void run_stage(struct twin *t, int stage, int frame) {
    const bool is_resting = t->rest == 150;
    double v[4];
    switch (stage) {
    case 0:
        if (t->frames == BEGIN_AGAIN) {
            begin_again(t);
        }
        ++t->frames;
        ++t->age;
        for (int i = 0; i < 3; ++i) {
            v[i] = t->force_sum[i] / frame;
            t->force_sum[i] = 0;
        }
        twin_lowpass(&t->force, 0.1, 3, v, 3, t->frames);
        follow_gravity(t, 0.1);
        break;
    case 1:
        find_regressors(t, frame);
        break;
    case 2:
        twin_multiply(t->level, t->attitude, v);
        twin_matrix_of(v, t->rows);
        twin_rotate(v, t->reading, t->reading);
        twin_rotate(v, t->slope, t->slope);
        break;
    case 3:
        if (is_resting) {
            read_rest(t);
        }
        stage_motion(t, t->frames % 2, is_resting);
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
        if (t->frames == 1 && is_resting) {
            t->frames = 30;
        }
        break;
    }
    default:
        twin_stage_field_axis(t, stage - 6);
        break;
    }
}

void fuse_twin_defaults(struct fuse_twin_params *params) {
    *params = (struct fuse_twin_params){
        .lag_s = 0.005,
        .lag_sd = 0.008,
        .lead_share = 1,
        .bias_sd = 0.5,
        .bias_wander = 1.5e-4,
        .warm_wander = 5e-4,
        .scale_sd = 0.01,
        .motion_noise = 1.2,
        .motion_drift = 10,
        .turning_share = 0.7,
        .turning_drift = 8100,
        .own_sd = sqrt(0.625),
        .own_doubt = 9.5,
        .own_near = 4,
        .place_sd = 0.5,
        .place_wander = 0.024,
        .heading_wander = 0.05,
        .turned_wander = 40,
        .surprise = 3,
        .field_noise = 5.5,
        .field_drift = 810,
        .field_step = 6,
        .rest_factor = 3,
        .astray_length = 2,
        .astray_share = 0.5,
        .astray_wander = 16,
        .tilt_floor = 0.38,
        .tilt_drift = 10.44,
        .heading_floor = 0.6,
        .covariance_share = 0.275,
        .level_drift = 6,
        .level_start = 0.1,
        .residual_share = 4,
        .residual_free = 2,
        .rest_doubt = 0.78,
        .strange_share = 0.2,
        .strange_sd = 5,
        .level_sd = 0.058,
    };
}

void fuse_twin_uncalibrated(struct fuse_twin_params *params) {
    fuse_twin_defaults(params);
    params->own_sd = 21;
    params->level_sd = 0.06 / DEGREE;
}

// A calibration at rest has found the bias, within 0.01 deg/s.
static void take_calibration(struct twin *t, const double *bias) {
    for (int i = 0; i < STATES; ++i) {
        for (int j = 0; j < 3; ++j) {
            t->motion[STATES * i + j] = t->motion[STATES * j + i] = 0;
        }
    }
    for (int i = 0; i < 3; ++i) {
        t->bias[i] = t->calibrated[i] = bias[i];
        t->motion[(STATES + 1) * i] = 1e-4;
    }
    if (t->frames > 0) {
        t->frames = BEGIN_AGAIN;
        t->rest = 150;
    }
}

// The errors of tilt and heading, deg; NAN: not known.
static void state_errors(const struct twin *t, double *sigma_deg) {
    const struct fuse_twin_params *params = t->params;
    const bool is_starting =
        t->frames < 30 || t->frames == BEGIN_AGAIN || (t->learnt > 0 && t->learnt < 20);
    const double tilt = sqrt(pow(params->tilt_floor, 2) + pow(params->level_sd, 2) +
                             pow(params->tilt_drift / DEGREE, 2) * t->drift_square);
    const double heading =
        sqrt(pow(params->heading_floor, 2) + t->heading_variance / (DEGREE * DEGREE));
    sigma_deg[0] = is_starting ? NAN : tilt;
    sigma_deg[1] = is_starting || heading > 30 ? NAN : heading;
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
                     .heading_variance = INFINITY,
                     .drift_square = pow(params->level_start * DEGREE, 2),
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
            take_calibration(&t, bias_found);
        }
        for (int i = 0; i < 3; ++i) {
            limited[i] = twin_clamp(gyr[3 * k + i], 10);
            t.rate[i] = (gyr[3 * k + i] - t.bias[i]) * (1 + t.scale[i]);
        }
        if (k == 0) {
            memcpy(t.force.level, acc, 3 * sizeof *acc);
            follow_gravity(&t, 0.1);
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
        if (has_mag[k] && !t.has_reading && (stage == 1 || stage == 2)) {
            double back[3];
            for (int i = 0; i < 3; ++i) {
                back[i] = twin_clamp(t.rate[i] * -t.lag, 0.3);
            }
            twin_turn_by(back, 1, turn);
            twin_multiply(t.inertial, turn, t.attitude);
            memcpy(t.reading, mag + 3 * k, sizeof t.reading);
            memcpy(t.slope, t.rate, sizeof t.slope);
            t.has_reading = true;
        }
        if ((in_frame + 1) % frame % stride == stride - 1) {
            ++t.looks;
            twin_lowpass(&t.rest_rate, 0.01, 0.5, limited, 3, t.looks);
            twin_lowpass(&t.rest_force, 0.01, 0.5, acc + 3 * k, 3, t.looks);
            bool is_still = twin_distance(limited, t.rest_rate.level) < 2 * DEGREE &&
                            twin_distance(acc + 3 * k, t.rest_force.level) < 0.5;
            for (int i = 0; i < 3; ++i) {
                is_still = is_still &&
                           fabs(t.rest_rate.level[i] - t.calibrated[i]) <= 2 * DEGREE;
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
        twin_multiply(t.world, t.inertial, out);
        twin_turn_by(t.rate, params->lead_share * (gyr_delay_s - 0.5 / rate_hz), turn);
        twin_multiply(out, turn, out);
        if (sigmas_deg != NULL) {
            state_errors(&t, sigmas_deg + 2 * k);
        }
    }
}
