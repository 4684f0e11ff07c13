// SPDX-License-Identifier: MIT
// The clock tree, and the device clock: TIM2, 32 bits of microseconds since reset.
#ifndef CLOCK_H
#define CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

// Starts the device clock at 0, on the oscillator that a reset leaves running.
void clock_start(void);

// To 168 MHz from the crystal or, where it does not start or has a frequency that
// clock.c does not list, from the oscillator inside. Takes 53 ms at most.
void clock_init(void);

// NMI: the crystal has stopped. The processor continues from the oscillator inside,
// which is good to 1 % at 25 degC, 4 % from -10 to 85 degC (data sheet, "HSI oscillator
// characteristics").
void clock_failed(void);

// True where it runs from the oscillator inside.
bool clock_is_spare(void);

static inline uint32_t clock_us(void) {
    return TIM2->cnt;
}

#endif
