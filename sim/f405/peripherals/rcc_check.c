// SPDX-License-Identifier: MIT
// The limits of the clocks (DS, "General operating conditions").
#include "f405/f405.h"

enum {
    PLL_FROM_HSE = 1 << 22,  // of PLLCFGR
    SWS_SHIFT = 2,           // of CFGR
    SWS_HSI = 0,
    SWS_PLL = 2,
    SYSCLK_MAX_HZ = 168000000,
    HCLK_LOW_VOS_HZ = 144000000,
    PCLK1_MAX_HZ = 42000000,
    PCLK2_MAX_HZ = 84000000,
    WAIT_STATE_HZ =
        30000000,  // RM, "Relation between CPU clock frequency and ...": 3.3 V
};

static bool is_from_hsi(const struct f405 *m) {
    const uint32_t selected = (m->rcc.cfgr >> SWS_SHIFT) & 3;
    return selected == SWS_HSI ||
           (selected == SWS_PLL && (m->rcc.pllcfgr & PLL_FROM_HSE) == 0);
}

uint32_t rcc_nominal_hz(const struct f405 *m, uint32_t hz) {
    return is_from_hsi(m) ? (uint32_t)((uint64_t)hz * F405_HSI_HZ / m->hsi_hz) : hz;
}

void rcc_check_clocks(struct f405 *m, uint32_t sysclk_hz) {
    const uint32_t hclk_hz = rcc_nominal_hz(m, m->hclk_hz);
    if (rcc_nominal_hz(m, sysclk_hz) > SYSCLK_MAX_HZ ||
        rcc_nominal_hz(m, m->pclk_hz[0]) > PCLK1_MAX_HZ ||
        rcc_nominal_hz(m, m->pclk_hz[1]) > PCLK2_MAX_HZ) {
        f405_complain(m, "a clock faster than the data sheet allows");
    }
    if (hclk_hz > HCLK_LOW_VOS_HZ && (m->rcc.pwr_cr & PWR_VOS) == 0) {
        f405_complain(m, "a clock faster than the voltage scale allows");
    }
    if (hclk_hz > WAIT_STATE_HZ * ((m->flash_control.acr & 7) + 1)) {
        f405_complain(m, "flash read with too few wait states");
    }
}
