// SPDX-License-Identifier: MIT
// See fuse_twin.h. Written from the equations, with libm's functions throughout.
#include "fuse_twin.h"

#include <math.h>
#include <string.h>

#define HISTORY 4
static const double degree = 3.14159265358979323846 / 180;

struct lowpass3 {
    double band[3], level[3];
};

static void lowpass(struct lowpass3 *f, double rate, double tau, const double *in,
                    int count) {
    const double g = tan(1 / (rate * tau * sqrt(2)));
    const double feedback = 1 / (1 + g * (g + sqrt(2)));
    for (int i = 0; i < 3; ++i) {
        const double error = in[i] - f->level[i];
        if (count <= (int)(rate * tau)) {
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
    const double t[3] = {2 * (q[2] * v[2] - q[3] * v[1]), 2 * (q[3] * v[0] - q[1] * v[2]),
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
    const double gain = fabs(angle) > 1e-12 ? sin(angle / 2) / angle * seconds : seconds / 2;
    out[0] = cos(angle / 2);
    for (int i = 0; i < 3; ++i) {
        out[i + 1] = rate[i] * gain;
    }
}

static double wrap(double angle) {
    return remainder(angle, 360 * degree);
}

static double clamp(double value, double limit) {
    return fmax(-limit, fmin(limit, value));
}

static double distance(const double *a, const double *b) {
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}

void fuse_twin_run(int count, int rate_hz, double gyr_delay_s, const double *gyr,
                   const double *acc, const double *mag, const bool *has_mag,
                   const double *interval_s, int calibrated_at, const double *bias_found,
                   double *quaternions) {
    const double one[4] = {1, 0, 0, 0};
    double inertial[4], level[4], product[4], history[HISTORY][4];
    struct lowpass3 force = {{0}, {0}};
    struct lowpass3 rest_rate = {{0}, {0}};
    struct lowpass3 rest_force = {{0}, {0}};
    struct lowpass3 field_mean = {{0}, {0}};
    double bias[3] = {0, 0, 0};
    double calibrated[3] = {0, 0, 0};
    double reference[2] = {0, 0};
    double ratio = pow(0.5 / 0.03, 2);
    double heading = 0;
    const double heading_max = 1;
    double variance = heading_max;
    bool is_heading_known = false;
    int rest = 0;
    int looks = 0;
    bool rest_is_due = false;
    bool level_is_due = false;
    bool has_waited = false;
    int fields = 0;
    int phase = 0;
    const int stride = (rate_hz + 199) / 200;
    const int rest_needed = rate_hz * 3 / 4;
    memcpy(inertial, one, sizeof one);
    memcpy(level, one, sizeof one);
    for (int k = 0; k < count; ++k) {
        double rate[3], limited[3], v[3], turn[4];
        if (k == calibrated_at) {
            memcpy(bias, bias_found, sizeof bias);
            memcpy(calibrated, bias_found, sizeof bias);
            ratio = 1.0 / 9;
        }
        for (int i = 0; i < 3; ++i) {
            limited[i] = clamp(gyr[3 * k + i], 10);
            rate[i] = gyr[3 * k + i] - bias[i];
        }
        turn_by(rate, interval_s[k], turn);
        multiply(inertial, turn, inertial);
        rotate(inertial, acc + 3 * k, v);
        lowpass(&force, rate_hz, 3, v, k + 1);
        if (k % 2 == 1) {
            rest_is_due = true;
        } else {
            level_is_due = true;
        }
        has_waited = k > 0 && has_mag[k] && !has_waited;
        if (rest_is_due && !has_waited) {
            rest_is_due = false;
            ++looks;
            lowpass(&rest_rate, rate_hz / 2.0, 0.5, limited, looks);
            lowpass(&rest_force, rate_hz / 2.0, 0.5, acc + 3 * k, looks);
            bool is_still = distance(limited, rest_rate.level) < 2 * degree &&
                            distance(acc + 3 * k, rest_force.level) < 0.5;
            for (int i = 0; i < 3; ++i) {
                is_still =
                    is_still && fabs(rest_rate.level[i] - calibrated[i]) <= 2 * degree;
            }
            rest = is_still ? (rest < rest_needed ? rest + 1 : rest) : 0;
            ratio = fmin(ratio + 2 * 0.01 / 100 / 0.0009 / rate_hz, pow(0.5 / 0.03, 2));
            if (rest == rest_needed) {
                const double gain = ratio / (ratio + 1);
                ratio -= ratio * gain;
                for (int i = 0; i < 3; ++i) {
                    bias[i] += (rest_rate.level[i] - bias[i]) * gain;
                }
            }
        }
        if (level_is_due && !has_waited) {
            level_is_due = false;
            rotate(level, force.level, v);
            const double norm = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
            if (norm >= 1) {
                if (v[2] < 0) {
                    const double half[4] = {0, 1, 0, 0};
                    multiply(half, level, level);
                    v[1] = -v[1];
                    v[2] = -v[2];
                }
                const double c = sqrt((1 + v[2] / norm) / 2);
                const double up[4] = {c, v[1] / norm / (2 * c), -v[0] / norm / (2 * c), 0};
                multiply(up, level, level);
            }
        }
        multiply(level, inertial, product);
        for (int i = 0; k == 0 && i < HISTORY; ++i) {
            memcpy(history[i], product, sizeof product);
        }
        if (++phase >= stride) {
            phase = 0;
            memmove(history[1], history[0], sizeof history - sizeof history[0]);
            memcpy(history[0], product, sizeof product);
        }
        variance = fmin(variance + 0.3 * degree * degree * interval_s[k], heading_max);
        if (has_mag[k]) {
            const double lag = (0.0125 * rate_hz - phase) / stride;
            const int newer = (int)lag;
            double mixed[4], f[3];
            for (int i = 0; i < 4; ++i) {
                mixed[i] = history[newer][i] +
                           (history[newer + 1][i] - history[newer][i]) * (lag - newer);
            }
            multiply(mixed, one, mixed);
            rotate(mixed, mag + 3 * k, f);
            const double now[3] = {sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]), f[2], 0};
            double weight = 1;
            const bool is_learning = fields < 200;
            fields += is_learning;
            lowpass(&field_mean, 100, 0.3, now, fields);
            if (is_learning) {
                reference[0] += (now[0] - reference[0]) / fields;
                reference[1] += (now[1] - reference[1]) / fields;
            } else {
                const double away[2] = {field_mean.level[0] - reference[0],
                                        field_mean.level[1] - reference[1]};
                const double d2 = pow(clamp(away[0], 90) / 3, 2) +
                                  pow(clamp(away[1], 180) / 6, 2);
                weight = pow(1 / (1 + d2), 3);
                if (d2 < 1 && rest == 0) {
                    reference[0] += away[0] * 0.01 / 22;
                    reference[1] += away[1] * 0.01 / 22;
                }
            }
            if (fabs(f[0]) >= 1 || fabs(f[1]) >= 1) {
                const double noise = 22 * degree * degree * 100;
                const double measured = atan2(f[0], f[1]);
                if (!is_heading_known) {
                    is_heading_known = true;
                    heading = measured;
                    variance = noise;
                } else {
                    const double gain = weight * variance / (weight * variance + noise);
                    const double away = wrap(measured - heading);
                    heading += (fields < 200 ? away : clamp(away, 15 * degree)) * gain;
                    variance -= variance * gain;
                }
            }
        }
        const double about_z[4] = {cos(heading / 2), 0, 0, sin(heading / 2)};
        double *out = quaternions + 4 * k;
        multiply(about_z, product, out);
        turn_by(rate, gyr_delay_s - 0.5 / rate_hz, turn);
        multiply(out, turn, out);
    }
}
