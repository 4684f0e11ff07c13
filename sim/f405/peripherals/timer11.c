// SPDX-License-Identifier: MIT
// TIM11 counting up freely, with captures of HSE_RTC on its channel (RM,
// "TIM10/11/13/14 registers"; "Internal/external clock measurement using TIM5/TIM11").
// HSE_RTC is the crystal divided by RTCPRE (RM, "RCC clock configuration register").
#include "f405/f405.h"

enum {
    CR1 = 0x00,
    DIER = 0x0C,
    SR = 0x10,
    EGR = 0x14,
    CCMR1 = 0x18,
    CCER = 0x20,
    CNT = 0x24,
    PSC = 0x28,
    ARR = 0x2C,
    CCR1 = 0x34,
    OR = 0x50,
    CR1_CEN = 1 << 0,
    CR1_KNOWN = CR1_CEN | 1 << 7,
    UG = 1 << 0,
    UIF = 1 << 0,
    CC1IF = 1 << 1,
    CC1OF = 1 << 9,
    CC1S = 3 << 0,
    CC1S_TI1 = 1 << 0,
    IC1PSC_SHIFT = 2,
    IC1F = 15 << 4,
    CC1E = 1 << 0,
    CC1P = 1 << 1,
    CC1NP = 1 << 3,
    TI1_RMP = 3 << 0,
    TI1_HSE_RTC = 2 << 0,
    RTCPRE_SHIFT = 16,
    RTCPRE_MASK = 31,
    HSERDY = 1 << 17,
    // An input changes at most every second look of the timer; one more for its jitter.
    CLOCKS_PER_EDGE_MIN = 3,
};

static bool is_counting(const struct f405_timer11 *timer) {
    return (timer->cr1 & CR1_CEN) != 0;
}

static uint32_t count_of(const struct f405 *m) {
    const struct f405_timer11 *timer = &m->timer11;
    const uint64_t now = f405_when(m);
    if (!is_counting(timer) || now <= timer->from) {
        return timer->count;
    }
    const uint64_t ticks =
        (uint64_t)((unsigned __int128)(now - timer->from) * m->timer2_hz /
                   F405_PS_PER_S / (timer->shadow_psc + 1ULL));
    return (uint32_t)((timer->count + ticks) & UINT16_MAX);
}

// 0 and 1: no clock.
static uint32_t divider(const struct f405 *m) {
    return (m->rcc.cfgr >> RTCPRE_SHIFT) & RTCPRE_MASK;
}

static bool is_watching(const struct f405 *m) {
    const struct f405_timer11 *timer = &m->timer11;
    return (timer->option & TI1_RMP) == TI1_HSE_RTC &&
           (timer->ccmr1 & CC1S) == CC1S_TI1 && (timer->ccer & CC1E) != 0 &&
           (m->rcc.cr & HSERDY) != 0 && divider(m) >= 2;
}

static uint64_t edge_ps(const struct f405 *m, uint64_t edge) {
    return m->rcc.hse_since + f405_ps(edge * divider(m), m->crystal_hz);
}

static void plan(struct f405 *m) {
    if (is_watching(m)) {
        f405_at(m, EVENT_TIMER11, edge_ps(m, m->timer11.edge));
    } else {
        f405_never(m, EVENT_TIMER11);
    }
}

void timer11_follow(struct f405 *m) {
    if (is_watching(m)) {
        if ((uint64_t)m->crystal_hz * CLOCKS_PER_EDGE_MIN >
            (uint64_t)m->timer2_hz * divider(m)) {
            f405_complain(m, "TIM11 looks at edges faster than it can see");
        }
        const uint64_t past = f405_when(m) - m->rcc.hse_since;
        m->timer11.edge = (uint64_t)((unsigned __int128)past * m->crystal_hz /
                                     F405_PS_PER_S / divider(m)) +
                          1;
    }
    plan(m);
}

