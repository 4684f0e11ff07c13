// SPDX-License-Identifier: MIT
// The device clock: Timer1, started by start.S, and 32 bits of microseconds over it.
#ifndef CLOCK_H
#define CLOCK_H

#include <avr/io.h>
#include <stdint.h>

enum { CLOCK_TICKS_PER_US = 2 };

// Of the last overflow of Timer1. Written by its interrupt only.
extern volatile uint32_t clock_overflow_us;

void clock_init(void);

// Device time of `ticks`, which were read from TCNT1 just now, for interrupt handlers:
// interrupts must be off. An overflow whose handler has not run is known by its flag,
// and came before a reading from the lower half. Inline without choice: a call would
// have the handler save all registers first.
__attribute__((always_inline)) static inline uint32_t clock_us_masked(uint16_t ticks) {
    uint32_t us = clock_overflow_us + ticks / CLOCK_TICKS_PER_US;
    if ((TIFR1 & _BV(TOV1)) != 0 && ticks < 0x8000) {
        us += 0x10000 / CLOCK_TICKS_PER_US;
    }
    return us;
}

#endif
