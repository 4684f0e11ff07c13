// SPDX-License-Identifier: MIT
// Time of the virtual STM32F405 and the moments of its events; see timing.h.
#include "f405.h"

// Picoseconds a cycle as a fraction in lowest terms, so that products fit into 64 bits
// for long: 125000/21 at 168 MHz, where 2^64/125000 cycles are 10 days. There are few
// clocks, so the last fractions are kept.
struct ratio {
    uint32_t hz;
    uint64_t ps, cycles;
};

static const struct ratio *ratio_of(uint32_t hz) {
    static struct ratio last[4];
    struct ratio *ratio = &last[(hz >> 4) & 3];
    if (ratio->hz != hz) {
        uint64_t a = F405_PS_PER_S;
        for (uint64_t b = hz; b != 0;) {
            const uint64_t rest = a % b;
            a = b;
            b = rest;
        }
        *ratio = (struct ratio){hz, F405_PS_PER_S / a, hz / a};
    }
    return ratio;
}

// a * b / c, in 128 bits where 64 are too few.
static uint64_t scale(uint64_t a, uint64_t b, uint64_t c, bool is_up) {
    uint64_t product = 0;
    const uint64_t more = is_up ? c - 1 : 0;
    if (__builtin_mul_overflow(a, b, &product) ||
        __builtin_add_overflow(product, more, &product)) {
        return (uint64_t)(((unsigned __int128)a * b + more) / c);
    }
    return product / c;
}

uint64_t f405_ps(uint64_t cycles, uint32_t hz) {
    if (hz == 0) {
        return F405_NEVER / 4;  // far in the future, and no sum with it overflows
    }
    const struct ratio *ratio = ratio_of(hz);
    return scale(cycles, ratio->ps, ratio->cycles, false);
}

uint64_t f405_now(const struct f405 *m) {
    if (m->hclk_hz == 0) {
        return m->base_ps;
    }
    return m->base_ps + f405_ps(m->cycle - m->base_cycle, m->hclk_hz);
}

uint64_t f405_when(const struct f405 *m) {
    return m->when != F405_NEVER ? m->when : f405_now(m);
}

uint64_t f405_ns(uint64_t ps) {
    return ps / 1000;
}

// The first cycle at or after that time.
uint64_t f405_cycle_at(const struct f405 *m, uint64_t ps) {
    if (ps <= m->base_ps) {
        return m->base_cycle;
    }
    if (m->hclk_hz == 0) {
        return m->base_cycle;
    }
    const struct ratio *ratio = ratio_of(m->hclk_hz);
    return m->base_cycle + scale(ps - m->base_ps, ratio->cycles, ratio->ps, true);
}

void f405_find_next(struct f405 *m) {
    uint64_t next = F405_NEVER;
    for (unsigned i = 0; i < EVENTS; i++) {
        next = m->at[i] < next ? m->at[i] : next;
    }
    m->next_ps = next;
}

static void limit(struct f405 *m, uint64_t ps) {
    if (m->is_in_code) {
        const uint64_t cycle = f405_cycle_at(m, ps);
        m->limit_cycle = cycle < m->limit_cycle ? cycle : m->limit_cycle;
    }
}

void f405_at(struct f405 *m, enum f405_event event, uint64_t ps) {
    m->at[event] = ps;
    f405_find_next(m);
    limit(m, ps);
}

void f405_never(struct f405 *m, enum f405_event event) {
    m->at[event] = F405_NEVER;
    f405_find_next(m);
}

void f405_attend(struct f405 *m) {
    m->attention = 1;
}

void f405_pause(struct f405 *m, uint64_t at_ps) {
    if (at_ps < m->until) {
        m->until = at_ps;
        limit(m, at_ps);
    }
}
