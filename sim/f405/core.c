// SPDX-License-Identifier: MIT
// The Cortex-M4 around its instructions: exceptions in and out, the NVIC, the system
// control block, SysTick, the cycle counter (ARM, part B; PM, "Core peripherals").
#include <string.h>

#include "f405.h"

enum {
    PRIORITY_NONE = 256,  // of thread mode
    PRIORITY_MASK = 0xF0,
    FRAME = 0x20,
    FRAME_FPU = 0x68,
    CONTROL_PSP = 1 << 1,
    CONTROL_FPU = 1 << 2,  // FPCA
    XPSR_ALIGNED = 1 << 9,
    XPSR_THUMB = 1 << 24,
    CCR_ALIGN = 1 << 9,
    FPCCR_AUTOMATIC = 1U << 31,  // ASPEN
    HFSR_FORCED = 1 << 30,
    // Units of core_read().
    UNIT_SCS = 0,
    UNIT_DWT = 1,
    // Registers: 0xE000E000 +
    ICTR = 0x004,
    ACTLR = 0x008,
    STK_CTRL = 0x010,
    STK_LOAD = 0x014,
    STK_VAL = 0x018,
    STK_CALIB = 0x01C,
    NVIC_ISER = 0x100,
    NVIC_ICER = 0x180,
    NVIC_ISPR = 0x200,
    NVIC_ICPR = 0x280,
    NVIC_IABR = 0x300,
    NVIC_IPR = 0x400,
    CPUID = 0xD00,
    ICSR = 0xD04,
    VTOR = 0xD08,
    AIRCR = 0xD0C,
    SCR = 0xD10,
    CCR = 0xD14,
    SHPR1 = 0xD18,
    SHPR3 = 0xD20,
    SHCSR = 0xD24,
    CFSR = 0xD28,
    HFSR = 0xD2C,
    DFSR = 0xD30,
    MMFAR = 0xD34,
    BFAR = 0xD38,
    AFSR = 0xD3C,
    CPACR = 0xD88,
    MPU_TYPE = 0xD90,
    DHCSR = 0xDF0,
    DEMCR = 0xDFC,
    STIR = 0xF00,
    FPCCR = 0xF34,
    FPCAR = 0xF38,
    FPDSCR = 0xF3C,
    MVFR0 = 0xF40,
    MVFR1 = 0xF44,
    SCR_ON_EXIT = 1 << 1,
    SCR_DEEP = 1 << 2,
    SCR_SEVONPEND = 1 << 4,
    STK_ENABLE = 1 << 0,
    STK_TICKINT = 1 << 1,
    STK_CLKSOURCE = 1 << 2,
    STK_COUNTFLAG = 1 << 16,
};

// Priorities: the lower the number, the more urgent.

static int group_mask(const struct f405 *m) {
    const unsigned group = (m->core.aircr >> 8) & 7;
    return (int)(0xFFU & ~((2U << group) - 1U));
}

static int priority_of(const struct f405 *m, unsigned exception) {
    switch (exception) {
    case EXCEPTION_NMI:
        return -2;
    case EXCEPTION_HARD_FAULT:
        return -1;
    default:
        return m->core.priority[exception];
    }
}

static int group_of(const struct f405 *m, int priority) {
    return priority < 0 ? priority : priority & group_mask(m);
}

// From there on; EXCEPTIONS where none is. Asked for at every stop of the core, and
// nearly always in vain.
static unsigned next_true(const bool flags[EXCEPTIONS], unsigned from) {
    const bool *found = memchr(flags + from, true, EXCEPTIONS - from);
    return found != NULL ? (unsigned)(found - flags) : EXCEPTIONS;
}

static int active_priority(const struct f405 *m) {
    int lowest = PRIORITY_NONE;
    for (unsigned i = next_true(m->core.active, EXCEPTION_NMI); i < EXCEPTIONS;
         i = next_true(m->core.active, i + 1)) {
        const int priority = group_of(m, priority_of(m, i));
        lowest = priority < lowest ? priority : lowest;
    }
    return lowest;
}

