// SPDX-License-Identifier: MIT
// Switches from HSI to 168 MHz from the crystal, in the order of the manual. Then the
// crystal may die.
#include "bare.h"

static volatile uint32_t alarms;

static void on_nmi(void) {
    alarms++;
    RCC_CIR |= BIT(23);
}

// TIM2 counts microseconds: at 16 MHz / 16 until the switch, at 84 MHz / 84 after it.
void program(void) {
    vectors[2] = on_nmi;
    say("reset", RCC_CR & 0xFFFF00FF);
    uint32_t from = now_us();
    RCC_CR |= BIT(16);
    for (unsigned tries = 0; (RCC_CR & BIT(17)) == 0 && tries < 20000; tries++) {
    }
    say("hse_us", now_us() - from);
    say("hse", (RCC_CR >> 17) & 1);
    if ((RCC_CR & BIT(17)) == 0) {
        return;
    }
    RCC_PLLCFGR = 12 | 336 << 6 | 0 << 16 | BIT(22) | 7 << 24;
    from = now_us();
    RCC_CR |= BIT(24) | BIT(19);
    while ((RCC_CR & BIT(25)) == 0) {
    }
    say("pll_us", now_us() - from);
    flush();
    FLASH_ACR = 5 | BIT(8) | BIT(9) | BIT(10);
    RCC_CFGR = 5 << 10 | 4 << 13;
    RCC_CFGR |= 2;
    while (((RCC_CFGR >> 2) & 3) != 2) {
    }
    USART(U_BRR) = 42;
    TIM(2, TIM_PSC) = 84 - 1;
    TIM(2, TIM_EGR) = 1;
    say("sws", (RCC_CFGR >> 2) & 3);
    flush();
    DEMCR = BIT(24);
    from = now_us();
    DWT_CYCCNT = 0;
    DWT_CTRL = 1;
    wait_us(1000);
    const uint32_t cycles = DWT_CYCCNT;
    say("cycles_a_ms", cycles);
    flush();
    // Waits up to 10 ms for the crystal to die.
    for (uint32_t tries = 0; alarms == 0 && tries < 100000; tries++) {
    }
    USART(U_BRR) = alarms == 0 ? 42 : 4;  // 16 MHz / 4: HSI is the clock again
    say("alarms", alarms);
    say("sws", (RCC_CFGR >> 2) & 3);
    say("hse", (RCC_CR >> 17) & 1);
}
