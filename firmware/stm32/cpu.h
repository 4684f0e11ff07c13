// SPDX-License-Identifier: MIT
// What C has no words for: interrupts off and on, sleep, and the lines of the NVIC.
#ifndef CPU_H
#define CPU_H

#include <stdint.h>

#include "registers.h"

// Priorities, of which the upper four bits count. Lines of one priority never interrupt
// each other: TIM3 and I2C share their variables unmasked.
enum {
    PRIORITY_SAMPLING = 0x00,
    PRIORITY_WIRE = 0x40,
    PRIORITY_CARD = 0x80,
    PRIORITY_TICK = 0xF0,
};

static inline uint32_t cpu_mask(void) {
    uint32_t primask;
    __asm__ volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask)::"memory");
    return primask;
}

static inline void cpu_unmask(uint32_t primask) {
    __asm__ volatile("msr primask, %0" ::"r"(primask) : "memory");
}

// Sleeps until an interrupt is pending, then lets it in: the isb keeps a mask that
// follows from coming before it (PM0214, "ISB"). Call it masked; it returns masked.
static inline void cpu_sleep(void) {
    __asm__ volatile("dsb\n\twfi\n\tcpsie i\n\tisb\n\tcpsid i" ::: "memory");
}

static inline void cpu_barrier(void) {
    __asm__ volatile("dsb\n\tisb" ::: "memory");
}

static inline void irq_enable(enum irq line, uint8_t priority) {
    NVIC->ipr[line] = priority;
    NVIC->icpr[line / 32] = BIT(line % 32);
    NVIC->iser[line / 32] = BIT(line % 32);
}

static inline void irq_disable(enum irq line) {
    NVIC->icer[line / 32] = BIT(line % 32);
    cpu_barrier();
}

#endif
