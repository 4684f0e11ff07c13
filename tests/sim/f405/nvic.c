// SPDX-License-Identifier: MIT
// Nested exceptions, masks and SysTick. The program pends lines 60 to 63 and logs the
// order in which their handlers run.
#include "bare.h"

static volatile uint32_t log_words[40];
static volatile unsigned logged;

static void note(uint32_t word) {
    log_words[logged++] = word;
}

static void pend(unsigned line) {
    NVIC_ISPR(line / 32) = BIT(line % 32);
    __asm__ volatile("dsb\n\tisb");
}

static void on_low(void) {
    note(0x60);
    pend(61);  // higher priority: runs now
    pend(62);  // same priority: runs after this one
    pend(63);  // lower priority: runs last
    note(0x160);
}

static void on_high(void) {
    note(0x61);
    note(0x1000 | (SCB(ICSR) & 0x1FF));
    note(0x161);
}

static void on_same(void) {
    note(0x62);
}

static void on_lowest(void) {
    note(0x63);
}

static void on_service(void) {
    note(0xAA);
}

static void on_pendsv(void) {
    note(0xBB);
}

static volatile uint32_t levels;

// Runs again until it clears the cause of the interrupt.
static void on_timer(void) {
    levels++;
    if (levels == 3) {
        TIM(3, TIM_SR) = 0;
        (void)TIM(3, TIM_SR);
    }
}

static volatile uint32_t ticks;

static void on_tick(void) {
    ticks++;
}

static void say_log(const char *name) {
    for (unsigned i = 0; i < logged; i++) {
        say(name, log_words[i]);
    }
    logged = 0;
}

static void masks(void) {
    __asm__ volatile("cpsid i" ::: "memory");
    pend(63);
    note(1);
    __asm__ volatile("cpsie i\n\tisb" ::: "memory");
    note(2);
    // BASEPRI 0x40 masks priority 0x40 and all lower ones.
    __asm__ volatile("msr basepri, %0" ::"r"(0x40) : "memory");
    pend(60);
    note(3);
    __asm__ volatile("msr basepri, %0\n\tisb" ::"r"(0) : "memory");
    note(4);
    say_log("masks");
}

// Only an ISB guarantees that a pending interrupt runs between enable and disable.
static void windows(void) {
    __asm__ volatile("cpsid i" ::: "memory");
    pend(63);
    __asm__ volatile("cpsie i\n\tcpsid i" ::: "memory");
    say("window", logged);
    __asm__ volatile("cpsie i\n\tisb\n\tcpsid i" ::: "memory");
    say("window_isb", logged);
    __asm__ volatile("cpsie i" ::: "memory");
    logged = 0;
}

void program(void) {
    vectors[IRQ + 60] = on_low;
    vectors[IRQ + 61] = on_high;
    vectors[IRQ + 62] = on_same;
    vectors[IRQ + 63] = on_lowest;
    vectors[IRQ + 29] = on_timer;
    vectors[SVC] = on_service;
    vectors[PENDSV] = on_pendsv;
    vectors[TICK] = on_tick;
    enable_irq(60, 0x40);
    enable_irq(61, 0x10);
    enable_irq(62, 0x40);
    enable_irq(63, 0x80);
    SHPR(PENDSV) = 0xF0;
    pend(60);
    note(0xEE);
    say_log("nesting");
    __asm__ volatile("svc #1");
    note(1);
    SCB(ICSR) = BIT(28);
    __asm__ volatile("isb");
    note(2);
    say_log("calls");
    masks();
    windows();

    RCC_APB1ENR |= BIT(1);
    TIM(3, TIM_ARR) = 1600;
    TIM(3, TIM_DIER) = 1;
    enable_irq(29, 0);
    TIM(3, TIM_CR1) = BIT(3) | 1;  // one pulse
    wait_us(500);
    say("levels", levels);

    // SysTick every 1000 cycles: 16 in 1 ms.
    SYSTICK(4) = 999;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    wait_us(1000);
    const uint32_t counted = ticks;
    say("ticks", counted);
    SYSTICK(0) = 5;
    wait_us(100);
    const uint32_t flag = SYSTICK(0);  // reading it clears it
    const uint32_t again = SYSTICK(0);
    say("flag", (flag >> 16) & 1);
    say("flag", (again >> 16) & 1);
    say("load", SYSTICK(8) <= 999);
}
