// SPDX-License-Identifier: MIT
// From reset's 16 MHz to 168 MHz, and what happens when a crystal dies.
#include "clock.h"

#include <stdbool.h>

#include "../board.h"
#include "cpu.h"
#include "pins.h"
#include "reset.h"

enum {
    // Of the PLL, for either source: its input 2 MHz, which jitters least ("RCC PLL
    // configuration register"), its VCO 336 MHz, the processor half of that, and 48 MHz
    // for what asks for them.
    PLL_INPUT_MHZ = 2,
    PLL_N = 168,
    PLL_Q = 7,
    // "Relation between CPU clock frequency and Flash memory read time": 168 MHz at 2.7
    // to 3.6 V.
    WAIT_STATES = 5,
    // Turns of a loop of 4 cycles or more at 16 MHz: 50 ms and more, a crystal takes 2
    // ("HSE oscillator characteristics"); 2.5 ms, a PLL takes 0.3 ("PLL
    // characteristics").
    CRYSTAL_TURNS_MAX = 200000,
    PLL_TURNS_MAX = 10000,
    TICK_US = 1000,  // set-up of the sensor looks for its samples in steps of it
};

_Static_assert(F_CPU / 1000000 == PLL_INPUT_MHZ * PLL_N / 2,
               "F_CPU is what the PLL makes");

static bool becomes(const volatile uint32_t *word, uint32_t mask, uint32_t wanted,
                    uint32_t turns) {
    for (; turns > 0; turns--) {
        if ((*word & mask) == wanted) {
            return true;
        }
    }
    return false;
}

// Sets the rate of the device clock; it loses less than one count.
static void count_from(uint32_t timer_mhz) {
    const uint32_t us = TIM2->cnt;
    TIM2->psc = timer_mhz - 1;
    TIM2->egr = TIM_EGR_UG;  // takes over the prescaler, and clears the counter
    TIM2->cnt = us;
}

void clock_start(void) {
    // Where a bootloader came before, not a reset, it may have chosen another.
    RCC->cr |= RCC_CR_HSION;
    (void)becomes(&RCC->cr, RCC_CR_HSIRDY, RCC_CR_HSIRDY, PLL_TURNS_MAX);
    RCC->cfgr = 0;
    (void)becomes(&RCC->cfgr, RCC_CFGR_SWS, 0, PLL_TURNS_MAX);
    RCC->apb1enr |= RCC_APB1_TIM2;
    (void)RCC->apb1enr;  // "Delay after an RCC peripheral clock enabling" (ES0182)
    TIM2->arr = UINT32_MAX;
    count_from(HSI_MHZ);
    TIM2->cr1 = TIM_CR1_CEN;
}

// While the processor runs from the oscillator inside.
static bool run_from_pll(uint32_t source, uint32_t source_mhz) {
    RCC->cr &= ~RCC_CR_PLLON;
    if (!becomes(&RCC->cr, RCC_CR_PLLRDY, 0, PLL_TURNS_MAX)) {
        return false;
    }
    RCC->pllcfgr = RCC_PLLCFGR_M(source_mhz / PLL_INPUT_MHZ) | RCC_PLLCFGR_N(PLL_N) |
                   RCC_PLLCFGR_P_2 | RCC_PLLCFGR_Q(PLL_Q) | source;
    RCC->cr |= RCC_CR_PLLON;
    if (!becomes(&RCC->cr, RCC_CR_PLLRDY, RCC_CR_PLLRDY, PLL_TURNS_MAX)) {
        return false;
    }
    RCC->cfgr = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2;
    RCC->cfgr = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2 | RCC_CFGR_SW_PLL;
    return becomes(&RCC->cfgr, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL, PLL_TURNS_MAX);
}

static bool run_from_crystal(void) {
    RCC->cr |= RCC_CR_HSEON;
    if (!becomes(&RCC->cr, RCC_CR_HSERDY, RCC_CR_HSERDY, CRYSTAL_TURNS_MAX)) {
        RCC->cr &= ~RCC_CR_HSEON;
        return false;
    }
    if (!run_from_pll(RCC_PLLCFGR_HSE, HSE_MHZ)) {
        return false;
    }
    RCC->cr |= RCC_CR_CSSON;
    return true;
}

static volatile bool is_spare;  // the oscillator inside is what the PLL multiplies

bool clock_is_spare(void) {
    return is_spare;
}

// Without a PLL nothing has its rate, neither wire nor bus: starting over is all that
// is left.
static void run_from_spare(void) {
    is_spare = true;
    if (!run_from_pll(0, HSI_MHZ)) {
        reset_now();
    }
}

void clock_init(void) {
    RCC->apb1enr |= RCC_APB1_PWR;
    (void)RCC->apb1enr;
    PWR->cr |= PWR_CR_VOS;  // "Voltage regulator": scale 1, above 144 MHz
    // The prefetch is not for silicon of revision A (ES0182, "ART Accelerator prefetch
    // queue instruction is not supported"), which was never sold.
    FLASH->acr = FLASH_ACR_LATENCY(WAIT_STATES) | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN |
                 FLASH_ACR_DCEN;
    if (!run_from_crystal()) {
        run_from_spare();
    }
    count_from(APB1_TIMER_MHZ);
    SYSTICK->rvr = TICK_US * (F_CPU / 1000000) - 1;
    SYSTICK->cvr = 0;
    SYSTICK->csr = SYSTICK_ENABLE | SYSTICK_INTERRUPT | SYSTICK_CPU_CLOCK;
}

// The hardware has already put the processor on the oscillator inside and stopped
// crystal and PLL ("Clock security system"). Until the PLL has locked again, 0.3 ms at
// most, all clocks run at a tenth of their rate: the device clock loses as much, and a
// byte on the wire is torn.
void clock_failed(void) {
    RCC->cir |= RCC_CIR_CSSC;
    run_from_spare();
}

uint32_t board_time_us(void) {
    return clock_us();
}

uint8_t board_cycles_per_us(void) {
    return F_CPU / 1000000;
}
