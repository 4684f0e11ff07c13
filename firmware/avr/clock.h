// SPDX-License-Identifier: MIT
// The device clock: Timer1, started by start.S, and 32 bits of microseconds over it
// (board_time_us). Timer0 wakes the main loop.
#ifndef CLOCK_H
#define CLOCK_H

enum { CLOCK_TICKS_PER_US = 2 };

void clock_init(void);

#endif
