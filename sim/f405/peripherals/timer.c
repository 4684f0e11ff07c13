// SPDX-License-Identifier: MIT
// TIM2 to TIM5 counting up: update, compare without a pin, capture from PB0 and PB1
// (TIM3, channels 3 and 4) and PB3 (TIM2, channel 2) (RM, "General-purpose timers").
#include "f405/f405.h"

enum {
    CR1 = 0x00,
    CR2 = 0x04,
    SMCR = 0x08,
    DIER = 0x0C,
    SR = 0x10,
    EGR = 0x14,
    CCMR1 = 0x18,
    CCMR2 = 0x1C,
    CCER = 0x20,
    CNT = 0x24,
    PSC = 0x28,
    ARR = 0x2C,
    CCR1 = 0x34,
    CCR4 = 0x40,
    OR = 0x50,
    CR1_CEN = 1 << 0,
    CR1_UDIS = 1 << 1,
    CR1_URS = 1 << 2,
    CR1_OPM = 1 << 3,
    CR1_ARPE = 1 << 7,
    CR1_KNOWN = 0x8F,
    UIF = 1 << 0,
    DIER_KNOWN = 0x5F,
    CHANNELS = 4,
};

static const uint8_t lines[TIMERS] = {IRQ_TIM2, IRQ_TIM3, IRQ_TIM4, IRQ_TIM5};

static uint32_t widest(unsigned unit) {
    return unit == 0 || unit == 3 ? UINT32_MAX : UINT16_MAX;
}

static bool is_counting(const struct f405_timer *timer) {
    return (timer->cr1 & CR1_CEN) != 0;
}

// Ticks since `from`.
static uint64_t gone(const struct f405 *m, const struct f405_timer *timer) {
    if (!is_counting(timer)) {
        return 0;
    }
    const uint64_t now = f405_when(m);
    const uint64_t past = now > timer->from ? now - timer->from : 0;
    return (uint64_t)((unsigned __int128)past * m->timer_hz / F405_PS_PER_S /
                      (timer->shadow_psc + 1ULL));
}

static uint64_t period(const struct f405_timer *timer) {
    return timer->shadow_arr + 1ULL;
}

// Ticks from `from` until the counter overflows. A count above the reload value runs to
// the counter's full width.
static uint64_t until_overflow(const struct f405_timer *timer, unsigned unit) {
    if (timer->count > timer->shadow_arr) {
        return widest(unit) - (uint64_t)timer->count + 1 + period(timer);
    }
    return period(timer) - timer->count;
}

static uint32_t count_of(const struct f405 *m, const struct f405_timer *timer,
                         unsigned unit) {
    const uint64_t ticks = gone(m, timer);
    const uint64_t first = until_overflow(timer, unit);
    return (uint32_t)(ticks < first ? (timer->count + ticks) & widest(unit)
                                    : (ticks - first) % period(timer));
}

static unsigned selection(const struct f405_timer *timer, unsigned channel) {
    return (timer->ccmr[channel / 2] >> (8 * (channel % 2))) & 3;
}

// Ticks from `from` to the match of a compare channel; 0: none in this period.
static uint64_t until_match(const struct f405_timer *timer, unsigned channel) {
    const uint32_t value = timer->ccr[channel];
    return value > timer->count && value <= timer->shadow_arr ? value - timer->count
                                                              : 0;
}

static void follow_line(struct f405 *m, unsigned unit) {
    const struct f405_timer *timer = &m->timers[unit];
    core_irq(m, EXCEPTION_IRQ + lines[unit], (timer->sr & timer->dier & 0x5F) != 0);
}

static uint64_t moment(const struct f405 *m, const struct f405_timer *timer,
                       uint64_t ticks) {
    const uint64_t cycles = ticks * (timer->shadow_psc + 1ULL);
    // The first picosecond at which this many ticks have passed.
    return timer->from + f405_ps(cycles, m->timer_hz) + 1;
}

static void plan(struct f405 *m, unsigned unit) {
    const struct f405_timer *timer = &m->timers[unit];
    const enum f405_event event = (enum f405_event)(EVENT_TIMER2 + unit);
    if (!is_counting(timer) || m->timer_hz == 0) {
        f405_never(m, event);
        return;
    }
    uint64_t next = until_overflow(timer, unit);
    for (unsigned channel = 0; channel < CHANNELS; channel++) {
        const uint64_t ticks = until_match(timer, channel);
        if (selection(timer, channel) == 0 && ticks > timer->seen && ticks < next &&
            (timer->dier & (2U << channel)) != 0) {
            next = ticks;
        }
    }
    f405_at(m, event, moment(m, timer, next));
}

