// SPDX-License-Identifier: MIT
// Clocks and resets (RCC), and supply with STOP mode (PWR).
#ifndef SIM_F405_PERIPHERALS_RCC_H
#define SIM_F405_PERIPHERALS_RCC_H

#include <stdbool.h>
#include <stdint.h>

#include "f405/timing.h"

struct f405_rcc {
    uint32_t cr, pllcfgr, cfgr, cir;
    uint32_t rstr[6], enr[6], lpenr[6];  // AHB1 AHB2 AHB3, a gap, APB1 APB2
    uint32_t bdcr, csr, sscgr, plli2scfgr;
    uint64_t hse_at, hsi_at, pll_at, lsi_at;  // when they will be ready
    bool is_crystal_dead;
    uint64_t hse_since;  // when HSE became ready
    uint32_t pwr_cr, pwr_csr;
    // In STOP mode: since when, and how much time each transfer under way has left.
    bool is_stopped;
    uint64_t stopped_at, left[EVENTS];
};

enum { PWR_VOS = 1 << 14 };  // of PWR_CR: voltage scale 1

void rcc_power_up(struct f405 *m);
void rcc_reset(struct f405 *m, uint32_t cause);
void rcc_event(struct f405 *m);
// Applies the registers to the clocks; time continues at the new rate.
void rcc_set_clocks(struct f405 *m);
// What a clock would be if HSI were as it should be: that it is off is not the
// firmware's doing.
uint32_t rcc_nominal_hz(const struct f405 *m, uint32_t hz);
// Stops all oscillators but LSI for STOP mode; then starts HSI, and the system on it,
// from that time on.
void rcc_halt(struct f405 *m);
void rcc_restart(struct f405 *m, uint64_t at_ps);
uint32_t rcc_read(struct f405 *m, unsigned unit, uint32_t at);
void rcc_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

// Into STOP mode and out of it.
void pwr_stop(struct f405 *m, bool is_begin);
uint32_t pwr_read(struct f405 *m, unsigned unit, uint32_t at);
void pwr_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
