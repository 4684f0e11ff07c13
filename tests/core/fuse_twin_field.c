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

// What is wrong with a field in the level frame.
static enum fuse_twin_doubt doubt_of(const struct twin *t, const double *field) {
    const double norm = twin_length(field);
    const double *known = t->settings->known_ut;
    const double apart =
        fabs(hypot(field[0], field[1]) - known[0]) + fabs(field[2] - known[1]);
    if (norm < FUSE_EARTH_MIN_UT || norm > FUSE_EARTH_MAX_UT) {
        return IMPOSSIBLE;
    }
    return apart * FUSE_UNLIKE_PART > fabs(known[0]) + fabs(known[1]) && known[0] != 0
               ? UNLIKE
               : PLAIN;
}

static void learn_place(struct twin *t, bool is_resting) {
    t->is_own_unknown = t->doubt != PLAIN || t->plain > 0;
    const double own = pow(
        t->is_own_unknown ? FUSE_OWN_UNKNOWN_SIGMA_UT : t->settings->own_sigma_ut, 2);
    double away[3];
    surprise_of(t, away);
    for (int i = 0; i < STATES; ++i) {
        t->motion[STATES * i + HEADING] = t->motion[STATES * HEADING + i] = 0;
    }
    ++t->learnt;
    memset(t->field, 0, sizeof t->field);
    for (int i = 0; i < 3; ++i) {
        t->place[i] += away[i] / t->learnt;
        t->field[7 * i] = own + pow(FUSE_PLACE_SIGMA_UT, 2) +
                          (is_resting ? 0 : pow(FUSE_PLACE_MOVING_SIGMA_UT, 2));
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
        const double slope = twin_clamp(t->place[j], FUSE_LAG_FIELD_MAX_UT) * rate[k] -
                             twin_clamp(t->place[k], FUSE_LAG_FIELD_MAX_UT) * rate[j];
        square += slope * slope;
        along += slope * twin_clamp(away[i], FUSE_FIELD_STEP_MAX_UT);
    }
    const double noise = 2 * t->noise;
    const double gain = t->lag_variance / (noise + t->lag_variance * square);
    t->lag = fmax(0, fmin(FUSE_LAG_MAX_S, t->lag - gain * along));
    t->lag_variance *= 1 - gain * square;
}

bool twin_is_unknown(const struct twin *t) {
    return t->is_own_unknown || t->settings->own_sigma_ut > FUSE_OWN_GOOD_SIGMA_UT;
}

// The uncertainty that a window adds to the field: that of the place turns with an
// error of the heading, and both fields wander, the probe's more where readings keep
// surprising.
static void predict_field(struct twin *t, bool is_resting) {
    const double wander = !t->has_reading ? FUSE_HEADING_WANDER_ALONE_DEG2_S
                          : t->is_turned  ? FUSE_HEADING_WANDER_TURNED_DEG2_S
                                          : FUSE_HEADING_WANDER_DEG2_S;
    const double turn = (FUSE_PER_WINDOW(wander) + t->turned) * DEGREE * DEGREE;
    const double x = twin_clamp(t->place[0], FUSE_FIELD_MAX_UT);
    const double y = twin_clamp(t->place[1], FUSE_FIELD_MAX_UT);
    if (t->field[0] + t->field[7] < FUSE_PLACE_SPREAD_MAX_UT2) {
        t->field[0] += turn * y * y;
        t->field[7] += turn * x * x;
        t->field[1] -= turn * x * y;
        t->field[6] = t->field[1];
    }
    for (int i = 0; i < 6; ++i) {
        const bool is_astray = t->astray > FUSE_ASTRAY_SHARE && !is_resting;
        const double place =
            FUSE_PLACE_WANDER_UT2_S + fmax(0, t->drifting) / FUSE_DRIFTING_WANDER_S;
        t->field[7 * i] += i < 3       ? FUSE_PER_WINDOW(place)
                           : is_astray ? FUSE_PER_WINDOW(FUSE_OWN_WANDER_ASTRAY_UT2_S)
                                       : FUSE_PER_WINDOW(FUSE_OWN_WANDER_UT2_S);
        t->field[7 * i] =
            fmin(t->field[7 * i], twin_is_unknown(t) ? FUSE_FIELD_UNKNOWN_MAX_UT2
                                                     : pow(FUSE_FIELD_SIGMA_MAX_UT, 2));
    }
}

