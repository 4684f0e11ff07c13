// SPDX-License-Identifier: MIT
// See break_down.h.
#include "break_down.h"

#include <stdint.h>

#include "board.h"

// Each is struck at its first instruction: its symbol says where.
#define STRUCK __attribute__((naked, noipa, unused)) static void

STRUCK hang(void) {
    __asm__("b .");
}

STRUCK load_from(__attribute__((unused)) uint32_t where) {
    __asm__("ldr r0, [r0]\n\tbx lr");
}

STRUCK divide(__attribute__((unused)) uint32_t a, __attribute__((unused)) uint32_t b) {
    __asm__("udiv r0, r0, r1\n\tbx lr");
}

STRUCK undefined(void) {
    __asm__("udf #0");
}

// An interrupt that nobody handles, TIM4's; it strikes somewhere in here.
__attribute__((noipa)) static void interrupt(void) {
    *(volatile uint32_t *)0xE000E200 = UINT32_C(1) << 30;
    *(volatile uint32_t *)0xE000E100 = UINT32_C(1) << 30;
    for (;;) {
    }
}

void break_down(char letter) {
    switch (letter) {
    case 'R':
        board_reset();
    case 'H':  // interrupts on
        hang();
        break;
    case 'D':  // interrupts off
        __asm__ volatile("cpsid i");
        hang();
        break;
    case 'F':  // where nothing is
        load_from(0x30000000);
        break;
    case 'Z':
        divide(1000, 0);
        break;
    case 'U':
        undefined();
        break;
    case 'L':  // a stack that is not where it should be
        __asm__ volatile("mov sp, %0\n\tudf #0" ::"r"(0x2001FF00));
        break;
    default:  // 'I'
        interrupt();
        break;
    }
}
