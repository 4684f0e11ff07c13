// SPDX-License-Identifier: MIT
// Measures the crystal by HSI with TIM11, in the order of the manual
// ("Internal/external clock measurement using TIM5/TIM11"): ticks of HSI between
// captures.
#include "bare.h"

#define TIM11(at) AT(0x40014800 + (at))
enum { TIM_OR = 0x50 };

static uint32_t capture(void) {
    for (unsigned tries = 0; (TIM11(TIM_SR) & BIT(1)) == 0; tries++) {
        if (tries == 10000) {
            return 0xFFFFFFFF;
        }
    }
    return TIM11(TIM_CCR1);
}

static void measure(uint32_t divider, uint32_t prescaler) {
    RCC_CFGR = divider << 16;
    TIM11(TIM_CCER) = 0;
    TIM11(TIM_CCMR1) = 1 | prescaler << 2;
    TIM11(TIM_CCER) = 1;
    (void)capture();
    const uint32_t first = capture();
    const uint32_t second = first == 0xFFFFFFFF ? first : capture();
    say("ticks", second == 0xFFFFFFFF ? 0 : (second - first) & 0xFFFF);
}

void program(void) {
    RCC_APB2ENR |= BIT(18);
    TIM11(TIM_OR) = 2;
    TIM11(TIM_CR1) = 1;
    measure(31, 3);
    RCC_CR |= BIT(16);
    while ((RCC_CR & BIT(17)) == 0) {
    }
    measure(31, 3);
    measure(31, 0);
    measure(20, 2);
    measure(1, 3);
    // Nobody reads: the next capture goes over the first.
    RCC_CFGR = 31 << 16;
    wait_us(200);
    say("status", TIM11(TIM_SR));
    flush();
}
