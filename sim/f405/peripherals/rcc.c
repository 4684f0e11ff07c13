// SPDX-License-Identifier: MIT
// Clocks and resets (RM, "Reset and clock control").
#include "f405/f405.h"

enum {
    CR = 0x00,
    PLLCFGR = 0x04,
    CFGR = 0x08,
    CIR = 0x0C,
    RSTR = 0x10,
    ENR = 0x30,
    LPENR = 0x50,
    BDCR = 0x70,
    CSR = 0x74,
    SSCGR = 0x80,
    PLLI2SCFGR = 0x84,
    HSION = 1 << 0,
    HSIRDY = 1 << 1,
    HSEON = 1 << 16,
    HSERDY = 1 << 17,
    HSEBYP = 1 << 18,
    CSSON = 1 << 19,
    PLLON = 1 << 24,
    PLLRDY = 1 << 25,
    PLLI2SON = 1 << 26,
    PLL_FROM_HSE = 1 << 22,
    LSION = 1 << 0,
    LSIRDY = 1 << 1,
    RMVF = 1 << 24,
    CSSF = 1 << 7,
    CSSC = 1 << 23,
    SOURCE_HSI = 0,
    SOURCE_HSE = 1,
    SOURCE_PLL = 2,
    // DS, "General operating conditions".
    SYSCLK_MAX_HZ = 168000000,
    HCLK_LOW_VOS_HZ = 144000000,
    PCLK1_MAX_HZ = 42000000,
    PCLK2_MAX_HZ = 84000000,
    // RM, "Relation between CPU clock frequency and flash memory read time": 3.3 V.
    WAIT_STATE_HZ = 30000000,
};
// DS, oscillator characteristics: HSE 2 ms, HSI 2.2 us, LSI 15 us, PLL 75 to 200 us.
#define HSE_START_PS (2000 * F405_PS_PER_US)
#define HSI_START_PS (22 * F405_PS_PER_US / 10)
#define LSI_START_PS (15 * F405_PS_PER_US)
#define PLL_LOCK_PS (150 * F405_PS_PER_US)

static const uint32_t lpenr_reset[6] = {0x7E6791FF, 0x000000F1, 1,
                                        0,          0x36FEC9FF, 0x00075F33};

static bool uses(const struct f405 *m, uint32_t source) {
    return ((m->rcc.cfgr >> 2) & 3) == source;
}

static bool pll_from_hse(const struct f405 *m) {
    return (m->rcc.pllcfgr & PLL_FROM_HSE) != 0;
}

static uint32_t pll_hz(struct f405 *m) {
    const uint32_t config = m->rcc.pllcfgr;
    const uint32_t source = pll_from_hse(m) ? m->crystal_hz : m->hsi_hz;
    const uint32_t divider = config & 0x3F;
    const uint32_t factor = (config >> 6) & 0x1FF;
    const uint32_t post = 2 * (((config >> 16) & 3) + 1);
    if (divider < 2 || factor < 50 || factor > 432) {
        f405_complain(m, "PLLCFGR outside of what the manual allows");
        return 0;
    }
    const uint64_t vco = (uint64_t)source * factor / divider;
    if (source / divider < 950000 || source / divider > 2100000 || vco < 100000000 ||
        vco > 432000000) {
        f405_complain(m, "the PLL outside of its frequencies");
    }
    return (uint32_t)(vco / post);
}

static uint32_t ahb_divider(uint32_t code) {
    static const uint16_t dividers[8] = {2, 4, 8, 16, 64, 128, 256, 512};
    return (code & 8) != 0 ? dividers[code & 7] : 1;
}

static uint32_t apb_divider(uint32_t code) {
    return (code & 4) != 0 ? 2U << (code & 3) : 1;
}

static uint32_t sysclk_hz(struct f405 *m) {
    if (m->rcc.is_stopped) {
        return 0;
    }
    switch ((m->rcc.cfgr >> 2) & 3) {
    case SOURCE_HSE:
        return (m->rcc.cr & HSERDY) != 0 ? m->crystal_hz : 0;
    case SOURCE_PLL:
        return (m->rcc.cr & PLLRDY) != 0 ? pll_hz(m) : 0;
    default:
        return m->hsi_hz;
    }
}

