// SPDX-License-Identifier: MIT
// Firmware with a known number of instructions, for tests of the profile: ten samples
// of work that SysTick interrupts, and a function that two others and the handler call.
#include "bare.h"

// One instruction, then two in each turn.
#define SPEND(turns)                                                                   \
    __asm__ volatile("mov r0, #" #turns "\n1: subs r0, #1\n\tbne 1b" ::: "r0", "cc")

static volatile uint32_t room[4], ticks;

__attribute__((noinline)) void shared(void) {
    SPEND(150);
}

// Uses registers that it must save.
__attribute__((noinline)) void first(uint32_t depth) {
    uint32_t local[4];
    for (unsigned i = 0; i < 4; i++) {
        local[i] = room[i] + depth;
    }
    SPEND(250);
    SPEND(250);
    shared();
    shared();
    for (unsigned i = 0; i < 4; i++) {
        room[i] = local[i];
    }
}

// Ends in a jump to shared() instead of a call.
__attribute__((noinline)) void second(void) {
    SPEND(250);
    shared();
}

void on_tick(void) {
    ticks++;
    shared();
}

void program(void) {
    vectors[TICK] = on_tick;
    SYSTICK(4) = 15999;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;  // every 16000 cycles
    pin_mode(GPIOC, 6, 1);
    for (uint32_t sample = 0; sample < 10; sample++) {
        GPIO(GPIOC, BSRR) = BIT(6);
        for (unsigned turn = 0; turn < 20; turn++) {
            first(sample);
            second();
        }
        GPIO(GPIOC, BSRR) = BIT(22);
        __asm__ volatile("wfi");
    }
    SYSTICK(0) = 0;
    say("ticks", ticks);
}
