// SPDX-License-Identifier: MIT
// The core's two counters: SysTick, which counts down and may interrupt (PM, "SysTick
// timer"), and DWT_CYCCNT, which stands while the core sleeps (ARM, "DWT").
#include "f405/f405.h"

enum {
    STK_CTRL = 0x0,
    STK_LOAD = 0x4,
    STK_VAL = 0x8,
    STK_ENABLE = 1 << 0,
    STK_TICKINT = 1 << 1,
    STK_CLKSOURCE = 1 << 2,
    STK_COUNTFLAG = 1 << 16,
};

static uint32_t tick_hz(const struct f405 *m) {
    return (m->core.tick_control & STK_CLKSOURCE) != 0 ? m->hclk_hz : m->hclk_hz / 8;
}

// The counter goes down to 0, then starts again from the load value.
static uint32_t tick_value(const struct f405 *m) {
    const struct f405_core *core = &m->core;
    if ((core->tick_control & STK_ENABLE) == 0 || core->tick_load == 0 ||
        m->hclk_hz == 0) {
        return core->tick_held;
    }
    const uint64_t gone =
        (uint64_t)((unsigned __int128)(f405_when(m) - core->tick_from) * tick_hz(m) /
                   F405_PS_PER_S);
    if (gone <= core->tick_held) {
        return core->tick_held - (uint32_t)gone;
    }
    const uint64_t past = (gone - core->tick_held - 1) % (core->tick_load + 1ULL);
    return core->tick_load - (uint32_t)past;
}

static void plan_tick(struct f405 *m) {
    const struct f405_core *core = &m->core;
    if ((core->tick_control & STK_ENABLE) == 0 || core->tick_load == 0) {
        f405_never(m, EVENT_SYSTICK);
        return;
    }
    // From 0 it goes to the load value first.
    const uint64_t left =
        core->tick_held != 0 ? core->tick_held : core->tick_load + 1ULL;
    f405_at(m, EVENT_SYSTICK, core->tick_from + f405_ps(left, tick_hz(m)));
}

static void hold_tick(struct f405 *m) {
    m->core.tick_held = tick_value(m);
    m->core.tick_from = f405_when(m);
}

void systick_event(struct f405 *m) {
    struct f405_core *core = &m->core;
    core->tick_held = 0;
    core->tick_from = f405_when(m);
    core->tick_control |= STK_COUNTFLAG;
    if ((core->tick_control & STK_TICKINT) != 0) {
        core_pend(m, EXCEPTION_SYSTICK);
    }
    plan_tick(m);
}

void systick_clock_changes(struct f405 *m, bool is_before) {
    if (is_before) {
        hold_tick(m);
    } else {
        plan_tick(m);
    }
}

bool systick_interrupts(const struct f405 *m) {
    return (m->core.tick_control & STK_TICKINT) != 0;
}

static uint32_t read_control(struct f405 *m) {
    const uint32_t value = m->core.tick_control;
    m->core.tick_control &= ~(uint32_t)STK_COUNTFLAG;
    return value;
}

uint32_t systick_read(struct f405 *m, uint32_t at) {
    switch (at) {
    case STK_CTRL:
        return read_control(m);
    case STK_LOAD:
        return m->core.tick_load;
    case STK_VAL:
        return tick_value(m);
    default:
        return 0x40000000 | 18750;  // RM, "SysTick calibration value register"
    }
}

void systick_write(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_core *core = &m->core;
    hold_tick(m);
    if (at == STK_CTRL) {
        core->tick_control = (core->tick_control & STK_COUNTFLAG) | (value & 7);
    } else if (at == STK_LOAD) {
        core->tick_load = value & 0xFFFFFF;
    } else if (at == STK_VAL) {
        core->tick_held = 0;
        core->tick_control &= ~(uint32_t)STK_COUNTFLAG;
    }
    plan_tick(m);
}

uint32_t cycle_counter_read(const struct f405 *m) {
    const struct f405_core *core = &m->core;
    if (!core->counts_cycles) {
        return core->cycles_held;
    }
    return (uint32_t)(m->cycle - m->asleep_cycles - core->cycles_at);
}

void cycle_counter_write(struct f405 *m, uint32_t from) {
    struct f405_core *core = &m->core;
    core->cycles_held = from;
    core->counts_cycles = (core->demcr & (1U << 24)) != 0 && (core->dwt_control & 1);
    core->cycles_at = m->cycle - m->asleep_cycles - from;
}
