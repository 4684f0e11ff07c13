// SPDX-License-Identifier: MIT
// WFI: sleeps through 250 ticks of a millisecond, then is woken by one while interrupts
// are masked.
#include "bare.h"

static volatile uint32_t ticks;

static void on_tick(void) {
    ticks++;
}

void program(void) {
    vectors[TICK] = on_tick;
    SYSTICK(4) = 15999;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    const uint32_t from = now_us();
    DEMCR = BIT(24);
    DWT_CYCCNT = 0;
    DWT_CTRL = 1;
    while (ticks < 250) {
        __asm__ volatile("wfi");
    }
    const uint32_t awake = DWT_CYCCNT;
    say("us", now_us() - from);
    say("awake", awake);
    __asm__ volatile("cpsid i");
    const uint32_t before = ticks;
    __asm__ volatile("wfi");
    say("masked", ticks - before);
    __asm__ volatile("cpsie i\n\tisb");
    say("unmasked", ticks - before);
}