uint32_t rcc_nominal_hz(const struct f405 *m, uint32_t hz) {
    const bool is_from_hsi =
        uses(m, SOURCE_HSI) || (uses(m, SOURCE_PLL) && !pll_from_hse(m));
    return is_from_hsi ? (uint32_t)((uint64_t)hz * F405_HSI_HZ / m->hsi_hz) : hz;
}

// Complains of clocks that the data sheet does not allow.
static void check_clocks(struct f405 *m, uint32_t sysclk) {
    const uint32_t hclk_hz = rcc_nominal_hz(m, m->hclk_hz);
    if (rcc_nominal_hz(m, sysclk) > SYSCLK_MAX_HZ ||
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

// Time up to here passed at the old rate, time from here on passes at the new one.
void rcc_set_clocks(struct f405 *m) {
    const uint64_t now = f405_when(m);
    timer_clock_changes(m, true);
    timer11_clock_changes(m, true);
    systick_clock_changes(m, true);
    m->base_ps = f405_now(m) > now ? f405_now(m) : now;
    m->base_cycle = m->cycle;
    const uint32_t sysclk = sysclk_hz(m);
    m->hclk_hz = sysclk / ahb_divider((m->rcc.cfgr >> 4) & 15);
    const uint32_t divider = apb_divider((m->rcc.cfgr >> 10) & 7);
    m->pclk_hz[0] = m->hclk_hz / divider;
    const uint32_t divider2 = apb_divider((m->rcc.cfgr >> 13) & 7);
    m->pclk_hz[1] = m->hclk_hz / divider2;
    m->timer_hz = divider == 1 ? m->hclk_hz : 2 * m->pclk_hz[0];
    m->timer2_hz = divider2 == 1 ? m->hclk_hz : 2 * m->pclk_hz[1];
    check_clocks(m, sysclk);
    timer_clock_changes(m, false);
    timer11_clock_changes(m, false);
    systick_clock_changes(m, false);
    m->limit_cycle = m->cycle;  // has the core stop, as its limit depends on the rate
    f405_attend(m);
}

static void plan(struct f405 *m) {
    const struct f405_rcc *rcc = &m->rcc;
    const uint64_t moments[] = {rcc->hsi_at, rcc->hse_at, rcc->pll_at, rcc->lsi_at};
    uint64_t next = F405_NEVER;
    for (unsigned i = 0; i < 4; i++) {
        next = moments[i] < next ? moments[i] : next;
    }
    f405_at(m, EVENT_OSCILLATORS, next);
}

static bool is_ready(const struct f405 *m, uint32_t source) {
    const uint32_t flags[] = {HSIRDY, HSERDY, PLLRDY, 0};
    return (m->rcc.cr & flags[source & 3]) != 0;
}

// The switch waits for its source (RM, "System clock (SYSCLK) selection").
static void switch_clock(struct f405 *m) {
    struct f405_rcc *rcc = &m->rcc;
    const uint32_t wanted = rcc->cfgr & 3;
    if (wanted == 3) {
        f405_complain(m, "a clock source selected that there is none of");
    } else if (is_ready(m, wanted) && ((rcc->cfgr >> 2) & 3) != wanted) {
        rcc->cfgr = (rcc->cfgr & ~UINT32_C(0xC)) | (wanted << 2);
        rcc_set_clocks(m);
    }
}

// A ready flag, with its interrupt where that is enabled: bits of CIR in the order LSI,
// LSE, HSI, HSE, PLL.
static void raise_ready(struct f405 *m, unsigned bit) {
    struct f405_rcc *rcc = &m->rcc;
    if (((rcc->cir >> (8 + bit)) & 1) != 0) {
        rcc->cir |= UINT32_C(1) << bit;
    }
    core_irq(m, EXCEPTION_IRQ + IRQ_RCC, (rcc->cir & 0x3F) != 0);
}

void rcc_event(struct f405 *m) {
    struct f405_rcc *rcc = &m->rcc;
    const uint64_t now = f405_when(m);
    if (rcc->hsi_at <= now) {
        rcc->hsi_at = F405_NEVER;
        rcc->cr |= HSIRDY;
        raise_ready(m, 2);
    }
    if (rcc->hse_at <= now) {
        rcc->hse_at = F405_NEVER;
        rcc->cr |= HSERDY;
        rcc->hse_since = now;
        timer11_follow(m);
        raise_ready(m, 3);
    }
    if (rcc->pll_at <= now) {
        rcc->pll_at = F405_NEVER;
        rcc->cr |= PLLRDY;
        raise_ready(m, 4);
    }
    if (rcc->lsi_at <= now) {
        rcc->lsi_at = F405_NEVER;
        rcc->csr |= LSIRDY;
        raise_ready(m, 0);
    }
    plan(m);
    switch_clock(m);
}

static void start_pll(struct f405 *m) {
    struct f405_rcc *rcc = &m->rcc;
    const bool has_source = (rcc->cr & (pll_from_hse(m) ? HSERDY : HSIRDY)) != 0;
    if (!has_source) {
        f405_complain(m, "the PLL started before its source is ready");
    } else if (pll_hz(m) != 0) {
        rcc->pll_at = f405_when(m) + PLL_LOCK_PS;
    }
}

// Switches oscillators on or off; one that is in use stays on (RM, "RCC clock control
// register").
static void write_cr(struct f405 *m, uint32_t value) {
    struct f405_rcc *rcc = &m->rcc;
    const uint32_t old = rcc->cr;
    const uint64_t now = f405_when(m);
    if (uses(m, SOURCE_HSI) || (uses(m, SOURCE_PLL) && !pll_from_hse(m))) {
        value |= HSION;
    }
    if (uses(m, SOURCE_HSE) || (uses(m, SOURCE_PLL) && pll_from_hse(m))) {
        value |= HSEON;
    }
    if (uses(m, SOURCE_PLL)) {
        value |= PLLON;
    }
    const uint32_t writable = HSION | 0xF8 | HSEON | HSEBYP | CSSON | PLLON;
    rcc->cr = (old & ~writable) | (value & writable);
    const uint32_t risen = rcc->cr & ~old;
    const uint32_t fallen = old & ~rcc->cr;
    if ((value & PLLI2SON) != 0) {
        f405_not_modelled(m, "PLLI2S");
    }
    if ((risen & HSION) != 0) {
        rcc->hsi_at = now + HSI_START_PS;
    }
    if ((fallen & HSION) != 0) {
        rcc->cr &= ~(uint32_t)HSIRDY;
        rcc->hsi_at = F405_NEVER;
    }
    // A bypassed oscillator waits for an external clock, and here is a crystal.
    if ((risen & HSEON) != 0 && !rcc->is_crystal_dead && (rcc->cr & HSEBYP) == 0) {
        rcc->hse_at = now + HSE_START_PS;
    }
    if ((fallen & HSEON) != 0) {
        rcc->cr &= ~(uint32_t)HSERDY;
        rcc->hse_at = F405_NEVER;
        timer11_follow(m);
    }
    if ((risen & PLLON) != 0) {
        start_pll(m);
    }
    if ((fallen & PLLON) != 0) {
        rcc->cr &= ~(uint32_t)PLLRDY;
        rcc->pll_at = F405_NEVER;
    }
    plan(m);
}

// RM, "Clock security system (CSS)": a non-maskable interrupt, and HSI replaces the
// clock that has stopped.
void f405_kill_crystal(struct f405 *m) {
    struct f405_rcc *rcc = &m->rcc;
    rcc->is_crystal_dead = true;
    rcc->hse_at = F405_NEVER;
    if ((rcc->cr & HSERDY) == 0) {
        plan(m);
        return;
    }
    rcc->cr &= ~(uint32_t)HSERDY;
    timer11_follow(m);
    const bool was_pll = (rcc->cr & PLLON) != 0 && pll_from_hse(m);
    if (was_pll) {
        rcc->cr &= ~(uint32_t)PLLRDY;
        rcc->pll_at = F405_NEVER;
    }
    if ((rcc->cr & CSSON) != 0) {
        rcc->cr &= ~(uint32_t)(HSEON | CSSON);
        rcc->cir |= CSSF;
        core_irq(m, EXCEPTION_NMI, true);
        if (!is_ready(m, (rcc->cfgr >> 2) & 3)) {
            rcc->cr |= HSION | HSIRDY;
            rcc->cr &= ~(uint32_t)(was_pll ? PLLON : 0);
            rcc->cfgr &= ~UINT32_C(0xF);
        }
    }
    plan(m);
    rcc_set_clocks(m);
}

static void write_cir(struct f405 *m, uint32_t value) {
    struct f405_rcc *rcc = &m->rcc;
    rcc->cir = (rcc->cir & ~UINT32_C(0x3F00)) | (value & 0x3F00);
    rcc->cir &= ~((value >> 16) & 0x3F);
    if ((value & CSSC) != 0) {
        rcc->cir &= ~(uint32_t)CSSF;
        core_irq(m, EXCEPTION_NMI, false);
    }
    core_irq(m, EXCEPTION_IRQ + IRQ_RCC, (rcc->cir & 0x3F) != 0);
}

static void write_csr(struct f405 *m, uint32_t value) {
    struct f405_rcc *rcc = &m->rcc;
    const uint32_t old = rcc->csr;
    rcc->csr = (old & ~(uint32_t)LSION) | (value & LSION);
    if ((value & RMVF) != 0) {
        rcc->csr &= UINT32_C(0x00FFFFFF);
    }
    if ((rcc->csr & ~old & LSION) != 0) {
        rcc->lsi_at = f405_when(m) + LSI_START_PS;
    }
    if ((rcc->csr & LSION) == 0 && !m->iwdg.is_running) {
        rcc->csr &= ~(uint32_t)LSIRDY;
        rcc->lsi_at = F405_NEVER;
    }
    plan(m);
}

// Resets the peripherals whose bits are set.
static void hold(struct f405 *m, unsigned bus, uint32_t bits) {
    static const struct {
        uint8_t bus, bit, unit;
        void (*reset)(struct f405 *m, unsigned unit);
    } units[] = {
        {0, 0, PORT_A, pins_reset}, {0, 1, PORT_B, pins_reset},
        {0, 2, PORT_C, pins_reset}, {0, 3, PORT_D, pins_reset},
        {0, 7, PORT_H, pins_reset}, {0, 21, 0, dma_reset},
        {0, 22, 1, dma_reset},      {4, 0, 0, timer_reset},
        {4, 1, 1, timer_reset},     {4, 2, 2, timer_reset},
        {4, 3, 3, timer_reset},     {4, 17, 0, usart_reset},
        {4, 21, 0, i2c_reset},      {5, 8, 0, adc_reset},
        {5, 12, 0, spi_reset},      {5, 14, 0, syscfg_reset},
        {5, 18, 0, timer11_reset},
    };
    for (unsigned i = 0; i < sizeof units / sizeof *units; i++) {
        if (units[i].bus == bus && ((bits >> units[i].bit) & 1) != 0) {
            units[i].reset(m, units[i].unit);
            bits &= ~(UINT32_C(1) << units[i].bit);
        }
    }
    if (bus == 4 && ((bits >> 28) & 1) != 0) {
        m->rcc.pwr_cr = PWR_VOS;
        bits &= ~(UINT32_C(1) << 28);
    }
    if (bits != 0) {
        f405_not_modelled(m, "the reset of a peripheral");
    }
}

static void write_bus(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_rcc *rcc = &m->rcc;
    if (at >= LPENR) {
        const unsigned index = (at - LPENR) / 4;
        rcc->lpenr[index] = value;
        if (value != lpenr_reset[index]) {
            f405_not_modelled(m, "clocks that stop in sleep");
        }
    } else if (at >= ENR) {
        rcc->enr[(at - ENR) / 4] = value;
    } else {
        rcc->rstr[(at - RSTR) / 4] = value;
        hold(m, (at - RSTR) / 4, value);
    }
}

static bool is_bus_register(uint32_t at) {
    const uint32_t bases[] = {RSTR, ENR, LPENR};
    for (unsigned i = 0; i < 3; i++) {
        const uint32_t index = (at - bases[i]) / 4;
        if (at >= bases[i] && index < 6 && index != 3) {
            return true;
        }
    }
    return false;
}

uint32_t rcc_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    const struct f405_rcc *rcc = &m->rcc;
    if (is_bus_register(at)) {
        const uint32_t *bank = at >= LPENR ? rcc->lpenr
                               : at >= ENR ? rcc->enr
                                           : rcc->rstr;
        return bank[(at >= LPENR ? at - LPENR : at >= ENR ? at - ENR : at - RSTR) / 4];
    }
    switch (at) {
    case CR:
        return rcc->cr;
    case PLLCFGR:
        return rcc->pllcfgr;
    case CFGR:
        return rcc->cfgr;
    case CIR:
        return rcc->cir;
    case BDCR:
        return rcc->bdcr;
    case CSR:
        return rcc->csr;
    case SSCGR:
        return rcc->sscgr;
    case PLLI2SCFGR:
        return rcc->plli2scfgr;
    default:
        f405_end(m, "reads 0x%08x, which is not modelled,", 0x40023800U + at);
        return 0;
    }
}

void rcc_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_rcc *rcc = &m->rcc;
    if (is_bus_register(at)) {
        write_bus(m, at, value);
        return;
    }
    switch (at) {
    case CR:
        write_cr(m, value);
        break;
    case PLLCFGR:
        if ((rcc->cr & PLLON) != 0) {
            f405_complain(m, "PLLCFGR written while the PLL is on");
        } else {
            rcc->pllcfgr = value;
        }
        break;
    case CFGR:
        rcc->cfgr = (value & ~UINT32_C(0xC)) | (rcc->cfgr & 0xC);
        rcc_set_clocks(m);
        timer11_follow(m);
        switch_clock(m);
        break;
    case CIR:
        write_cir(m, value);
        break;
    case CSR:
        write_csr(m, value);
        break;
    case PLLI2SCFGR:
        rcc->plli2scfgr = value;
        break;
    default:
        f405_end(m, "writes 0x%08x, which is not modelled,", 0x40023800U + at);
        break;
    }
}

