// SPDX-License-Identifier: MIT
// Between the files of run: see run.h for what boards call.
#ifndef SIM_RUN_PARTS_H
#define SIM_RUN_PARTS_H

#include <stdbool.h>
#include <stdint.h>

#include "run.h"

enum {
    RUN_MOTION_AFTER_US = 100000
};  // motion starts this long after the device clock

// Reads the arguments. 0 to go on, else the exit code plus 1.
int run_parse_options(struct run *run, char **rest);
// The value of a hexadecimal digit, or -1.
int run_hex_digit(char digit);

// The tick at a time of the device clock, which has to run.
uint64_t run_tick_of(const struct run *run, uint64_t device_us);
// Schedules the faults that don't wait for the device clock; then everything else, once
// that clock runs.
void run_schedule_at_power_up(struct run *run);
void run_schedule(struct run *run);
// The tick of the next event, or RUN_NEVER.
uint64_t run_next_event(const struct run *run);
void run_do_events(struct run *run);

// Whether a signal has come that ends the run.
bool run_is_stopping(void);
// Prints the summary and writes it to the file of --summary, if given. False, with a
// message, where that file can't be written.
bool run_summarize(struct run *run, bool is_good);

#endif
