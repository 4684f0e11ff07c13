// SPDX-License-Identifier: MIT
// What a filter on the bench has, and what it agrees on with sim/nano/bench.c.
#ifndef BENCH_H
#define BENCH_H

enum bench_mark { BENCH_TAKE = 1, BENCH_STEP = 2, BENCH_ANSWER = 3, BENCH_DONE = 4 };

enum {
    BENCH_RATE_HZ = 200,
    BENCH_MAG_RATE_HZ = 100,
    // `bench_sample`: rate, specific force and field, 3 numbers of 4 bytes each, and a
    // byte: whether the field is new. Integers as struct measurement of calibrate.h
    // begins, in which nothing clips, or floats in rad/s, m/s2 and uT.
    BENCH_SAMPLE_SIZE = 37,
    // `bench_answer`: w, x, y, z of 4 bytes each; q2_30 or floats.
    BENCH_ANSWER_SIZE = 16,
};

#ifdef __cplusplus
extern "C" {
#endif

void bench_init(void);
void bench_step(void);         // takes bench_sample
void bench_make_answer(void);  // makes bench_answer

#ifdef __cplusplus
}
#endif

// Of a filter in single precision.
struct bench_floats {
    float gyr[3], acc[3], mag[3];
    unsigned char has_mag;
};

#endif
