// SPDX-License-Identifier: MIT
// Rotations, the low-pass and the Kalman filter of the twin in doubles.
#include <math.h>
#include <string.h>

#include "fuse_twin_parts.h"

void twin_lowpass(struct lowpass3 *f, double step_s, double tau, const double *in,
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

void twin_multiply(const double *a, const double *b, double *out) {
    const double q[4] = {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                         a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                         a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                         a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
    const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; ++i) {
        out[i] = q[i] / norm;
    }
}

void twin_rotate(const double *q, const double *v, double *out) {
    const double t[3] = {2 * (q[2] * v[2] - q[3] * v[1]),
                         2 * (q[3] * v[0] - q[1] * v[2]),
                         2 * (q[1] * v[1] - q[2] * v[0])};
    const double turned[3] = {v[0] + q[0] * t[0] + q[2] * t[2] - q[3] * t[1],
                              v[1] + q[0] * t[1] + q[3] * t[0] - q[1] * t[2],
                              v[2] + q[0] * t[2] + q[1] * t[1] - q[2] * t[0]};
    memcpy(out, turned, sizeof turned);
}

void twin_turn_by(const double *rate, double seconds, double *out) {
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

double twin_clamp(double value, double limit) {
    return fmax(-limit, fmin(limit, value));
}

double twin_length(const double *v) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

double twin_distance(const double *a, const double *b) {
    const double away[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return twin_length(away);
}

void twin_matrix_of(const double *q, double matrix[3][3]) {
    for (int j = 0; j < 3; ++j) {
        const double unit[3] = {j == 0, j == 1, j == 2};
        double column[3];
        twin_rotate(q, unit, column);
        for (int i = 0; i < 3; ++i) {
            matrix[i][j] = column[i];
        }
    }
}

void twin_kalman(int states, double *covariance, const double *row, double noise,
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
        if (fabs(shared[a]) > units[a] / unit * spread) {
            for (int b = 0; b < states; ++b) {
                if (a != b) {
                    covariance[a * states + b] = covariance[b * states + a] = 0;
                }
            }
            shared[a] = 0;
        }
        gain[a] = shared[a] / spread;
    }
    for (int a = 0; a < states; ++a) {
        for (int b = 0; b <= a; ++b) {
            covariance[a * states + b] -= gain[a] * shared[b];
            covariance[b * states + a] = covariance[a * states + b];
        }
    }
}
