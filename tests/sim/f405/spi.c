// SPDX-License-Identifier: MIT
// SPI1 with an empty socket: it receives ones in the time that the rate gives. A byte
// that is not read causes an overrun.
#include "bare.h"

enum { RXNE = 1, TXE = 2, OVR = 64, BSY = 128 };

void program(void) {
    RCC_APB2ENR |= BIT(12);
    for (unsigned pin = 5; pin <= 7; pin++) {
        pin_alternate(GPIOA, pin, 5);
    }
    SPI(0x00) = BIT(9) | BIT(8) | BIT(2) | 3 << 3 | BIT(6);  // 16 MHz / 16
    say("ready", SPI(0x08));
    const uint32_t from = now_us();
    SPI(0x0C) = 0x55;
    say("busy", SPI(0x08) & BSY);
    while ((SPI(0x08) & RXNE) == 0) {
    }
    say("us", now_us() - from < 200);
    say("byte", SPI(0x0C));
    SPI(0x0C) = 1;
    wait_us(20);
    SPI(0x0C) = 2;
    wait_us(20);
    say("overrun", SPI(0x08));
    (void)SPI(0x0C);
    (void)SPI(0x08);
    say("cleared", SPI(0x08));
}
