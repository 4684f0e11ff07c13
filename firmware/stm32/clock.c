// SPDX-License-Identifier: MIT
// From reset's 16 MHz to 168 MHz, and what happens when a crystal dies.
#include "clock.h"

#include <stdbool.h>

#include "../board.h"
#include "cpu.h"
#include "pins.h"
#include "reset.h"

enum {
    // Of the PLL: its VCO, whose half the processor has, and 48 MHz for USB and SDIO.
    VCO_MHZ = 336,
    PLL_Q = 7,
    // "Relation between CPU clock frequency and Flash memory read time": 168 MHz at 2.7
    // to 3.6 V.
    WAIT_STATES = 5,
    // A crystal takes 2 ms ("HSE oscillator characteristics").
    CRYSTAL_US_MAX = 50000,
    // Turns of a loop of 4 cycles or more at 16 MHz: 2.5 ms and more, a PLL takes 0.3
    // ("PLL characteristics").
    PLL_TURNS_MAX = 10000,
    // The crystal is measured over sixteen captures of every eighth edge of its 31st
    // part, each of 10 to 62 us for 25 to 4 MHz.
    RTCPRE = 31,
    EDGES = 8,
    CAPTURES = 16,
    MEASURE_US_MAX = 2000,
    TICK_US = 1000,  // set-up of the sensor looks for its samples in steps of it
};

_Static_assert(F_CPU / 1000000 == VCO_MHZ / 2, "F_CPU is what the PLL makes");

// What boards have, and what the PLL divides it by: its input is 2 MHz, which jitters
// least, or 1 MHz ("RCC PLL configuration register"). The oscillator inside, to which a
// crystal is compared, is off by 4 % at most from -10 to 85 degC ("HSI oscillator
// characteristics"); from a frequency sold for baud rates (7.3728 MHz and its like)
// these are 8 % away, and 25 MHz is 4 % from 24 and 26.
static const struct source {
    uint16_t khz, khz_off_max;
    uint8_t divider;
} sources[] = {
    {8000, 480, 4},
    {12000, 720, 6},
    {HSI_MHZ * 1000, 960, 8},
    {25000, 600, 25},
};
enum { SOURCES = sizeof sources / sizeof *sources, SOURCE_OF_HSI_MHZ = 2 };

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
static bool run_from_pll(uint32_t selection, const struct source *source) {
    RCC->cr &= ~RCC_CR_PLLON;
    if (!becomes(&RCC->cr, RCC_CR_PLLRDY, 0, PLL_TURNS_MAX)) {
        return false;
    }
    const uint32_t factor = VCO_MHZ * 1000U * source->divider / source->khz;
    RCC->pllcfgr = RCC_PLLCFGR_M(source->divider) | RCC_PLLCFGR_N(factor) |
                   RCC_PLLCFGR_P_2 | RCC_PLLCFGR_Q(PLL_Q) | selection;
    RCC->cr |= RCC_CR_PLLON;
    if (!becomes(&RCC->cr, RCC_CR_PLLRDY, RCC_CR_PLLRDY, PLL_TURNS_MAX)) {
        return false;
    }
    RCC->cfgr = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2;
    RCC->cfgr = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2 | RCC_CFGR_SW_PLL;
    return becomes(&RCC->cfgr, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL, PLL_TURNS_MAX);
}

// "Internal/external clock measurement using TIM5/TIM11": kHz of the crystal by the
// oscillator inside, from which the processor runs; 0 where edges stay away. TIM11
// counts 2,500 and more, so that a count is 0.04 %. Takes 0.17 ms at 25 MHz, 0.53 ms
// at 8.
static uint32_t crystal_khz(void) {
    RCC->cfgr = RCC_CFGR_RTCPRE(RTCPRE);
    RCC->apb2enr |= RCC_APB2_TIM11;
    (void)RCC->apb2enr;
    // The bootloader in ROM, which may have come before, measures the same way.
    RCC->apb2rstr |= RCC_APB2_TIM11;
    RCC->apb2rstr &= ~RCC_APB2_TIM11;
    TIM11->option = TIM11_OPTION_HSE_RTC;
    TIM11->ccmr1 = TIM_CCMR1_CC1_INPUT | TIM_CCMR1_IC1PSC_8;
    TIM11->ccer = TIM_CCER_CC1E;
    TIM11->cr1 = TIM_CR1_CEN;
    uint16_t first = 0;
    uint16_t last = 0;
    uint8_t captures = 0;
    const uint32_t begun_us = clock_us();
    while (captures <= CAPTURES && clock_us() - begun_us <= MEASURE_US_MAX) {
        if ((TIM11->sr & TIM_SR_CC1IF) != 0) {
            last = (uint16_t)TIM11->ccr1;  // clears CC1IF
            first = captures == 0 ? last : first;
            captures++;
        }
    }
    const bool is_whole = captures > CAPTURES && (TIM11->sr & TIM_SR_CC1OF) == 0;
    RCC->apb2enr &= ~RCC_APB2_TIM11;
    const uint32_t edges = (uint32_t)RTCPRE * EDGES * CAPTURES;
    return is_whole ? edges * (HSI_MHZ * 1000) / (uint16_t)(last - first) : 0;
}

static const struct source *find_source(uint32_t khz) {
    for (uint8_t i = 0; i < SOURCES; i++) {
        const int32_t off = (int32_t)khz - sources[i].khz;
        if (off <= sources[i].khz_off_max && -off <= sources[i].khz_off_max) {
            return &sources[i];
        }
    }
    return 0;
}

static bool crystal_swings(void) {
    const uint32_t begun_us = clock_us();
    while ((RCC->cr & RCC_CR_HSERDY) == 0) {
        if (clock_us() - begun_us > CRYSTAL_US_MAX) {
            return false;
        }
    }
    return true;
}

static bool run_from_crystal(void) {
    RCC->cr |= RCC_CR_HSEON;
    if (crystal_swings()) {
        const struct source *source = find_source(crystal_khz());
        if (source != 0 && run_from_pll(RCC_PLLCFGR_HSE, source)) {
            RCC->cr |= RCC_CR_CSSON;
            return true;
        }
    }
    RCC->cr &= ~RCC_CR_HSEON;
    return false;
}

static volatile bool is_spare;  // the oscillator inside is what the PLL multiplies

bool clock_is_spare(void) {
    return is_spare;
}

// Without a PLL nothing has its rate, neither wire nor bus: starting over is all that
// is left.
static void run_from_spare(void) {
    is_spare = true;
    if (!run_from_pll(0, &sources[SOURCE_OF_HSI_MHZ])) {
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
