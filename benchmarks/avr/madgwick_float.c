// SPDX-License-Identifier: MIT
// Madgwick's filter of nine axes in single precision, as rival probes run it.
//
// "An efficient orientation filter for inertial and inertial/magnetic sensor arrays",
// 2010. Equations by number; q is world_from_body, x of the world magnetic north.
#include <math.h>

#include "bench.h"

// Equation 50: the gyroscope's error of 0.041 / sqrt(3/4) = 0.047 rad/s.
static const float beta = 0.041F;
static const float period_s = 1.0F / BENCH_RATE_HZ;

struct bench_floats bench_sample;
struct {
    float w, x, y, z;
} bench_answer;
static float w, x, y, z;
static float mag[3];  // the last reading: a filter of one rate wants one each step

void bench_init(void) {
    w = 1.0F;
}

static void normalise(float *v, unsigned char length) {
    float square = 0.0F;
    for (unsigned char i = 0; i < length; i++) {
        square += v[i] * v[i];
    }
    if (square > 0.0F) {
        const float scale = 1.0F / sqrtf(square);
        for (unsigned char i = 0; i < length; i++) {
            v[i] *= scale;
        }
    }
}

void bench_step(void) {
    const float *gyr = bench_sample.gyr;
    float *a = bench_sample.acc;
    float m[3];
    if (bench_sample.has_mag) {
        for (unsigned char i = 0; i < 3; i++) {
            mag[i] = bench_sample.mag[i];
        }
    }
    // The rate of change by the gyroscope, equation 12.
    float change[4] = {
        0.5F * (-x * gyr[0] - y * gyr[1] - z * gyr[2]),
        0.5F * (w * gyr[0] + y * gyr[2] - z * gyr[1]),
        0.5F * (w * gyr[1] - x * gyr[2] + z * gyr[0]),
        0.5F * (w * gyr[2] + x * gyr[1] - y * gyr[0]),
    };
    for (unsigned char i = 0; i < 3; i++) {
        m[i] = mag[i];
    }
    normalise(a, 3);
    normalise(m, 3);
    // The field in the world, and its inclination, equations 45 and 46.
    const float hx = 2.0F * (m[0] * (0.5F - y * y - z * z) + m[1] * (x * y - w * z) +
                             m[2] * (x * z + w * y));
    const float hy = 2.0F * (m[0] * (x * y + w * z) + m[1] * (0.5F - x * x - z * z) +
                             m[2] * (y * z - w * x));
    const float bz = 2.0F * (m[0] * (x * z - w * y) + m[1] * (y * z + w * x) +
                             m[2] * (0.5F - x * x - y * y));
    const float bx = sqrtf(hx * hx + hy * hy);
    // Expected less measured directions, equation 31.
    const float down_x = x * z - w * y;
    const float down_y = w * x + y * z;
    const float down_z = 0.5F - x * x - y * y;
    const float f1 = 2.0F * down_x - a[0];
    const float f2 = 2.0F * down_y - a[1];
    const float f3 = 2.0F * down_z - a[2];
    const float f4 = 2.0F * (bx * (0.5F - y * y - z * z) + bz * down_x) - m[0];
    const float f5 = 2.0F * (bx * (x * y - w * z) + bz * down_y) - m[1];
    const float f6 = 2.0F * (bx * (w * y + x * z) + bz * down_z) - m[2];
    // Half the transposed Jacobian of equation 32 times them, equation 34: its length
    // doesn't matter.
    float slope[4] = {
        x * f2 - y * f1 - bz * y * f4 + (bz * x - bx * z) * f5 + bx * y * f6,
        z * f1 + w * f2 - 2.0F * x * f3 + bz * z * f4 + (bx * y + bz * w) * f5 +
            (bx * z - 2.0F * bz * x) * f6,
        z * f2 - w * f1 - 2.0F * y * f3 - (2.0F * bx * y + bz * w) * f4 +
            (bx * x + bz * z) * f5 + (bx * w - 2.0F * bz * y) * f6,
        x * f1 + y * f2 + (bz * x - 2.0F * bx * z) * f4 + (bz * y - bx * w) * f5 +
            bx * x * f6,
    };
    normalise(slope, 4);
    // Equations 33 and 42.
    float q[4] = {w, x, y, z};
    for (unsigned char i = 0; i < 4; i++) {
        q[i] += (change[i] - beta * slope[i]) * period_s;
    }
    normalise(q, 4);
    w = q[0];
    x = q[1];
    y = q[2];
    z = q[3];
}

// North to y: a quarter turn about z.
void bench_make_answer(void) {
    const float half = 0.70710678F;
    bench_answer.w = half * (w - z);
    bench_answer.x = half * (x - y);
    bench_answer.y = half * (y + x);
    bench_answer.z = half * (z + w);
}
