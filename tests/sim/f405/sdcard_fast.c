// SPDX-License-Identifier: MIT
// Gives a card its first clocks at 8 MHz, too fast before it is identified.
#include "bare.h"

void program(void) {
    RCC_APB2ENR |= BIT(12);
    for (unsigned pin = 5; pin <= 7; pin++) {
        pin_alternate(GPIOA, pin, 5);
    }
    SPI(0x00) = BIT(9) | BIT(8) | BIT(2) | BIT(6);
    SPI(0x0C) = 0xFF;
    wait_us(20);
}