// ARM, "Execution priority and priority boosting". WFI looks past PRIMASK.
static int execution_priority(const struct f405 *m, bool with_primask) {
    int priority = active_priority(m);
    const int base = (int)(f405_get(m, UC_ARM_REG_BASEPRI) & PRIORITY_MASK);
    if (base != 0 && group_of(m, base) < priority) {
        priority = group_of(m, base);
    }
    if (with_primask && (f405_get(m, UC_ARM_REG_PRIMASK) & 1) != 0 && priority > 0) {
        priority = 0;
    }
    if ((f405_get(m, UC_ARM_REG_FAULTMASK) & 1) != 0 && priority > -1) {
        priority = -1;
    }
    return priority;
}

static bool is_enabled(const struct f405 *m, unsigned exception) {
    switch (exception) {
    case EXCEPTION_MEMORY_FAULT:
        return (m->core.shcsr & (1U << 16)) != 0;
    case EXCEPTION_BUS_FAULT:
        return (m->core.shcsr & (1U << 17)) != 0;
    case EXCEPTION_USAGE_FAULT:
        return (m->core.shcsr & (1U << 18)) != 0;
    default:
        return exception < EXCEPTION_IRQ || m->core.enabled[exception];
    }
}

// The most urgent that is pending and enabled; 0: none.
static unsigned find_pending(const struct f405 *m) {
    unsigned best = 0;
    for (unsigned i = next_true(m->core.pending, EXCEPTION_NMI); i < EXCEPTIONS;
         i = next_true(m->core.pending, i + 1)) {
        if (is_enabled(m, i) &&
            (best == 0 || priority_of(m, i) < priority_of(m, best))) {
            best = i;
        }
    }
    return best;
}

void core_pend(struct f405 *m, unsigned exception) {
    if ((m->core.scr & SCR_SEVONPEND) != 0 && !m->core.pending[exception]) {
        m->core.has_event = true;
    }
    m->core.pending[exception] = true;
    f405_attend(m);
}

// A line of the NVIC, or the NMI: asked for when its level rises, and again at the end
// of its handler where the level is still there (ARM, "NVIC operation").
void core_irq(struct f405 *m, unsigned exception, bool level) {
    struct f405_core *core = &m->core;
    if (level && !core->level[exception]) {
        core_pend(m, exception);
    }
    core->level[exception] = level;
}

bool core_wakes(const struct f405 *m) {
    const unsigned exception = find_pending(m);
    if (m->is_waiting && m->core.has_event) {
        return true;
    }
    // ARM, "Wait For Event": PRIMASK holds there, unlike with WFI.
    return exception != 0 && group_of(m, priority_of(m, exception)) <
                                 execution_priority(m, m->is_waiting);
}

bool core_sleep(struct f405 *m) {
    const bool is_deep = (m->core.scr & SCR_DEEP) != 0;
    // A pending line of EXTI, and STOP mode is not entered (RM, "Stop mode").
    if ((m->is_waiting && m->core.has_event) || (is_deep && m->exti.pr != 0)) {
        m->core.has_event = m->core.has_event && !m->is_waiting;
        m->is_waiting = false;
        return false;
    }
    m->is_asleep = true;
    m->is_deep = is_deep;
    return true;
}

bool core_can_wake(const struct f405 *m) {
    if (m->rcc.is_stopped) {
        return exti_can_wake(m);
    }
    if ((m->core.tick_control & STK_TICKINT) != 0) {
        return true;
    }
    for (unsigned i = EXCEPTION_IRQ; i < EXCEPTIONS; i++) {
        if (m->core.enabled[i]) {
            return true;
        }
    }
    return false;
}

// Into an exception and out of it (ARM, "Exception entry behavior" and "Exception
// return behavior"). The FPU's registers are saved at once where hardware would leave
// room and save them when the handler first uses it: nobody but a handler that reads
// its own frame could tell.

static const int saved[8] = {
    UC_ARM_REG_R0,  UC_ARM_REG_R1, UC_ARM_REG_R2, UC_ARM_REG_R3,
    UC_ARM_REG_R12, UC_ARM_REG_LR, UC_ARM_REG_PC, UC_ARM_REG_XPSR,
};
enum { SAVED_PC = 6, SAVED_XPSR = 7, SAVED_FPU = 16 };

static void lock_up(struct f405 *m) {
    m->is_locked_up = true;
}

