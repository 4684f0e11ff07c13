// SPDX-License-Identifier: MIT
// Causes faults and sends what the core reports of each; the last one locks it up.
#include "bare.h"

volatile uint32_t wanted_pc, skips;

__attribute__((used)) static void tell(const uint32_t *frame) {
    say("hfsr", SCB(HFSR));
    say("cfsr", SCB(CFSR));
    say("bfar", SCB(BFAR));
    say("pc", frame[6] - wanted_pc);
    SCB(HFSR) = SCB(HFSR);
    SCB(CFSR) = SCB(CFSR);
}

// Continues `skips` bytes after the instruction that failed.
__attribute__((naked)) static void on_fault(void) {
    __asm__ volatile("mov r0, sp\n\tpush {r4, lr}\n\tmov r4, r0\n\tbl tell\n\t"
                     "ldr r0, =skips\n\tldr r0, [r0]\n\tldr r1, [r4, #24]\n\t"
                     "adds r1, r0\n\tstr r1, [r4, #24]\n\tpop {r4, pc}\n\t.ltorg");
}

static void in_handler(void) {
    __asm__ volatile("udf #1");
}

void program(void) {
    vectors[HARD_FAULT] = on_fault;
    vectors[BUS_FAULT] = on_fault;
    vectors[USAGE_FAULT] = on_fault;
    __asm__ volatile(".align 2\n\tadr r4, 1f\n\tldr r5, =wanted_pc\n\tstr r4, [r5]\n\t"
                     "movs r4, #2\n\tldr r5, =skips\n\tstr r4, [r5]\n\t"
                     "mov r5, #0x70000000\n\t"
                     ".align 2\n1: ldr r6, [r5, #16]\n\t" ::
                         : "r4", "r5", "r6", "memory");
    SCB(SHCSR) = BIT(17);
    __asm__ volatile(".align 2\n\tadr r4, 1f\n\tldr r5, =wanted_pc\n\tstr r4, [r5]\n\t"
                     "movs r4, #0\n\tldr r5, =skips\n\tstr r4, [r5]\n\t"
                     "mov r5, #0x70000000\n\tnop\n\t"
                     ".align 2\n1: str r6, [r5, #16]\n\t" ::
                         : "r4", "r5", "r6", "memory");
    SCB(SHCSR) = BIT(18);
    __asm__ volatile(".align 2\n\tadr r4, 1f\n\tldr r5, =wanted_pc\n\tstr r4, [r5]\n\t"
                     "movs r4, #2\n\tldr r5, =skips\n\tstr r4, [r5]\n\tnop\n\t"
                     ".align 2\n1: udf #1\n\t" ::
                         : "r4", "r5", "memory");
    SCB(CCR) |= BIT(4);
    __asm__ volatile(".align 2\n\tadr r4, 1f\n\tldr r5, =wanted_pc\n\tstr r4, [r5]\n\t"
                     "movs r4, #4\n\tldr r5, =skips\n\tstr r4, [r5]\n\t"
                     "movs r4, #9\n\tmovs r5, #0\n\t"
                     ".align 2\n1: udiv r6, r4, r5\n\t" ::
                         : "r4", "r5", "r6", "memory");
    say("after", 1);
    flush();
    // A fault in the handler of faults: only the watchdog could end this.
    vectors[HARD_FAULT] = in_handler;
    SCB(SHCSR) = 0;
    __asm__ volatile("udf #2");
}