// uT2: the vertical field, seen through a level that is still being corrected.
static double leaning(const struct twin *t) {
    return pow(twin_clamp(t->place[2], FUSE_FIELD_MAX_UT), 2) * t->drift_square;
}

void twin_stage_turning(struct twin *t) {
    double away[3];
    double d2 = 0;
    const double norm = hypot(t->place[0], t->place[1]);
    if (norm < FUSE_HORIZONTAL_MIN_UT || !t->has_reading) {
        return;
    }
    surprise_of(t, away);
    for (int i = 0; i < 3; ++i) {
        away[i] = twin_clamp(away[i], FUSE_SURPRISE_MAX_UT);
        d2 += pow(away[i] / FUSE_SURPRISE_UT, 2);
    }
    const double noise =
        FUSE_TURNING_SHARE * FUSE_FIELD_NOISE_UT2_S / FUSE_WINDOW_S *
            fmin(1 + d2, 1 + FUSE_TURNING_FAR) +
        fmin(FUSE_TURNING_DRIFT_S2 * leaning(t), FUSE_TURNING_LEANING_MAX_UT2);
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
    off = twin_clamp(off, FUSE_ACROSS_MAX_UT);
    t->across += (off - t->across) / FUSE_WINDOWS(FUSE_ACROSS_TAU_S);
    const double along =
        twin_clamp(away[1] * row[0] - away[0] * row[1], FUSE_ACROSS_MAX_UT);
    t->along += (along - t->along) / FUSE_WINDOWS(FUSE_ACROSS_TAU_S);
    if (t->rest != FUSE_LOOKS(FUSE_REST_S) &&
        sqrt(t->drift_square) < FUSE_DRIFTING_LEVEL_DPS * DEGREE) {
        t->drifting += (pow(t->across, 2) - pow(t->along, 2) - t->drifting) /
                       FUSE_WINDOWS(FUSE_DRIFTING_TAU_S);
    }
    // Of the heading's variance, what the field's covariance has already.
    const double unit = fmin(norm, FUSE_TURNING_FIELD_MAX_UT) * DEGREE;  // uT a DEGREE
    const double seen = unit * unit * t->motion[(STATES + 1) * HEADING];
    const double turn[STATES] = {[HEADING] = unit};
    twin_read_motion(t, turn, fmax(noise + spread - fmin(seen, across), noise / 4), 2,
                     twin_clamp(off, FUSE_FIELD_STEP_MAX_UT) * DEGREE);
}

static void weigh_field(struct twin *t, bool is_resting) {
    double away[3];
    double d2 = 0;
    double longer = 0;
    double length = 0;
    surprise_of(t, away);
    for (int i = 0; i < 3; ++i) {
        away[i] = twin_clamp(away[i], FUSE_SURPRISE_MAX_UT);
        d2 += pow(away[i] / FUSE_SURPRISE_UT, 2);
        length += pow(twin_clamp(t->place[i], FUSE_SURPRISE_MAX_UT), 2);
    }
    for (int i = 0; i < 2; ++i) {
        longer +=
            away[i] * (away[i] + 2 * twin_clamp(t->place[i], FUSE_SURPRISE_MAX_UT));
    }
    t->is_turned =
        d2 > FUSE_TURNED_SURPRISE && fabs(away[2]) < FUSE_SURPRISE_UT &&
        fabs(longer) < 2 * FUSE_SURPRISE_UT * (fabs(t->place[0]) + fabs(t->place[1]));
    longer += away[2] * (away[2] + 2 * twin_clamp(t->place[2], FUSE_SURPRISE_MAX_UT));
    t->noise = FUSE_FIELD_NOISE_UT2_S / FUSE_WINDOW_S * sqrt(1 + d2);
    if (is_resting) {
        t->noise *= FUSE_REST_FACTOR;
    } else {
        // An error of level or heading turns a reading, and leaves its length.
        const bool is_strange = d2 > 1 && !t->is_turned &&
                                fabs(longer) > 2 * FUSE_ASTRAY_LENGTH_UT * sqrt(length);
        t->astray += (is_strange - t->astray) / FUSE_WINDOWS(FUSE_ASTRAY_TAU_S);
    }
    t->noise =
        fmin(t->noise + FUSE_FIELD_DRIFT_S2 * leaning(t), FUSE_FIELD_NOISE_MAX_UT2);
    if (!is_resting) {
        read_lag(t, away);
    }
}