void timer11_event(struct f405 *m) {
    struct f405_timer11 *timer = &m->timer11;
    if (!is_watching(m)) {
        return;
    }
    timer->sr |= (timer->sr & CC1IF) != 0 ? CC1IF | CC1OF : CC1IF;
    timer->ccr1 = count_of(m);
    timer->edge += UINT64_C(1) << ((timer->ccmr1 >> IC1PSC_SHIFT) & 3);
    plan(m);
}

void timer11_clock_changes(struct f405 *m, bool is_before) {
    if (is_before) {
        m->timer11.count = count_of(m);
    } else {
        m->timer11.from = f405_when(m);
    }
}

uint32_t timer11_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    struct f405_timer11 *timer = &m->timer11;
    switch (at) {
    case CR1:
        return timer->cr1;
    case SR:
        return timer->sr;
    case DIER:
    case EGR:
        return 0;
    case CCMR1:
        return timer->ccmr1;
    case CCER:
        return timer->ccer;
    case CNT:
        return count_of(m);
    case PSC:
        return timer->psc;
    case ARR:
        return timer->arr;
    case CCR1:
        timer->sr &= ~(uint32_t)CC1IF;  // reading a capture clears its flag
        return timer->ccr1;
    case OR:
        return timer->option;
    default:
        f405_not_modelled(m, "a register of TIM11");
        return 0;
    }
}

static void generate(struct f405 *m, uint32_t value) {
    struct f405_timer11 *timer = &m->timer11;
    if ((value & ~(uint32_t)UG) != 0) {
        f405_not_modelled(m, "captures of TIM11 by software");
    }
    if ((value & UG) != 0) {
        timer->shadow_psc = timer->psc;
        timer->count = 0;
        timer->sr |= UIF;
    }
}

static void write_mode(struct f405 *m, uint32_t value) {
    struct f405_timer11 *timer = &m->timer11;
    if ((value & CC1S) > CC1S_TI1 || (value & IC1F) != 0 || value > UINT8_MAX) {
        f405_not_modelled(m, "filters and compares of TIM11");
    }
    if ((timer->ccer & CC1E) != 0 && ((value ^ timer->ccmr1) & CC1S) != 0) {
        f405_complain(m, "a channel of TIM11 changed while it is on");
    }
    timer->ccmr1 = value;
}

static void write_register(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_timer11 *timer = &m->timer11;
    switch (at) {
    case CR1:
        if ((value & ~(uint32_t)CR1_KNOWN) != 0) {
            f405_not_modelled(m, "TIM11 as anything but a free counter");
        }
        timer->cr1 = value;
        break;
    case DIER:
        if (value != 0) {
            f405_not_modelled(m, "interrupts of TIM11");
        }
        break;
    case SR:
        timer->sr &= value;
        break;
    case EGR:
        generate(m, value);
        break;
    case CCMR1:
        write_mode(m, value);
        break;
    case CCER:
        if ((value & (CC1P | CC1NP)) != 0) {
            f405_not_modelled(m, "falling edges at TIM11");
        }
        timer->ccer = value & CC1E;
        break;
    case CNT:
        timer->count = value & UINT16_MAX;
        break;
    case PSC:
        timer->psc = value & UINT16_MAX;
        break;
    case ARR:
        if (value != UINT16_MAX) {
            f405_not_modelled(m, "TIM11 with a shorter period");
        }
        break;
    case OR:
        timer->option = value & TI1_RMP;
        break;
    default:
        f405_not_modelled(m, "a register of TIM11");
        break;
    }
}

void timer11_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    m->timer11.count = count_of(m);
    m->timer11.from = f405_when(m);
    write_register(m, at, value);
    if (at == OR || at == CCMR1 || at == CCER) {
        timer11_follow(m);
    }
}

void timer11_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    m->timer11 = (struct f405_timer11){.arr = UINT16_MAX};
    f405_never(m, EVENT_TIMER11);
}