// Sets the flags of the matches since the last call.
static void see(struct f405 *m, unsigned unit) {
    struct f405_timer *timer = &m->timers[unit];
    const uint64_t ticks = gone(m, timer);
    for (unsigned channel = 0; channel < CHANNELS; channel++) {
        const uint64_t at = until_match(timer, channel);
        if (selection(timer, channel) == 0 && at > timer->seen && at <= ticks) {
            timer->sr |= 2U << channel;
        }
    }
    timer->seen = ticks;
}

static void update(struct f405_timer *timer) {
    timer->shadow_psc = timer->psc;
    timer->shadow_arr = timer->arr;
}

static void rebase(struct f405 *m, unsigned unit, uint64_t at, uint32_t count) {
    struct f405_timer *timer = &m->timers[unit];
    timer->from = at;
    timer->count = count;
    timer->seen = 0;
    plan(m, unit);
}

// Has the counter count on from the last tick.
static void hold(struct f405 *m, unsigned unit) {
    struct f405_timer *timer = &m->timers[unit];
    see(m, unit);
    const uint32_t count = count_of(m, timer, unit);
    const uint64_t ticks = gone(m, timer);
    if (is_counting(timer)) {
        timer->from += f405_ps(ticks * (timer->shadow_psc + 1ULL), m->timer_hz);
    }
    timer->count = count;
    timer->seen = 0;
}

static void overflow(struct f405 *m, unsigned unit) {
    struct f405_timer *timer = &m->timers[unit];
    const uint64_t at =
        timer->from +
        f405_ps(until_overflow(timer, unit) * (timer->shadow_psc + 1ULL), m->timer_hz);
    if ((timer->cr1 & CR1_UDIS) == 0) {
        timer->sr |= UIF;
        update(timer);
    }
    if ((timer->cr1 & CR1_OPM) != 0) {
        timer->cr1 &= ~(uint32_t)CR1_CEN;
    }
    rebase(m, unit, at, 0);
    for (unsigned channel = 0; channel < CHANNELS; channel++) {
        if (selection(timer, channel) == 0 && timer->ccr[channel] == 0) {
            timer->sr |= 2U << channel;
        }
    }
}

void timer_event(struct f405 *m, unsigned unit) {
    struct f405_timer *timer = &m->timers[unit];
    see(m, unit);
    if (gone(m, timer) >= until_overflow(timer, unit)) {
        overflow(m, unit);
    }
    plan(m, unit);
    follow_line(m, unit);
}

void timer_clock_changes(struct f405 *m, bool is_before) {
    for (unsigned unit = 0; unit < TIMERS; unit++) {
        if (is_before && m->timer_hz != 0) {
            hold(m, unit);
        } else if (is_before) {
            m->timers[unit].from = f405_when(m);  // it has stood
        } else if (!is_before) {
            plan(m, unit);
        }
    }
}

// The pins that are capture inputs (DS, "Alternate function mapping").
void timer_edge(struct f405 *m, unsigned port, unsigned pin, bool is_high) {
    static const struct {
        uint8_t pin, af, unit, channel;
    } routes[] = {{0, 2, 1, 2}, {1, 2, 1, 3}, {3, 1, 0, 1}};
    for (unsigned i = 0; i < sizeof routes / sizeof *routes; i++) {
        const unsigned channel = routes[i].channel;
        struct f405_timer *timer = &m->timers[routes[i].unit];
        if (port != PORT_B || pin != routes[i].pin ||
            !pins_is_alternate(m, PORT_B, pin, routes[i].af) ||
            selection(timer, channel) != 1) {
            continue;
        }
        const unsigned enable = (timer->ccer >> (4 * channel)) & 15;
        const bool wants_falling = (enable & 2) != 0;  // CCxP; with CCxNP both
        const bool wants_both = (enable & 10) == 10;
        if ((enable & 1) == 0 || (!wants_both && wants_falling == is_high)) {
            continue;
        }
        if (((timer->ccmr[channel / 2] >> (8 * (channel % 2) + 2)) & 3) != 0) {
            f405_not_modelled(m, "a prescaler of captures");
        }
        const uint32_t flag = 2U << channel;
        timer->sr |= (timer->sr & flag) != 0 ? flag << 8 : 0;
        timer->sr |= flag;
        timer->ccr[channel] = count_of(m, timer, routes[i].unit);
        follow_line(m, routes[i].unit);
    }
}

