// SPDX-License-Identifier: MIT
// A wake-up every few milliseconds for what has no interrupt; the clock itself is in
// handlers.S.
#include "clock.h"

#include <avr/io.h>

enum {
    // Often enough to debounce a button by looking at it, and within board.h's 5 ms:
    // 4 ms, in clocks of F_CPU / 256.
    WAKE_UP_CLOCKS = F_CPU / 256 / 250,
};

void clock_init(void) {
    TIMSK1 = _BV(TOIE1);
    OCR0A = WAKE_UP_CLOCKS - 1;
    TCCR0A = _BV(WGM01);  // from 0 to OCR0A
    TCCR0B = _BV(CS02);
    TIMSK0 = _BV(OCIE0A);
}