static bool push_frame(struct f405 *m, uint32_t sp, bool with_fpu, bool is_aligned) {
    uint32_t frame[FRAME_FPU / 4] = {0};
    uint8_t *memory = f405_memory(m, sp, with_fpu ? FRAME_FPU : FRAME);
    if (memory == NULL || f405_is_flash(sp)) {
        return false;
    }
    for (unsigned i = 0; i < 8; i++) {
        frame[i] = f405_get(m, saved[i]);
    }
    frame[SAVED_PC] = m->pc;
    frame[SAVED_XPSR] |= XPSR_THUMB;
    frame[SAVED_XPSR] &= ~(uint32_t)XPSR_ALIGNED;
    frame[SAVED_XPSR] |= is_aligned ? XPSR_ALIGNED : 0;
    if (with_fpu) {
        for (unsigned i = 0; i < 16; i++) {
            frame[8 + i] = f405_get(m, UC_ARM_REG_S0 + (int)i);
        }
        frame[8 + SAVED_FPU] = f405_get(m, UC_ARM_REG_FPSCR);
    }
    memcpy(memory, frame, with_fpu ? FRAME_FPU : FRAME);
    return true;
}

static void enter(struct f405 *m, unsigned exception) {
    struct f405_core *core = &m->core;
    const uint32_t control = f405_get(m, UC_ARM_REG_CONTROL);
    const bool with_fpu = (control & CONTROL_FPU) != 0;
    const bool is_thread = active_priority(m) == PRIORITY_NONE;
    if ((control & CONTROL_PSP) != 0) {
        f405_not_modelled(m, "the process stack");
        return;
    }
    uint32_t sp = f405_sp(m);
    const bool is_aligned = (sp & 4) != 0 && (core->ccr & CCR_ALIGN) != 0;
    sp = (sp - (with_fpu ? FRAME_FPU : FRAME)) & (is_aligned ? ~UINT32_C(7) : ~0U);
    if (!push_frame(m, sp, with_fpu, is_aligned)) {
        f405_end(m, "has its stack outside of memory");
        return;
    }
    const uint8_t *vector = f405_memory(m, core->vtor + 4 * exception, 4);
    uint32_t handler = 0;
    if (vector != NULL) {
        memcpy(&handler, vector, sizeof handler);
    }
    core->pending[exception] = false;
    core->active[exception] = true;
    core->has_event = true;
    f405_set(m, UC_ARM_REG_CONTROL, control & ~(uint32_t)CONTROL_FPU);
    f405_set(m, UC_ARM_REG_SP, sp);
    f405_set(m, UC_ARM_REG_XPSR,
             (f405_get(m, UC_ARM_REG_XPSR) & 0xF80F0000U) | XPSR_THUMB | exception);
    f405_set(m, UC_ARM_REG_LR,
             (with_fpu ? 0xFFFFFFE1U : 0xFFFFFFF1U) | (is_thread ? 8U : 0U));
    if (m->watch.on_enter != NULL) {
        m->watch.on_enter(m->watch.context, m->pc, handler & ~UINT32_C(1));
    }
    m->pc = handler & ~UINT32_C(1);
    if ((handler & 1) == 0) {
        f405_end(m, "has no vector for exception %u", exception);
    }
}

bool core_take(struct f405 *m) {
    const unsigned exception = find_pending(m);
    m->is_blocked = false;
    if (exception == 0) {
        return false;
    }
    if (group_of(m, priority_of(m, exception)) >= execution_priority(m, true)) {
        m->is_blocked = true;
        return false;
    }
    enter(m, exception);
    return true;
}

// A fault that its handler can't be called for becomes a hard fault; one in the handler
// of hard faults locks the core up (ARM, "Fault behavior").
void core_fault(struct f405 *m, unsigned exception, uint32_t status) {
    const int priority = execution_priority(m, true);
    m->core.cfsr |= status;
    if (exception != EXCEPTION_HARD_FAULT &&
        (!is_enabled(m, exception) ||
         group_of(m, priority_of(m, exception)) >= priority)) {
        exception = EXCEPTION_HARD_FAULT;
        m->core.hfsr |= HFSR_FORCED;
    }
    if (exception == EXCEPTION_HARD_FAULT && priority <= -1) {
        lock_up(m);
        return;
    }
    enter(m, exception);
}

void core_service_call(struct f405 *m) {
    if (group_of(m, priority_of(m, EXCEPTION_SVC)) >= execution_priority(m, true)) {
        m->core.hfsr |= HFSR_FORCED;
        core_fault(m, EXCEPTION_HARD_FAULT, 0);
    } else {
        enter(m, EXCEPTION_SVC);
    }
}

