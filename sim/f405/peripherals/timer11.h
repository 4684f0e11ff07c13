// SPDX-License-Identifier: MIT
// The timer TIM11, whose channel can look at the crystal.
#ifndef SIM_F405_PERIPHERALS_TIMER11_H
#define SIM_F405_PERIPHERALS_TIMER11_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_timer11 {
    uint32_t cr1, sr, ccmr1, ccer, psc, arr, ccr1, option;
    uint32_t shadow_psc;
    uint64_t from;  // when the counter had the value `count`
    uint32_t count;
    uint64_t edge;  // the number, since HSE is ready, of the edge to be captured next
};

void timer11_reset(struct f405 *m, unsigned unit);
// An edge of HSE_RTC that is captured.
void timer11_event(struct f405 *m);
// The timer's clock is about to change, or has changed.
void timer11_clock_changes(struct f405 *m, bool is_before);
// HSE has started or stopped, or its divider has changed.
void timer11_follow(struct f405 *m);
uint32_t timer11_read(struct f405 *m, unsigned unit, uint32_t at);
void timer11_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
