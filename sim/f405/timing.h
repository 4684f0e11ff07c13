// SPDX-License-Identifier: MIT
// Time of the virtual STM32F405 in picoseconds since power-on, and the schedule of its
// events.
#ifndef SIM_F405_TIMING_H
#define SIM_F405_TIMING_H

#include <stdint.h>

#include "map.h"

struct f405;

// Each event is set for one moment at most; at the same moment they come in this order.
enum f405_event {
    EVENT_OSCILLATORS,
    EVENT_CHIP,
    EVENT_FLASH,
    EVENT_IWDG,
    EVENT_SYSTICK,
    EVENT_TIMER2,
    EVENT_TIMER3,
    EVENT_TIMER4,
    EVENT_TIMER5,
    EVENT_TIMER11,
    EVENT_I2C,
    EVENT_USART_SENT,
    EVENT_USART_RECEIVED,
    EVENT_USART_IDLE,
    EVENT_SPI,
    EVENT_ADC,
    EVENT_RADIO,
    EVENTS,
};

uint64_t f405_now(const struct f405 *m);
// The same; but during an event the moment for which it was set, as the core may be one
// instruction further.
uint64_t f405_when(const struct f405 *m);
uint64_t f405_ns(uint64_t ps);
// The duration of n cycles of a clock of so many hertz, in ps.
uint64_t f405_ps(uint64_t cycles, uint32_t hz);
// The first cycle of the core at or after that time.
uint64_t f405_cycle_at(const struct f405 *m, uint64_t ps);

// Sets an event's moment; an earlier one is forgotten.
void f405_at(struct f405 *m, enum f405_event event, uint64_t ps);
void f405_never(struct f405 *m, enum f405_event event);
// Finds the next event again, after m->at has been written to directly.
void f405_find_next(struct f405 *m);
// Has the core stop before its next instruction, to look at interrupts.
void f405_attend(struct f405 *m);

#endif
