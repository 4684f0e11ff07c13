// SPDX-License-Identifier: MIT
// STOP mode, ended by an edge of the button, by an event and by the watchdog.
#include "bare.h"

#define PWR_CR AT(0x40007000)
#define EXTI_EMR 4
#define EXTI_SWIER 16

static KEPT uint32_t magic;
static volatile uint32_t ticks, edges;

static void on_tick(void) {
    ticks++;
}

static void on_edge(void) {
    EXTI(E_PR) = BIT(3);
    (void)EXTI(E_PR);
    edges++;
}

static void on_crystal(void) {
    RCC_CR |= BIT(16);
    while ((RCC_CR & BIT(17)) == 0) {
    }
    USART(U_BRR) = 12;
    RCC_CFGR = 1;
}

static void deep_wfi(void) {
    SCB(SCR) = BIT(2);
    __asm__ volatile("wfi");
    SCB(SCR) = 0;
    USART(U_BRR) = 16;
}

static void by_interrupt(void) {
    on_crystal();
    const uint32_t ticked = ticks;
    const uint32_t from = now_us();
    flush();
    deep_wfi();
    const uint32_t counted = now_us() - from;
    say("edges", edges);
    say("ticks", ticks - ticked);
    say("counted", counted);
    say("sws", (RCC_CFGR >> 2) & 3);
    say("oscillators", (RCC_CR & 3) | (RCC_CR >> 14 & 12));
}

static void not_entered(void) {
    AT(0xE000E180) = BIT(9);  // disabled in the NVIC; it can still be pending
    EXTI(EXTI_SWIER) = BIT(3);
    flush();
    const uint32_t from = now_us();
    deep_wfi();
    say("at_once", now_us() - from);
    EXTI(E_PR) = BIT(3);
    AT(0xE000E280) = BIT(9);
}

static void by_event(void) {
    EXTI(E_IMR) = 0;
    EXTI(EXTI_EMR) = BIT(3);
    // An exception has set the event register, and SEV sets it again; WFE clears it.
    __asm__ volatile("sev\n\twfe");
    flush();
    SCB(SCR) = BIT(2);
    const uint32_t from = ticks;
    __asm__ volatile("wfe");
    SCB(SCR) = 0;
    say("event", ticks - from);
    say("edges", edges);
    EXTI(E_PR) = BIT(3);
}

static void by_pending(void) {
    __asm__ volatile("cpsid i\n\tsev\n\twfe");
    const uint32_t from = now_us();
    SCB(SCR) = BIT(4);  // SEVONPEND: an interrupt that becomes pending is an event
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    __asm__ volatile("wfe");
    say("pended", now_us() - from);
    SCB(SCR) = 0;
    SYSTICK(0) = 0;
    __asm__ volatile("cpsie i\n\tisb");
}

void program(void) {
    say("cause", RCC_CSR >> 24);
    RCC_CSR |= BIT(24);
    if (magic == 0x600DF00D) {
        return;
    }
    RCC_APB1ENR |= BIT(28);
    RCC_APB2ENR |= BIT(14);
    pin_mode(GPIOB, 3, 0);
    pin_pull_up(GPIOB, 3);
    SYSCFG_EXTICR1 = 1 << 12;
    EXTI(E_FTSR) = EXTI(E_IMR) = BIT(3);
    vectors[IRQ + 9] = on_edge;
    enable_irq(9, 0);
    vectors[TICK] = on_tick;
    SYSTICK(4) = 11999;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    PWR_CR |= BIT(0);
    by_interrupt();
    not_entered();
    SYSTICK(0) = 0;
    by_event();
    by_pending();
    magic = 0x600DF00D;
    IWDG(0) = 0x5555;
    IWDG(4) = 1;
    IWDG(8) = 399;  // 100 ms
    IWDG(0) = 0xCCCC;
    EXTI(E_IMR) = BIT(3);
    flush();
    deep_wfi();
    say("woken", 0);
}
