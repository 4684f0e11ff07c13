// SPDX-License-Identifier: MIT
// Device time, and a wake-up every few milliseconds for what has no interrupt.
#include "clock.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

#include "../board.h"
#include "idle.h"

// Often enough to debounce a button by looking at it, and within board.h's 5 ms.
enum { WAKE_UP_TICKS = 4000 * CLOCK_TICKS_PER_US };

volatile uint32_t clock_overflow_us;

void clock_init(void) {
    OCR1A = (uint16_t)(TCNT1 + WAKE_UP_TICKS);
    TIMSK1 = _BV(TOIE1) | _BV(OCIE1A);
}

ISR(TIMER1_OVF_vect) {
    clock_overflow_us += 0x10000 / CLOCK_TICKS_PER_US;
}

ISR(TIMER1_COMPA_vect) {
    OCR1A += WAKE_UP_TICKS;
    idle_has_work = true;
}

uint32_t board_time_us(void) {
    uint32_t us;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        us = clock_us_masked(TCNT1);
    }
    return us;
}
