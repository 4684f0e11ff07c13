// SPDX-License-Identifier: MIT
// What the files of fuse_twin.h share: its state and its mathematics. Private to them.
#ifndef FUSE_TWIN_PARTS_H
#define FUSE_TWIN_PARTS_H

#include "core/fusion/fuse_params.h"
#include "core/math/constant.h"
#include "fuse_twin.h"

#define DEGREE (3.14159265358979323846 / 180)

struct lowpass3 {
    double band[3], level[3];
};

enum {
    BIAS = 0,     // states of the gyroscope's filter: bias, deg/s
    SCALE = 3,    // scales, 500ths
    HEADING = 6,  // error of the integrated heading, deg
    STATES = 7,
    BEGIN_AGAIN = 1 << 30,  // as a number of windows
};

struct twin {
    const struct fuse_twin_settings *settings;
    double inertial[4], level[4], world[4];
    double force_sum[3];
    double turn_sum[3][3];  // by axis of the body, in the inertial frame
    struct lowpass3 force, rest_rate, rest_force;
    struct lowpass3 bias_row[2], scale_row[2], used[2];
    double tilting[2], drift[2], drift_square;  // rad/s
    double bias[3], calibrated[3], scale[3], motion[STATES * STATES];
    double turned;  // deg2: growth of the heading's variance in this window
    double rate[3];
    int windows, age, rest, looks, next_axis;
    // The mean of a window's field readings, and the attitude in the middle of it.
    double field_sum[3], middle[4];
    int field_count;
    double reading[3], rows[3][3];
    bool has_reading, is_turned;
    double place[3], own[3], field[36], noise, astray;
    double lag, lag_variance, slope[3];  // s, s2, uT/s: of the reading by the lag
    double across, along;                // uT: means of the surprise
    double drifting, heading_variance;   // uT2, rad2
    int learnt;
    enum fuse_twin_doubt { PLAIN, IMPOSSIBLE, UNLIKE } doubt;  // of the place
    bool is_own_unknown;
    int plain;                   // readings in a row without a doubt
    int same_force, same_field;  // measurements in a row that are equal
    const double *last_field;
};

// fuse_twin_math.c

// Of a Butterworth low-pass; until it has settled, the mean. `count`: inputs so far.
void twin_lowpass(struct lowpass3 *f, double step_s, double tau, const double *in,
                  int width, int count);
// Unit quaternions; `out` may be one of them.
void twin_multiply(const double *a, const double *b, double *out);
// `out` may be v.
void twin_rotate(const double *q, const double *v, double *out);
// The turn by a rate, rad/s, in some seconds.
void twin_turn_by(const double *rate, double seconds, double *out);
// Held within +-limit.
double twin_clamp(double value, double limit);
double twin_length(const double *v);
double twin_distance(const double *a, const double *b);
void twin_matrix_of(const double *q, double matrix[3][3]);
// One scalar reading: changes the covariance, gives the gains. Where one would be above
// 1 in the units of fuse.c, of which the states have `units` and the reading has
// `unit`, what that state has in common with the others is forgotten.
void twin_kalman(int states, double *covariance, const double *row, double noise,
                 const double *units, double unit, double *gain);

// fuse_twin.c

// Takes a reading of bias, scales and heading.
void twin_read_motion(struct twin *t, const double *row, double noise, double unit,
                      double surprise);

// fuse_twin_field.c

// No calibration has told the probe's own field.
bool twin_is_unknown(const struct twin *t);
// Predicts the field and weighs the reading.
void twin_stage_field(struct twin *t, bool is_resting);
// A reading across the horizontal field tells by how much the heading was turned by
// errors of the gyroscope.
void twin_stage_turning(struct twin *t);
// Takes one axis of the reading into the field of the place and of the probe.
void twin_stage_field_axis(struct twin *t, int axis);
// Learns that the probe has no own field, along one axis, where it seems so.
void twin_stage_own(struct twin *t, bool is_resting);
// Of what is stated, without its floor.
void twin_find_heading_variance(struct twin *t);

#endif