void rcc_halt(struct f405 *m) {
    struct f405_rcc *rcc = &m->rcc;
    rcc->hse_at = rcc->hsi_at = rcc->pll_at = F405_NEVER;
    plan(m);
    rcc_set_clocks(m);
}

void rcc_restart(struct f405 *m, uint64_t at_ps) {
    struct f405_rcc *rcc = &m->rcc;
    rcc->cr &= ~(uint32_t)(HSEON | HSERDY | PLLON | PLLRDY);
    timer11_follow(m);
    rcc->cr |= HSION | HSIRDY;
    rcc->cfgr &= ~UINT32_C(0xF);
    m->base_ps = at_ps;
    rcc_set_clocks(m);
}

void rcc_power_up(struct f405 *m) {
    m->rcc.csr = 0;
}

// Flags of earlier resets stay until software clears them. Every reset of the chip
// pulls its reset pin low too (RM, "System reset").
void rcc_reset(struct f405 *m, uint32_t cause) {
    struct f405_rcc *rcc = &m->rcc;
    const bool is_dead = rcc->is_crystal_dead;
    const uint32_t causes = (rcc->csr & 0xFF000000U) | cause | F405_RESET_PIN;
    *rcc = (struct f405_rcc){
        .cr = 0x8000 | 0x80 | HSION | HSIRDY,  // calibration, trim
        .pllcfgr = 0x24003010,
        .enr = {0x00100000},
        .csr = causes,
        .plli2scfgr = 0x20003000,
        .hse_at = F405_NEVER,
        .hsi_at = F405_NEVER,
        .pll_at = F405_NEVER,
        .lsi_at = F405_NEVER,
        .is_crystal_dead = is_dead,
        .pwr_cr = PWR_VOS,
    };
    for (unsigned i = 0; i < 6; i++) {
        rcc->lpenr[i] = lpenr_reset[i];
    }
    m->flash_control.acr = 0;
    rcc_set_clocks(m);
}
