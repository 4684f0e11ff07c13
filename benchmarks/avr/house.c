// SPDX-License-Identifier: MIT
// A filter of firmware/core, the one that -DFILTER=name says.
#include "bench.h"

#include "core/drivers/mpu9250.h"

#define TEXT(name) #name
// Spaces would be part of the name.
// clang-format off
#define HEADER(name) TEXT(core/fusion/name.h)
// clang-format on
#include HEADER(FILTER)

#define PASTE(one, other) one##_##other
#define JOIN(one, other) PASTE(one, other)
#define CALL(verb) JOIN(FILTER, verb)

struct measurement bench_sample;
struct quat bench_answer;
static struct FILTER filter;

void bench_init(void) {
    CALL(init)(&filter, BENCH_RATE_HZ, MPU9250_GYR_DELAY_US);
}

void bench_step(void) {
    CALL(step)(&filter, &bench_sample, 1000000 / BENCH_RATE_HZ);
}

void bench_make_answer(void) {
    CALL(orientation)(&filter, &bench_answer);
}
