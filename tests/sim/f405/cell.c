// SPDX-License-Identifier: MIT
// The battery's pin, open or at its divider, and the charger's two pins.
#include "bare.h"

static uint32_t convert(unsigned channel) {
    ADC(0x34) = channel;
    ADC(0x08) = BIT(0) | BIT(30);
    while ((ADC(0x00) & BIT(1)) == 0) {
    }
    return ADC(0x4C);
}

static void pull(uint32_t how) {
    GPIO(GPIOC, PUPDR) = (GPIO(GPIOC, PUPDR) & ~UINT32_C(3)) | how;
    pin_mode(GPIOC, 0, 0);
    wait_us(5);
    pin_mode(GPIOC, 0, 3);
}

void program(void) {
    RCC_APB2ENR |= BIT(8);
    pin_pull_up(GPIOC, 1);
    pin_pull_up(GPIOC, 2);
    ADC(0x304) = BIT(23);
    ADC(0x0C) = 7 << 21 | 7;  // channels 17 and 10: 480 cycles
    ADC(0x08) = BIT(0);
    wait_us(10);
    pull(1);
    say("up", convert(10));
    pull(2);
    say("down", convert(10));
    for (unsigned i = 0; i < 20; i++) {
        (void)convert(17);
        (void)convert(10);
    }
    say("drifted", convert(10));
    for (unsigned i = 0; i < 5; i++) {
        while (now_us() < 100000 * (i + 1)) {
        }
        say("counts", convert(10));
        say("charger", (GPIO(GPIOC, IDR) >> 1) & 3);
    }
    ADC(0x0C) = 7 << 21;  // 3 cycles
    (void)convert(17);
    say("hasty", convert(10));
}
