// SPDX-License-Identifier: MIT
// What build/sim/bench expects of the program that it runs: where in its work it is, as
// GPIOR0 says it, and the bytes of two variables.
#ifndef SIM_NANO_BENCH_H
#define SIM_NANO_BENCH_H

enum bench_mark { BENCH_TAKE = 1, BENCH_STEP = 2, BENCH_ANSWER = 3, BENCH_DONE = 4 };

enum {
    BENCH_SAMPLE_SIZE = 37,  // of `bench_sample`
    BENCH_ANSWER_SIZE = 16,  // of `bench_answer`
};

#endif
