// SPDX-License-Identifier: MIT
// Sample after sample through a filter, with a mark between what is measured.
#include "bench.h"

#ifdef __AVR__

#include <avr/io.h>

int main(void) {
    bench_init();
    for (;;) {
        GPIOR0 = BENCH_TAKE;
        GPIOR0 = BENCH_STEP;
        bench_step();
        GPIOR0 = BENCH_ANSWER;
        bench_make_answer();
        GPIOR0 = BENCH_DONE;
    }
}

#else

// The same filter on this machine: samples from standard input, answers to its output.
#include <stdio.h>

extern unsigned char bench_sample[], bench_answer[];

int main(void) {
    bench_init();
    while (fread(bench_sample, BENCH_SAMPLE_SIZE, 1, stdin) == 1) {
        bench_step();
        bench_make_answer();
        if (fwrite(bench_answer, BENCH_ANSWER_SIZE, 1, stdout) != 1) {
            return 1;
        }
    }
    return 0;
}

#endif
