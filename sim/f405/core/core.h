// SPDX-License-Identifier: MIT
// The Cortex-M4 around its instructions: exceptions, NVIC, SCB, SysTick, cycle counter.
#ifndef SIM_F405_CORE_CORE_H
#define SIM_F405_CORE_CORE_H

#include <stdbool.h>
#include <stdint.h>

#include "f405/map.h"

struct f405;

struct f405_core {
    bool pending[EXCEPTIONS], active[EXCEPTIONS], enabled[EXCEPTIONS];
    bool level[EXCEPTIONS];  // the peripheral still asks for it
    uint8_t priority[EXCEPTIONS];
    uint32_t vtor, aircr, scr, ccr, shcsr, cfsr, hfsr, dfsr, mmfar, bfar, cpacr;
    uint32_t fpccr, fpcar, fpdscr, demcr, dwt_control, debug;
    uint64_t cycles_at;  // awake cycle at which DWT_CYCCNT was 0
    bool counts_cycles;
    uint32_t cycles_held;
    // SysTick
    uint32_t tick_control, tick_load, tick_held;
    uint64_t tick_from;  // when the counter had the value tick_held
    bool has_event;      // the event register, for WFE
};

enum {
    CORE_PRIORITY_MASK = 0xF0,  // the four bits of a priority that exist
    CORE_CCR_ALIGN = 1 << 9,    // STKALIGN
};

void core_reset(struct f405 *m);
// The level of an exception's line: an NVIC line, or the NMI.
void core_irq(struct f405 *m, unsigned exception, bool level);
void core_pend(struct f405 *m, unsigned exception);
// The most urgent exception that is pending and enabled; 0: none.
unsigned core_find_pending(const struct f405 *m);
// Enters the exception that is due, if one is. True where it did.
bool core_take(struct f405 *m);
// Whether a pending exception ends the core's sleep; whether one ever can.
bool core_wakes(const struct f405 *m);
bool core_can_wake(const struct f405 *m);
// After WFI, WFE or on the way out of the last handler. False: it continues at once.
bool core_sleep(struct f405 *m);
void core_return(struct f405 *m, uint32_t exc_return);
// With the bits of CFSR that say why.
void core_fault(struct f405 *m, unsigned exception, uint32_t status);
void core_service_call(struct f405 *m);

// Registers: unit 0 is the system control space, 1 the DWT, 2 the DBGMCU.
uint32_t core_read(struct f405 *m, unsigned unit, uint32_t at);
void core_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

// SysTick; `at` is 0 for STK_CTRL.
void systick_event(struct f405 *m);
// The core's clock is about to change, or has changed.
void systick_clock_changes(struct f405 *m, bool is_before);
bool systick_interrupts(const struct f405 *m);
uint32_t systick_read(struct f405 *m, uint32_t at);
void systick_write(struct f405 *m, uint32_t at, uint32_t value);

// DWT_CYCCNT.
uint32_t cycle_counter_read(const struct f405 *m);
// Counts on from a value, where DEMCR and DWT_CTRL have it count.
void cycle_counter_write(struct f405 *m, uint32_t from);

#endif
