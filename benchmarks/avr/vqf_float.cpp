// SPDX-License-Identifier: MIT
// VQF by its authors, and with -DBASIC the version without rest, bias and rejection.
// Their source (MIT) is fetched by benchmarks/firmware/cycles.py; `double` has 32 bits here.
#include "bench.h"

#ifdef BASIC
#include "basicvqf.hpp"
typedef BasicVQF Filter;
#else
#include "vqf.hpp"
typedef VQF Filter;
#endif

extern "C" {
struct bench_floats bench_sample;
vqf_real_t bench_answer[4];
}

static Filter filter(1.0 / BENCH_RATE_HZ, 1.0 / BENCH_RATE_HZ, 1.0 / BENCH_MAG_RATE_HZ);

void bench_init(void) {
}

void bench_step(void) {
    filter.updateGyr(bench_sample.gyr);
    filter.updateAcc(bench_sample.acc);
    if (bench_sample.has_mag) {
        filter.updateMag(bench_sample.mag);
    }
}

void bench_make_answer(void) {
    filter.getQuat9D(bench_answer);
}