static void pop_frame(struct f405 *m, const uint32_t *frame, bool with_fpu) {
    for (unsigned i = 0; i < SAVED_PC; i++) {
        f405_set(m, saved[i], frame[i]);
    }
    m->pc = frame[SAVED_PC] & ~UINT32_C(1);
    if (with_fpu) {
        for (unsigned i = 0; i < 16; i++) {
            f405_set(m, UC_ARM_REG_S0 + (int)i, frame[8 + i]);
        }
        f405_set(m, UC_ARM_REG_FPSCR, frame[8 + SAVED_FPU]);
    }
}

void core_return(struct f405 *m, uint32_t exc_return) {
    struct f405_core *core = &m->core;
    const unsigned exception = f405_get(m, UC_ARM_REG_IPSR) & 0x1FF;
    const uint32_t kind = exc_return & ~UINT32_C(0x10);
    const bool with_fpu = (exc_return & 0x10) == 0;
    if (exception == 0 || exception >= EXCEPTIONS || !core->active[exception] ||
        (kind != 0xFFFFFFE1U && kind != 0xFFFFFFE9U)) {
        f405_end(m, "returns by 0x%08x from no exception", exc_return);
        return;
    }
    const uint32_t sp = f405_sp(m);
    const uint8_t *memory = f405_memory(m, sp, with_fpu ? FRAME_FPU : FRAME);
    if (memory == NULL) {
        f405_end(m, "has its stack outside of memory");
        return;
    }
    uint32_t frame[FRAME_FPU / 4];
    memcpy(frame, memory, with_fpu ? FRAME_FPU : FRAME);
    core->active[exception] = false;
    if (exception != EXCEPTION_NMI) {
        f405_set(m, UC_ARM_REG_FAULTMASK, 0);
    }
    const bool is_thread = active_priority(m) == PRIORITY_NONE;
    if (is_thread != (kind == 0xFFFFFFE9U) ||
        is_thread != ((frame[SAVED_XPSR] & 0x1FF) == 0)) {
        f405_end(m, "returns by 0x%08x where another mode was left", exc_return);
        return;
    }
    pop_frame(m, frame, with_fpu);
    if (m->watch.on_leave != NULL) {
        m->watch.on_leave(m->watch.context);
    }
    uint32_t next = sp + (with_fpu ? FRAME_FPU : FRAME);
    next |= (frame[SAVED_XPSR] & XPSR_ALIGNED) != 0 ? 4U : 0U;
    f405_set(m, UC_ARM_REG_XPSR, frame[SAVED_XPSR] & ~(uint32_t)XPSR_ALIGNED);
    f405_set(m, UC_ARM_REG_CONTROL, with_fpu ? CONTROL_FPU : 0);
    f405_set(m, UC_ARM_REG_SP, next);
    if (core->level[exception]) {
        core_pend(m, exception);
    }
    core->has_event = true;
    if (is_thread && (core->scr & SCR_ON_EXIT) != 0) {
        (void)core_sleep(m);
    }
}

// SysTick

static uint32_t tick_hz(const struct f405 *m) {
    return (m->core.tick_control & STK_CLKSOURCE) != 0 ? m->hclk_hz : m->hclk_hz / 8;
}

// It counts down to 0, then comes the load.
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
    // From 0 it takes the load first.
    const uint64_t left =
        core->tick_held != 0 ? core->tick_held : core->tick_load + 1ULL;
    f405_at(m, EVENT_SYSTICK, core->tick_from + f405_ps(left, tick_hz(m)));
}

static void hold_tick(struct f405 *m) {
    m->core.tick_held = tick_value(m);
    m->core.tick_from = f405_when(m);
}

void core_tick(struct f405 *m) {
    struct f405_core *core = &m->core;
    core->tick_held = 0;
    core->tick_from = f405_when(m);
    core->tick_control |= STK_COUNTFLAG;
    if ((core->tick_control & STK_TICKINT) != 0) {
        core_pend(m, EXCEPTION_SYSTICK);
    }
    plan_tick(m);
}

void core_clock_changes(struct f405 *m, bool is_before) {
    if (is_before) {
        hold_tick(m);
    } else {
        plan_tick(m);
    }
}

