// SPDX-License-Identifier: MIT
// Heading, from the magnetic field; see fuse_twin.h.
#include <math.h>
#include <string.h>

#include "fuse_twin_parts.h"

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
        const double slope = twin_clamp(t->place[j], 200) * rate[k] -
                             twin_clamp(t->place[k], 200) * rate[j];
        square += slope * slope;
        along += slope * twin_clamp(away[i], t->params->field_step);
    }
    const double noise = 2 * t->noise;
    const double gain = t->lag_variance / (noise + t->lag_variance * square);
    t->lag = fmax(0, fmin(0.03, t->lag - gain * along));
    t->lag_variance *= 1 - gain * square;
}

// No calibration has told the probe's own field.
static bool is_unknown(const struct twin *t) {
    return t->params->own_sd > 1;
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
    const double turn = (wander * frame_s + t->turned) * DEGREE * DEGREE;
    const double x = twin_clamp(t->place[0], 60);
    const double y = twin_clamp(t->place[1], 60);
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
        t->field[7 * i] = fmin(t->field[7 * i], is_unknown(t) ? 460 : 81);
    }
}

// uT2: the vertical field, seen through a level that goes on being corrected.
static double leaning(const struct twin *t) {
    return pow(twin_clamp(t->place[2], 60), 2) * t->drift_square;
}

void twin_stage_turning(struct twin *t) {
    const struct fuse_twin_params *params = t->params;
    double away[3];
    double d2 = 0;
    const double norm = hypot(t->place[0], t->place[1]);
    if (norm < 1 || !t->has_reading) {
        return;
    }
    surprise_of(t, away);
    for (int i = 0; i < 3; ++i) {
        away[i] = twin_clamp(away[i], 90);
        d2 += pow(away[i] / params->surprise, 2);
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
    off = twin_clamp(off, 10);
    t->residual += (off * off - t->residual) / 64;
    // Of the heading's variance, what the field's covariance has already.
    const double unit = fmin(norm, 50) * DEGREE;  // uT a DEGREE
    const double seen = unit * unit * t->motion[(STATES + 1) * HEADING];
    const double turn[STATES] = {[HEADING] = unit};
    twin_read_motion(t, turn, fmax(noise + spread - fmin(seen, across), noise / 4), 2,
                     twin_clamp(off, params->field_step) * DEGREE);
}

static void weigh_field(struct twin *t, bool is_resting) {
    const struct fuse_twin_params *params = t->params;
    double away[3];
    double d2 = 0;
    double longer = 0;
    double length = 0;
    surprise_of(t, away);
    for (int i = 0; i < 3; ++i) {
        away[i] = twin_clamp(away[i], 90);
        d2 += pow(away[i] / params->surprise, 2);
        length += pow(twin_clamp(t->place[i], 90), 2);
    }
    for (int i = 0; i < 2; ++i) {
        longer += away[i] * (away[i] + 2 * twin_clamp(t->place[i], 90));
    }
    t->is_turned = d2 > 8 && fabs(away[2]) < 3 &&
                   fabs(longer) < 6 * (fabs(t->place[0]) + fabs(t->place[1]));
    longer += away[2] * (away[2] + 2 * twin_clamp(t->place[2], 90));
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
}

void twin_stage_field(struct twin *t, bool is_resting) {
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

// Takes a reading of both fields, which surprises by `away`.
static void take_field(struct twin *t, const double *row, double noise, double away) {
    static const double units[6] = {1, 1, 1, 1, 1, 1};
    double gain[6];
    twin_kalman(6, t->field, row, noise, units, 1, gain);
    for (int i = 0; i < 3; ++i) {
        t->place[i] = twin_clamp(t->place[i] + gain[i] * away, 3600);
        t->own[i] = twin_clamp(t->own[i] + gain[3 + i] * away, 400);
    }
}

void twin_stage_field_axis(struct twin *t, int axis) {
    double away[3];
    if (!t->has_reading) {
        return;
    }
    const double row[6] = {axis == 0,        axis == 1,        axis == 2,
                           t->rows[axis][0], t->rows[axis][1], t->rows[axis][2]};
    surprise_of(t, away);
    take_field(t, row, t->noise, twin_clamp(away[axis], t->params->field_step));
}

void twin_stage_own(struct twin *t, bool is_resting) {
    const struct fuse_twin_params *params = t->params;
    const double largest =
        fmax(fabs(t->own[0]), fmax(fabs(t->own[1]), fabs(t->own[2])));
    if (!t->has_reading || is_resting || t->astray > params->astray_share ||
        largest > params->own_near || params->own_sd > 2) {
        return;
    }
    const int axis = t->next_axis;
    const double row[6] = {[3] = axis == 0, [4] = axis == 1, [5] = axis == 2};
    take_field(t, row, pow(params->own_doubt, 2), -t->own[axis]);
    t->next_axis = (axis + 1) % 3;
}

void twin_find_heading_variance(struct twin *t) {
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
    const bool is_strange = t->astray > params->strange_share;
    t->heading_variance =
        ((is_strange ? pow(params->strange_sd, 2) : 0) +
         (is_unknown(t) ? across + 2.25 : params->covariance_share * across) +
         pow(twin_clamp(t->place[2], 60) * params->level_sd * DEGREE, 2) / 3 +
         pow(params->level_drift, 2) * leaning(t) +
         params->residual_share * fmax(0, t->residual - params->residual_free)) /
        (norm * norm);
}
