// SPDX-License-Identifier: MIT
// Listens to the radio at a wrong baud rate.
#include "bare.h"

static void on_tick(void) {
}

void program(void) {
    vectors[TICK] = on_tick;
    SYSTICK(4) = 15999;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    pin_pull_up(GPIOB, 12);
    USART(U_BRR) = 17;
    while (now_us() < 3990000) {
        __asm__ volatile("wfi");
    }
    unsigned count = 0;
    unsigned unframed = 0;
    unsigned right = 0;
    while (now_us() < 4020000) {
        const uint32_t sr = USART(U_SR);
        if ((sr & BIT(5)) != 0) {
            count++;
            unframed += (sr >> 1) & 1;
            right += USART(U_DR) == 'U' ? 1U : 0U;
        }
    }
    USART(U_BRR) = 139;  // 115,108
    say("count", count);
    say("unframed", unframed);
    say("right", right);
    flush();
    wait_us(100000);
}
