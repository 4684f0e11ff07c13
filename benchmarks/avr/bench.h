// SPDX-License-Identifier: MIT
// The interface of a filter on the bench; build/sim/bench runs it.
#ifndef BENCH_H
#define BENCH_H

#include "nano/bench.h"

// `bench_sample`: rate, specific force and field, 3 numbers of 4 bytes each, and a
// byte: whether the field is new. Integers as struct measurement of calibrate.h begins,
// in which nothing clips, or floats in rad/s, m/s2 and uT. `bench_answer`: w, x, y, z
// of 4 bytes each; q2_30 or floats.
enum { BENCH_RATE_HZ = 200, BENCH_MAG_RATE_HZ = 100 };

#ifdef __cplusplus
extern "C" {
#endif

void bench_init(void);
void bench_step(void);         // takes bench_sample
void bench_make_answer(void);  // makes bench_answer

#ifdef __cplusplus
}
#endif

// A measurement for a filter in single precision.
struct bench_floats {
    float gyr[3], acc[3], mag[3];
    unsigned char has_mag;
};

#endif
