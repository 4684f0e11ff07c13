// SPDX-License-Identifier: MIT
// The supply (RM, "Power controller"): STOP mode, and the registers of PWR.
#include "f405/f405.h"

enum {
    PWR_CR = 0x00,
    PWR_CSR = 0x04,
    LPDS = 1 << 0,
    PDDS = 1 << 1,
    FPDS = 1 << 9,
};
// DS, "Low-power mode wakeup timings", typical: from STOP with the main regulator, with
// the low-power one, with the flash switched off too.
#define WAKE_PS (13 * F405_PS_PER_US)
#define WAKE_LOW_POWER_PS (17 * F405_PS_PER_US)
#define WAKE_NO_FLASH_PS (110 * F405_PS_PER_US)

// STOP (RM, "Stop mode"): every clock but LSI stops, and afterwards the system runs on
// HSI. A transfer that a peripheral had under way continues where it was.

static void hold_events(struct f405 *m) {
    static const enum f405_event transfers[] = {EVENT_I2C, EVENT_USART_SENT, EVENT_SPI,
                                                EVENT_ADC, EVENT_USART_IDLE};
    const uint64_t now = f405_now(m);
    for (unsigned i = 0; i < EVENTS; i++) {
        m->rcc.left[i] = F405_NEVER;
    }
    for (size_t i = 0; i < sizeof transfers / sizeof *transfers; i++) {
        const enum f405_event event = transfers[i];
        if (m->at[event] == F405_NEVER) {
            continue;
        }
        if (event != EVENT_USART_IDLE &&
            !(event == EVENT_USART_SENT && m->usart.is_preamble)) {
            f405_complain(m, "STOP mode in the middle of a transfer");
        }
        m->rcc.left[event] = m->at[event] > now ? m->at[event] - now : 0;
        f405_never(m, event);
    }
}

void pwr_stop(struct f405 *m, bool is_begin) {
    struct f405_rcc *rcc = &m->rcc;
    const uint64_t now = f405_now(m);
    if (is_begin) {
        if ((rcc->pwr_cr & PDDS) != 0) {
            f405_not_modelled(m, "Standby mode");
            return;
        }
        hold_events(m);
        rcc->stopped_at = now;
        rcc->is_stopped = true;
        rcc_halt(m);
        return;
    }
    const uint64_t awake_at = now + ((rcc->pwr_cr & FPDS) != 0   ? WAKE_NO_FLASH_PS
                                     : (rcc->pwr_cr & LPDS) != 0 ? WAKE_LOW_POWER_PS
                                                                 : WAKE_PS);
    rcc->is_stopped = false;
    m->stopped += awake_at - rcc->stopped_at;
    rcc_restart(m, awake_at);
    for (unsigned i = 0; i < EVENTS; i++) {
        if (rcc->left[i] != F405_NEVER) {
            f405_at(m, (enum f405_event)i, m->base_ps + rcc->left[i]);
        }
    }
}

uint64_t f405_stopped(const struct f405 *m) {
    return m->stopped + (m->rcc.is_stopped ? f405_now(m) - m->rcc.stopped_at : 0);
}

// Registers. The regulator follows its bits without delay.

uint32_t pwr_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    if (at > PWR_CSR) {
        f405_end(m, "reads 0x%08x, which is not modelled,", 0x40007000U + at);
    }
    return at == PWR_CR ? m->rcc.pwr_cr
                        : m->rcc.pwr_csr | PWR_VOS;  // VOSRDY is the same bit
}

void pwr_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    if (at == PWR_CR) {
        m->rcc.pwr_cr = value & 0x43F3;
        rcc_set_clocks(m);
    } else if (at == PWR_CSR) {
        m->rcc.pwr_csr = value & 0x300;
    } else {
        f405_end(m, "writes 0x%08x, which is not modelled,", 0x40007000U + at);
    }
}
