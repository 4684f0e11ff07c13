// SPDX-License-Identifier: MIT
// The button: EXTI at both edges, a capture of TIM2 at the falling one, and the level
// of the pin without and with its pull-up. PC6 marks work of a known length.
#include "bare.h"

static volatile uint32_t edges[8];
static volatile unsigned seen;

static void on_edge(void) {
    EXTI(E_PR) = BIT(3);
    (void)EXTI(E_PR);
    edges[seen++] = now_us();
}

void program(void) {
    pin_mode(GPIOB, 3, 0);
    GPIO(GPIOB, PUPDR) = 0;
    say("floating", (GPIO(GPIOB, IDR) >> 3) & 1);
    pin_pull_up(GPIOB, 3);
    say("pulled", (GPIO(GPIOB, IDR) >> 3) & 1);
    pin_alternate(GPIOB, 3, 1);
    TIM(2, TIM_CCMR1) = 1 << 8;
    TIM(2, TIM_CCER) = 1 << 4 | 1 << 5;

    RCC_APB2ENR |= BIT(14);
    SYSCFG_EXTICR1 = 1 << 12;
    EXTI(E_RTSR) = EXTI(E_FTSR) = EXTI(E_IMR) = BIT(3);
    vectors[IRQ + 9] = on_edge;
    enable_irq(9, 0);

    pin_mode(GPIOC, 6, 1);
    for (unsigned i = 0; i < 5; i++) {
        GPIO(GPIOC, BSRR) = BIT(6);
        __asm__ volatile("mov r0, #100\n1: subs r0, #1\n\tbne 1b" ::: "r0", "cc");
        GPIO(GPIOC, BSRR) = BIT(22);
    }
    wait_us(400000);
    for (unsigned i = 0; i < seen; i++) {
        say("edge", edges[i]);
    }
    say("capture", TIM(2, TIM_CCR1 + 4));
    say("flags", TIM(2, TIM_SR));
}
