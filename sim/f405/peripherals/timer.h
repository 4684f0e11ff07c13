// SPDX-License-Identifier: MIT
// The timers TIM2 to TIM5, units 0 to 3.
#ifndef SIM_F405_PERIPHERALS_TIMER_H
#define SIM_F405_PERIPHERALS_TIMER_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

enum { TIMERS = 4 };

struct f405_timer {
    uint32_t cr1, cr2, dier, sr, ccmr[2], ccer, psc, arr, ccr[4], option;
    uint32_t shadow_psc, shadow_arr;
    uint64_t from;  // when the counter had the value `count`
    uint32_t count;
    uint64_t seen;  // ticks since `from` whose matches are in sr
};

void timer_reset(struct f405 *m, unsigned unit);
void timer_event(struct f405 *m, unsigned unit);
// The timers' clock is about to change, or has changed.
void timer_clock_changes(struct f405 *m, bool is_before);
// An edge at a pin that may be a timer's capture input.
void timer_edge(struct f405 *m, unsigned port, unsigned pin, bool is_high);
uint32_t timer_read(struct f405 *m, unsigned unit, uint32_t at);
void timer_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
