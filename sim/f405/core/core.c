// SPDX-License-Identifier: MIT
// The Cortex-M4's exceptions, faults and sleep: priorities, entry and return (ARM, part
// B; PM, "Core peripherals").
#include <string.h>

#include "f405/f405.h"

enum {
    PRIORITY_NONE = 256,  // of thread mode
    FRAME = 0x20,
    FRAME_FPU = 0x68,
    CONTROL_PSP = 1 << 1,
    CONTROL_FPU = 1 << 2,  // FPCA
    XPSR_ALIGNED = 1 << 9,
    XPSR_THUMB = 1 << 24,
    HFSR_FORCED = 1 << 30,
    SCR_ON_EXIT = 1 << 1,
    SCR_DEEP = 1 << 2,
    SCR_SEVONPEND = 1 << 4,
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

// The first flag from there on that is set; EXCEPTIONS: none. Called at every stop of
// the core, and nearly always finds none, so it has to be fast.
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

// ARM, "Execution priority and priority boosting". WFI ignores PRIMASK.
static int execution_priority(const struct f405 *m, bool with_primask) {
    int priority = active_priority(m);
    const int base = (int)(f405_get(m, UC_ARM_REG_BASEPRI) & CORE_PRIORITY_MASK);
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
unsigned core_find_pending(const struct f405 *m) {
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

// A line of the NVIC, or the NMI, becomes pending when its level rises, and again at
// the end of its handler if the level is still high (ARM, "NVIC operation").
void core_irq(struct f405 *m, unsigned exception, bool level) {
    struct f405_core *core = &m->core;
    if (level && !core->level[exception]) {
        core_pend(m, exception);
    }
    core->level[exception] = level;
}

bool core_wakes(const struct f405 *m) {
    const unsigned exception = core_find_pending(m);
    if (m->is_waiting && m->core.has_event) {
        return true;
    }
    // ARM, "Wait For Event": PRIMASK counts here, unlike with WFI.
    return exception != 0 && group_of(m, priority_of(m, exception)) <
                                 execution_priority(m, m->is_waiting);
}

bool core_sleep(struct f405 *m) {
    const bool is_deep = (m->core.scr & SCR_DEEP) != 0;
    // With a pending line of EXTI, STOP mode is not entered (RM, "Stop mode").
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
    if (systick_interrupts(m)) {
        return true;
    }
    for (unsigned i = EXCEPTION_IRQ; i < EXCEPTIONS; i++) {
        if (m->core.enabled[i]) {
            return true;
        }
    }
    return false;
}

// Entry and return (ARM, "Exception entry behavior" and "Exception return behavior").
// The FPU's registers are saved at once; hardware leaves room and saves them when the
// handler first uses the FPU. Only a handler that reads its own frame could tell the
// difference.

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
    const bool is_aligned = (sp & 4) != 0 && (core->ccr & CORE_CCR_ALIGN) != 0;
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
    const unsigned exception = core_find_pending(m);
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

// A fault whose handler can't be called becomes a hard fault; a fault in the handler of
// hard faults locks the core up (ARM, "Fault behavior").
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

void core_reset(struct f405 *m) {
    memset(&m->core, 0, sizeof m->core);
    m->core.ccr = CORE_CCR_ALIGN;
    m->core.fpccr = 0xC0000000;
    cycle_counter_write(m, 0);
}
