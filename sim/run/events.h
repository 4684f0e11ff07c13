// SPDX-License-Identifier: MIT
// Scheduled events of a board in a run.
#ifndef SIM_RUN_EVENTS_H
#define SIM_RUN_EVENTS_H

#include <stdint.h>

#include "run.h"

// From the start of the device clock until the motion begins.
enum { RUN_MOTION_AFTER_US = 100000 };

// The tick at a time of the device clock, which has to run.
uint64_t run_tick_of(const struct run *run, uint64_t device_us);
// Schedules the faults that don't wait for the device clock; then everything else, once
// that clock runs.
void run_schedule_at_power_up(struct run *run);
void run_schedule(struct run *run);
// The tick of the next event, or RUN_NEVER.
uint64_t run_next_event(const struct run *run);
void run_do_events(struct run *run);

#endif