static uint32_t read_tick_control(struct f405 *m) {
    const uint32_t value = m->core.tick_control;
    m->core.tick_control &= ~(uint32_t)STK_COUNTFLAG;
    return value;
}

static void write_tick(struct f405 *m, uint32_t at, uint32_t value) {
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

// The cycle counter (ARM, "DWT"): stands while the core sleeps.

static uint32_t cycle_count(const struct f405 *m) {
    const struct f405_core *core = &m->core;
    if (!core->counts_cycles) {
        return core->cycles_held;
    }
    return (uint32_t)(m->cycle - m->asleep_cycles - core->cycles_at);
}

static void count_cycles(struct f405 *m, uint32_t from) {
    struct f405_core *core = &m->core;
    core->cycles_held = from;
    core->counts_cycles = (core->demcr & (1U << 24)) != 0 && (core->dwt_control & 1);
    core->cycles_at = m->cycle - m->asleep_cycles - from;
}

// Registers

static uint32_t read_bits(const bool *bits, uint32_t at) {
    uint32_t word = 0;
    for (unsigned i = 0; i < 32; i++) {
        const unsigned line = 8 * at + i;
        if (line < IRQ_LINES && bits[EXCEPTION_IRQ + line]) {
            word |= UINT32_C(1) << i;
        }
    }
    return word;
}

static void write_bits(bool *bits, uint32_t at, uint32_t word, bool value) {
    for (unsigned i = 0; i < 32; i++) {
        const unsigned line = 8 * at + i;
        if (line < IRQ_LINES && ((word >> i) & 1) != 0) {
            bits[EXCEPTION_IRQ + line] = value;
        }
    }
}

static uint32_t read_priorities(const struct f405 *m, unsigned first) {
    uint32_t word = 0;
    for (unsigned i = 0; i < 4; i++) {
        if (first + i < EXCEPTIONS) {
            word |= (uint32_t)m->core.priority[first + i] << (8 * i);
        }
    }
    return word;
}

static void write_priorities(struct f405 *m, unsigned first, uint32_t word) {
    for (unsigned i = 0; i < 4; i++) {
        const bool is_fixed = first + i <= EXCEPTION_HARD_FAULT;
        if (first + i < EXCEPTIONS && !is_fixed) {
            m->core.priority[first + i] = (uint8_t)((word >> (8 * i)) & PRIORITY_MASK);
        }
    }
}

static uint32_t read_icsr(const struct f405 *m) {
    const struct f405_core *core = &m->core;
    unsigned lines = 0;
    unsigned active = 0;
    for (unsigned i = EXCEPTION_NMI; i < EXCEPTIONS; i++) {
        lines |= i >= EXCEPTION_IRQ && core->pending[i] ? 1U : 0U;
        active += core->active[i] ? 1U : 0U;
    }
    return (f405_get(m, UC_ARM_REG_IPSR) & 0x1FF) | (active <= 1 ? 1U << 11 : 0U) |
           (find_pending(m) << 12) | (lines << 22) |
           (core->pending[EXCEPTION_SYSTICK] ? 1U << 26 : 0U) |
           (core->pending[EXCEPTION_PENDSV] ? 1U << 28 : 0U) |
           (core->pending[EXCEPTION_NMI] ? 1U << 31 : 0U);
}

static uint32_t read_shcsr(const struct f405 *m) {
    static const struct {
        uint8_t exception, active, pending;
    } bits[] = {
        {EXCEPTION_MEMORY_FAULT, 0, 13}, {EXCEPTION_BUS_FAULT, 1, 14},
        {EXCEPTION_USAGE_FAULT, 3, 12},  {EXCEPTION_SVC, 7, 15},
        {EXCEPTION_PENDSV, 10, 31},      {EXCEPTION_SYSTICK, 11, 31},
    };
    uint32_t value = m->core.shcsr;
    for (size_t i = 0; i < sizeof bits / sizeof *bits; i++) {
        value |= m->core.active[bits[i].exception] ? UINT32_C(1) << bits[i].active : 0;
        if (bits[i].pending != 31 && m->core.pending[bits[i].exception]) {
            value |= UINT32_C(1) << bits[i].pending;
        }
    }
    return value;
}

static uint32_t read_scs(struct f405 *m, uint32_t at) {
    const struct f405_core *core = &m->core;
    if (at >= NVIC_ISER && at < NVIC_ISER + 0x40) {
        return read_bits(core->enabled, at - NVIC_ISER);
    }
    if (at >= NVIC_ICER && at < NVIC_ICER + 0x40) {
        return read_bits(core->enabled, at - NVIC_ICER);
    }
    if (at >= NVIC_ISPR && at < NVIC_ISPR + 0x40) {
        return read_bits(core->pending, at - NVIC_ISPR);
    }
    if (at >= NVIC_ICPR && at < NVIC_ICPR + 0x40) {
        return read_bits(core->pending, at - NVIC_ICPR);
    }
    if (at >= NVIC_IABR && at < NVIC_IABR + 0x40) {
        return read_bits(core->active, at - NVIC_IABR);
    }
    if (at >= NVIC_IPR && at < NVIC_IPR + 0xF0) {
        return read_priorities(m, EXCEPTION_IRQ + (at - NVIC_IPR));
    }
    if (at >= SHPR1 && at <= SHPR3) {
        return read_priorities(m, 4 + (at - SHPR1));
    }
    switch (at) {
    case ICTR:
        return 2;
    case ACTLR:
    case AFSR:
    case DHCSR:  // no debugger
        return 0;
    case STK_CTRL:
        return read_tick_control(m);
    case STK_LOAD:
        return core->tick_load;
    case STK_VAL:
        return tick_value(m);
    case STK_CALIB:
        return 0x40000000 | 18750;  // RM, "SysTick calibration value register"
    case CPUID:
        return 0x410FC241;
    case ICSR:
        return read_icsr(m);
    case VTOR:
        return core->vtor;
    case AIRCR:
        return 0xFA050000 | core->aircr;
    case SCR:
        return core->scr;
    case CCR:
        return core->ccr;
    case SHCSR:
        return read_shcsr(m);
    case CFSR:
        return core->cfsr;
    case HFSR:
        return core->hfsr;
    case DFSR:
        return core->dfsr;
    case MMFAR:
        return core->mmfar;
    case BFAR:
        return core->bfar;
    case CPACR:
        return core->cpacr;
    case MPU_TYPE:
        return 0x800;
    case DEMCR:
        return core->demcr;
    case FPCCR:
        return core->fpccr;
    case FPCAR:
        return core->fpcar;
    case FPDSCR:
        return core->fpdscr;
    case MVFR0:
        return 0x10110021;
    case MVFR1:
        return 0x11000011;
    default:
        f405_end(m, "reads 0x%08x, which is not modelled,", 0xE000E000U + at);
        return 0;
    }
}

static void write_icsr(struct f405 *m, uint32_t value) {
    struct f405_core *core = &m->core;
    if ((value & (1U << 31)) != 0) {
        core_pend(m, EXCEPTION_NMI);
    }
    if ((value & (1U << 28)) != 0) {
        core_pend(m, EXCEPTION_PENDSV);
    } else if ((value & (1U << 27)) != 0) {
        core->pending[EXCEPTION_PENDSV] = false;
    }
    if ((value & (1U << 26)) != 0) {
        core_pend(m, EXCEPTION_SYSTICK);
    } else if ((value & (1U << 25)) != 0) {
        core->pending[EXCEPTION_SYSTICK] = false;
    }
}

static void write_aircr(struct f405 *m, uint32_t value) {
    if ((value >> 16) != 0x05FA) {
        f405_complain(m, "AIRCR written without its key");
        return;
    }
    m->core.aircr = value & 0x700;
    if ((value & 1) != 0) {
        f405_not_modelled(m, "VECTRESET");
    }
    if ((value & 4) != 0) {
        f405_reset(m, F405_RESET_SOFTWARE);
    }
}

// True where the address is one of the NVIC's.
static bool write_nvic(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_core *core = &m->core;
    if (at >= NVIC_ISER && at < NVIC_ISER + 0x40) {
        write_bits(core->enabled, at - NVIC_ISER, value, true);
    } else if (at >= NVIC_ICER && at < NVIC_ICER + 0x40) {
        write_bits(core->enabled, at - NVIC_ICER, value, false);
    } else if (at >= NVIC_ISPR && at < NVIC_ISPR + 0x40) {
        write_bits(core->pending, at - NVIC_ISPR, value, true);
    } else if (at >= NVIC_ICPR && at < NVIC_ICPR + 0x40) {
        write_bits(core->pending, at - NVIC_ICPR, value, false);
        for (unsigned i = EXCEPTION_IRQ; i < EXCEPTIONS; i++) {
            core->pending[i] |= core->level[i] && !core->active[i];
        }
    } else if (at >= NVIC_IPR && at < NVIC_IPR + 0xF0) {
        write_priorities(m, EXCEPTION_IRQ + (at - NVIC_IPR), value);
    } else if (at >= SHPR1 && at <= SHPR3) {
        write_priorities(m, 4 + (at - SHPR1), value);
    } else if (at == STIR) {
        if ((value & 0x1FF) < IRQ_LINES) {
            core->pending[EXCEPTION_IRQ + (value & 0x1FF)] = true;
        }
    } else {
        return false;
    }
    return true;
}

static void write_scs(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_core *core = &m->core;
    f405_attend(m);
    if (write_nvic(m, at, value)) {
        return;
    }
    switch (at) {
    case ACTLR:
        break;  // timing only
    case STK_CTRL:
    case STK_LOAD:
    case STK_VAL:
        write_tick(m, at, value);
        break;
    case ICSR:
        write_icsr(m, value);
        break;
    case VTOR:
        core->vtor = value & 0x3FFFFE00;  // PM: 98 exceptions, so 512 bytes
        break;
    case AIRCR:
        write_aircr(m, value);
        break;
    case SCR:
        core->scr = value & 0x16;
        break;
    case CCR:
        core->ccr = value & 0x31B;
        if ((value & (1U << 3)) != 0) {
            f405_not_modelled(m, "UNALIGN_TRP");
        }
        break;
    case SHCSR:
        core->shcsr = value & 0x70000;
        break;
    case CFSR:
        core->cfsr &= ~value;
        break;
    case HFSR:
        core->hfsr &= ~value;
        break;
    case DFSR:
        core->dfsr &= ~value;
        break;
    case MMFAR:
        core->mmfar = value;
        break;
    case BFAR:
        core->bfar = value;
        break;
    case CPACR:
        core->cpacr = value & 0x00F00000;
        break;
    case DEMCR: {
        const uint32_t count = cycle_count(m);
        core->demcr = value & 0x01000000;
        count_cycles(m, count);
        break;
    }
    case FPCCR:
        core->fpccr = value & 0xC0000000;
        if ((value & FPCCR_AUTOMATIC) == 0) {
            f405_not_modelled(m, "FPU registers that are not saved");
        }
        break;
    case FPCAR:
        core->fpcar = value & ~UINT32_C(7);
        break;
    case FPDSCR:
        core->fpdscr = value & 0x07C00000;
        if (core->fpdscr != 0) {
            f405_not_modelled(m, "another FPU mode by default");
        }
        break;
    default:
        f405_end(m, "writes 0x%08x, which is not modelled,", 0xE000E000U + at);
        break;
    }
}

uint32_t core_read(struct f405 *m, unsigned unit, uint32_t at) {
    if (unit == UNIT_SCS) {
        return read_scs(m, at);
    }
    if (unit == UNIT_DWT && at == 0) {
        return 0x40000000 | m->core.dwt_control;
    }
    if (unit == UNIT_DWT && at == 4) {
        return cycle_count(m);
    }
    if (unit != UNIT_DWT && at == 0) {
        return 0x10076413;  // RM, "DBGMCU_IDCODE": revision 1
    }
    if (unit != UNIT_DWT && at <= 12) {
        return m->core.debug;
    }
    f405_end(m, "reads a register of %s that is not modelled,",
             unit == UNIT_DWT ? "the DWT" : "DBGMCU");
    return 0;
}

void core_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    if (unit == UNIT_SCS) {
        write_scs(m, at, value);
    } else if (unit == UNIT_DWT && at == 0) {
        const uint32_t count = cycle_count(m);
        m->core.dwt_control = value & 1;
        count_cycles(m, count);
    } else if (unit == UNIT_DWT && at == 4) {
        count_cycles(m, value);
    } else {
        f405_end(m, "writes a register of %s that is not modelled,",
                 unit == UNIT_DWT ? "the DWT" : "DBGMCU");
    }
}

void core_reset(struct f405 *m) {
    memset(&m->core, 0, sizeof m->core);
    m->core.ccr = CCR_ALIGN;
    m->core.fpccr = 0xC0000000;
    count_cycles(m, 0);
}