void twin_stage_field(struct twin *t, bool is_resting) {
    if (t->has_reading && t->windows == FUSE_WINDOWS(FUSE_LEVEL_TAU_S) && !is_resting) {
        t->learnt = 0;
    }
    if (t->has_reading && t->learnt == FUSE_WINDOWS(FUSE_LEARN_S)) {
        const bool is_plain = (t->is_own_unknown || t->doubt != PLAIN) &&
                              doubt_of(t, t->place) != PLAIN &&
                              doubt_of(t, t->reading) == PLAIN;
        t->plain = is_plain ? t->plain + 1 : 0;
        if (t->plain == FUSE_WINDOWS(FUSE_PLAIN_S)) {
            t->learnt = 0;
            memset(t->own, 0, sizeof t->own);
        }
    }
    if (t->has_reading && t->learnt < FUSE_WINDOWS(FUSE_LEARN_S)) {
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
        t->place[i] = twin_clamp(t->place[i] + gain[i] * away, FUSE_PLACE_MAX_UT);
        t->own[i] = twin_clamp(t->own[i] + gain[3 + i] * away, FUSE_OWN_MAX_UT);
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
    take_field(t, row, t->noise, twin_clamp(away[axis], FUSE_FIELD_STEP_MAX_UT));
}

void twin_stage_own(struct twin *t, bool is_resting) {
    const double largest =
        fmax(fabs(t->own[0]), fmax(fabs(t->own[1]), fabs(t->own[2])));
    if (!t->has_reading || is_resting || t->astray > FUSE_ASTRAY_SHARE ||
        largest > FUSE_OWN_NEAR_UT ||
        t->settings->own_sigma_ut > FUSE_OWN_CALIBRATED_SIGMA_UT) {
        return;
    }
    const int axis = t->next_axis;
    const double row[6] = {[3] = axis == 0, [4] = axis == 1, [5] = axis == 2};
    take_field(t, row, pow(FUSE_OWN_DOUBT_UT, 2), -t->own[axis]);
    t->next_axis = (axis + 1) % 3;
}

// Whether and why there is no heading. Turning may have shown that a probe has no field
// of its own: then an unlike place is another one.
static void doubt_place(struct twin *t) {
    const double least_known = fmax(t->field[21], fmax(t->field[28], t->field[35]));
    double own = 0;
    for (int i = 0; i < 3; ++i) {
        own = fmax(own, fabs(t->own[i]));
    }
    t->doubt = doubt_of(t, t->place);
    if (t->is_own_unknown && least_known <= pow(FUSE_ELSEWHERE_SIGMA_UT, 2) &&
        own <= FUSE_OWN_NEAR_UT) {
        t->is_own_unknown = t->doubt != PLAIN;
        t->doubt = t->doubt == UNLIKE ? PLAIN : t->doubt;
    }
    if (t->settings->own_sigma_ut > FUSE_OWN_CALIBRATED_SIGMA_UT &&
        own > FUSE_OWN_IMPOSSIBLE_UT) {
        t->doubt = IMPOSSIBLE;
    }
}

void twin_find_heading_variance(struct twin *t) {
    const double norm = hypot(t->place[0], t->place[1]);
    if (norm < FUSE_HORIZONTAL_MIN_UT) {
        t->learnt = 0;
        t->heading_variance = INFINITY;
        return;
    }
    doubt_place(t);
    const double x = t->place[0] / norm;
    const double y = t->place[1] / norm;
    const double across =
        y * y * t->field[0] - 2 * x * y * t->field[1] + x * x * t->field[7];
    const double along = t->field[0] + t->field[7] - across;
    const double share = twin_is_unknown(t) ? 1 : FUSE_COVARIANCE_SHARE;
    const double least = norm - FUSE_HEADING_WORST * sqrt(fmax(0, share * along));
    if (least < FUSE_HORIZONTAL_MIN_UT) {
        t->heading_variance = INFINITY;
        return;
    }
    t->heading_variance =
        (FUSE_HEADING_ACROSS * pow(t->across, 2) + FUSE_HEADING_ASTRAY_UT2 * t->astray +
         (twin_is_unknown(t) ? across + pow(FUSE_UNCALIBRATED_SIGMA_UT, 2)
                             : FUSE_COVARIANCE_SHARE * across) +
         pow(twin_clamp(t->place[2], FUSE_FIELD_MAX_UT) * t->settings->level_sigma_deg *
                 DEGREE,
             2) /
             FUSE_LEVEL_SHARE +
         pow(FUSE_HEADING_DRIFT_S, 2) * leaning(t)) /
        (least * least);
}
