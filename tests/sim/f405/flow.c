// SPDX-License-Identifier: MIT
// USART2 with CTS. The pull of the open pin stands for the other side.
#include "bare.h"

static void pull(uint32_t how) {  // 1 up, 2 down
    GPIO(GPIOA, PUPDR) = (GPIO(GPIOA, PUPDR) & ~UINT32_C(3)) | how;
}

void program(void) {
    pull(2);
    pin_alternate(GPIOA, 0, 7);
    USART(U_CR3) = BIT(9);
    say("clear", (USART(U_SR) >> 9) & 1);
    flush();
    pull(1);
    wait_us(100);
    const uint32_t raised = USART(U_SR);
    USART(U_DR) = '1';
    wait_us(1000);
    const uint32_t held = USART(U_SR);
    USART(U_SR) = ~BIT(9);
    const uint32_t cleared = USART(U_SR);
    pull(2);
    const uint32_t fallen = USART(U_SR);
    const uint32_t from = now_us();
    flush();
    const uint32_t us = now_us() - from;
    // CTS rises in the middle of a byte, which is sent; the next one waits.
    USART(U_DR) = '2';
    USART(U_DR) = '3';
    pull(1);
    wait_us(1000);
    const uint32_t middle = USART(U_SR);
    pull(2);
    flush();
    USART(U_DR) = '\n';
    say("raised", (raised >> 9) & 1);
    say("held", held & (BIT(7) | BIT(6)));
    say("cleared", (cleared >> 9) & 1);
    say("fallen", (fallen >> 9) & 1);
    say("us", us);
    say("middle", middle & (BIT(7) | BIT(6)));
    GPIO(GPIOA, PUPDR) &= ~UINT32_C(3);
    say("floats", 0);
}
