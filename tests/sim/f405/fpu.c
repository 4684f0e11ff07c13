// SPDX-License-Identifier: MIT
// The core saves the FPU's registers for who is interrupted: a sum in floats, while
// handlers of two priorities write other numbers there. The FPU is off at its first
// use.
#include "bare.h"

static volatile uint32_t interrupts, faults, status;

static void spoil(float with) {
    __asm__ volatile("vmov s0, %0\n\tvmov.f32 s1, s0\n\tvmov.f32 s7, s0\n\t"
                     "vmov.f32 s14, s0\n\tvmov.f32 s15, s0\n\tvmsr fpscr, %1"
                     :
                     : "r"(with), "r"(0xF0000000)
                     : "s0", "s1", "s7", "s14", "s15", "cc");
}

static void on_tick(void) {
    interrupts++;
    NVIC_ISPR(1) = BIT(61 - 32);
    spoil(1e30F);
}

static void on_high(void) {
    interrupts++;
    spoil(-7.0F);
}

static void on_usage(void) {
    faults++;
    status = SCB(CFSR);
    SCB(CFSR) = status;
    SCB(CPACR) = 0xFU << 20;
    __asm__ volatile("dsb\n\tisb");
}

// 1 + 1/2 + 1/4 + ..., in registers that the handlers overwrite.
static uint32_t sum(void) {
    uint32_t result = 0;
    __asm__ volatile("vmov.f32 s0, #1.0\n\tvmov.f32 s1, #0.5\n\t"
                     "vsub.f32 s14, s14, s14\n\tvmov.f32 s15, #1.0\n\t"
                     "mov r1, #2000\n\t"
                     "1: mov r2, #20\n\tvsub.f32 s14, s14, s14\n\tvmov.f32 s15, s0\n\t"
                     "2: vadd.f32 s14, s14, s15\n\tvmul.f32 s15, s15, s1\n\t"
                     "subs r2, #1\n\tbne 2b\n\t"
                     "subs r1, #1\n\tbne 1b\n\t"
                     "vmov %0, s14"
                     : "=r"(result)
                     :
                     : "r1", "r2", "s0", "s1", "s14", "s15", "cc");
    return result;
}

void program(void) {
    vectors[USAGE_FAULT] = on_usage;
    vectors[TICK] = on_tick;
    vectors[IRQ + 61] = on_high;
    SCB(SHCSR) = BIT(18);
    enable_irq(61, 0x10);
    SHPR(TICK) = 0x80;
    const uint32_t alone = sum();
    say("faults", faults);
    say("status", status);
    SYSTICK(4) = 127;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    const uint32_t together = sum();
    SYSTICK(0) = 0;
    say("interrupts", interrupts > 1000);
    say("alone", alone);
    say("together", together);
    uint32_t flags = 0;
    __asm__ volatile("vmrs %0, fpscr" : "=r"(flags));
    say("fpscr", flags & 0xF0000000);
}
