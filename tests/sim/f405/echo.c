// SPDX-License-Identifier: MIT
// Echoes each byte in the interrupt handler and sleeps between bytes.
#include "bare.h"

static void on_byte(void) {
    USART(U_DR) = USART(U_DR);
}

void program(void) {
    vectors[IRQ + 38] = on_byte;
    enable_irq(38, 0);
    USART(U_CR1) |= BIT(5);
    for (;;) {
        __asm__ volatile("wfi");
    }
}
