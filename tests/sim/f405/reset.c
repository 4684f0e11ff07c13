// SPDX-License-Identifier: MIT
// Resets in several ways and sends the cause of each; the count is kept in RAM.
#include "bare.h"

static KEPT uint32_t magic, count;

void program(void) {
    const uint32_t cause = RCC_CSR >> 24;
    RCC_CSR |= BIT(24);
    if (magic != 0x600DF00D) {
        magic = 0x600DF00D;
        count = 0;
    }
    count++;
    say("cause", cause);
    say("count", count);
    say("cleared", RCC_CSR >> 24);
    flush();
    if (count == 1) {
        SCB(AIRCR) = 0x05FA0004;
        for (;;) {
        }
    }
    if (count == 2) {
        // The watchdog at 100 ms (32 kHz / 8, 400 counts), fed once after 60 ms.
        IWDG(0) = 0x5555;
        IWDG(4) = 1;
        IWDG(8) = 399;
        IWDG(0) = 0xCCCC;
        const uint32_t from = now_us();
        wait_us(60000);
        IWDG(0) = 0xAAAA;
        for (;;) {
            if (now_us() - from > 155000) {
                say("us", now_us() - from);
                flush();
                wait_us(1000);
            }
        }
    }
    wait_us(2000000);  // for resets from outside
}
