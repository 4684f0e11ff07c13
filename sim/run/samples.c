// SPDX-License-Identifier: MIT
// Counts the samples of a virtual board while it runs, and finds which of them belongs
// to which edge of the data-ready pin.
#include <string.h>

#include "run.h"

void run_on_data_ready(void *context) {
    struct run *run = context;
    run->data_ready++;
}

static uint64_t take_waiting(struct run *run) {
    if (run->waiting_count == 0) {
        return run->last_edge;
    }
    const uint64_t edge = run->waiting[0];
    run->waiting_count--;
    memmove(run->waiting, run->waiting + 1, run->waiting_count * sizeof edge);
    return edge;
}

void run_on_bus(void *context, bool is_start) {
    struct run *run = context;
    if (is_start) {
        run->burst_edge = run->data_ready;
        return;
    }
    if (run->burst_edge == run->last_edge) {
        return;  // a transaction of the set-up, not a sample's
    }
    // A processor that went to sleep has no sample to work on, so what still waits was
    // no sample either.
    const uint64_t asleep = run->board->asleep(run->self);
    if (!run->is_working && asleep != run->waiting_asleep) {
        run->waiting_count = 0;
    }
    run->last_edge = run->burst_edge;
    run->waiting_asleep = asleep;
    if (run->waiting_count == RUN_WAITING_MAX) {
        (void)take_waiting(run);
        run->late += run->samples > 0 ? 1 : 0;  // before the first sample it was set-up
    }
    run->waiting[run->waiting_count++] = run->burst_edge;
}

// A sample is late when the second data-ready edge after its own has come before its
// work ends. Each edge between two processed samples that was not processed counts as
// late too.
void run_on_mark(void *context, uint64_t tick, uint64_t cycle, bool is_begin) {
    struct run *run = context;
    if (run->profile != NULL) {
        (is_begin ? profile_begin_sample : profile_end_sample)(run->profile);
    }
    if (is_begin) {
        if (run->samples == 0 && !run->is_working) {
            run->first_mark_tick = tick;
            run->first_mark_asleep = run->board->asleep(run->self);
        }
        run->is_working = true;
        while (run->worked_edge == 0 && run->waiting_count > 1) {
            (void)take_waiting(run);  // set-up's, before the first sample
        }
        run->mark_cycle = cycle;
        run->work_edge = take_waiting(run);
        return;
    }
    if (!run->is_working) {
        return;
    }
    run->is_working = false;
    const uint64_t cycles = cycle - run->mark_cycle;
    run->samples++;
    run->cycles_sum += cycles;
    if (cycles > run->cycles_worst) {
        run->cycles_worst = cycles;
    }
    if (run->data_ready >= run->work_edge + 2) {
        run->late++;
    }
    if (run->worked_edge != 0 && run->work_edge > run->worked_edge + 1) {
        run->late += run->work_edge - run->worked_edge - 1;
    }
    run->worked_edge = run->work_edge;
}

void run_on_reset(void *context) {
    struct run *run = context;
    if (run->profile != NULL) {
        profile_reset(run->profile, run->board->profile_now(run->self));
    }
    run->is_working = false;
    run->worked_edge = 0;
    run->waiting_count = 0;
}