uint32_t timer_read(struct f405 *m, unsigned unit, uint32_t at) {
    struct f405_timer *timer = &m->timers[unit];
    switch (at) {
    case CR1:
        return timer->cr1;
    case CR2:
    case SMCR:
    case EGR:
        return 0;
    case DIER:
        return timer->dier;
    case SR:
        see(m, unit);
        return timer->sr;
    case CCMR1:
    case CCMR2:
        return timer->ccmr[(at - CCMR1) / 4];
    case CCER:
        return timer->ccer;
    case CNT:
        return count_of(m, timer, unit);
    case PSC:
        return timer->psc;
    case ARR:
        return timer->arr;
    default:
        break;
    }
    if (at >= CCR1 && at <= CCR4) {
        const unsigned channel = (at - CCR1) / 4;
        if (selection(timer, channel) != 0) {  // reading a capture clears its flag
            timer->sr &= ~(2U << channel);
            follow_line(m, unit);
        }
        return timer->ccr[channel];
    }
    f405_not_modelled(m, "a register of a timer");
    return 0;
}

static void write_control(struct f405 *m, unsigned unit, uint32_t value) {
    struct f405_timer *timer = &m->timers[unit];
    const bool was_counting = is_counting(timer);
    if ((value & ~(uint32_t)CR1_KNOWN) != 0) {
        f405_not_modelled(m, "a timer that does not simply count up");
    }
    timer->cr1 = value & CR1_KNOWN;
    if (was_counting || !is_counting(timer)) {
        return;
    }
    timer->from = f405_when(m);
    if ((unit == 0 || unit == 3) && m->clock_start == F405_NEVER) {
        m->clock_start = timer->from;
    }
}

static void generate(struct f405 *m, unsigned unit, uint32_t value) {
    struct f405_timer *timer = &m->timers[unit];
    if ((value & UIF) != 0 && (timer->cr1 & CR1_UDIS) == 0) {
        update(timer);
        timer->count = 0;
        timer->from = f405_when(m);
        timer->sr |= (timer->cr1 & CR1_URS) == 0 ? UIF : 0;
    }
    if ((value & ~(uint32_t)UIF) != 0) {
        f405_not_modelled(m, "captures and compares by software");
    }
}

static void write_register(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    struct f405_timer *timer = &m->timers[unit];
    switch (at) {
    case CR1:
        write_control(m, unit, value);
        break;
    case CR2:
    case SMCR:
        if (value != 0) {
            f405_not_modelled(m, "a timer that leads or follows another");
        }
        break;
    case DIER:
        timer->dier = value & DIER_KNOWN;
        if ((value & ~(uint32_t)DIER_KNOWN) != 0) {
            f405_not_modelled(m, "DMA by a timer");
        }
        break;
    case SR:
        timer->sr &= value;
        break;
    case EGR:
        generate(m, unit, value);
        break;
    case CCMR1:
    case CCMR2:
        timer->ccmr[(at - CCMR1) / 4] = value & 0xFFFF;
        break;
    case CCER:
        timer->ccer = value & 0xBBBB;
        break;
    case CNT:
        timer->count = value & widest(unit);
        timer->from = f405_when(m);
        break;
    case PSC:
        timer->psc = value & 0xFFFF;
        break;
    case ARR:
        timer->arr = value & widest(unit);
        if ((timer->cr1 & CR1_ARPE) == 0) {
            timer->shadow_arr = timer->arr;
        }
        break;
    case OR:
        if (value != 0) {
            f405_not_modelled(m, "a timer's internal inputs");
        }
        break;
    default:
        if (at >= CCR1 && at <= CCR4) {
            timer->ccr[(at - CCR1) / 4] = value & widest(unit);
        } else {
            f405_not_modelled(m, "a register of a timer");
        }
        break;
    }
}

void timer_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    if (m->timer_hz != 0) {
        hold(m, unit);
    }
    write_register(m, unit, at, value);
    plan(m, unit);
    follow_line(m, unit);
}

void timer_reset(struct f405 *m, unsigned unit) {
    m->timers[unit] =
        (struct f405_timer){.arr = widest(unit), .shadow_arr = widest(unit)};
    f405_never(m, (enum f405_event)(EVENT_TIMER2 + unit));
    follow_line(m, unit);
}
