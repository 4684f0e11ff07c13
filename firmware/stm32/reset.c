// SPDX-License-Identifier: MIT
// Two watchdogs. The first is SysTick, which can say where the program hangs; the
// second is the hardware's, for when not even interrupts come.
#include "reset.h"

#include "../board.h"
#include "core/wire/messages.h"
#include "cpu.h"
#include "idle.h"
#include "start.h"

enum {
    // Ticks of 1 ms: 200 ms without a kick. Longer than any step of the main loop,
    // shorter than the hardware's watchdog at its fastest.
    TICKS_MAX = 200,
    // 1 ms a count at the nominal 32 kHz; 47 kHz at most, 17 at least ("LSI oscillator
    // characteristics"): 0.34 to 0.94 s.
    PRESCALER_32 = 3,
    RELOAD = 500,
    FRAME_BYTES = 32,  // r0 to r3, r12, lr, pc, psr
};

// Numbers that memory is unlikely to contain by chance.
enum mark { MARK_FAULT = 0x0FA17BAD, MARK_HANG = 0x4A46BAD1, MARK_ASKED = 0x0B007ED1 };

__attribute__((section(".noinit"))) struct reset_record reset_record;

static uint8_t cause;
static uint32_t address;
static volatile uint8_t ticks;  // since the last kick
static volatile bool is_watched;

static uint8_t cause_of(uint32_t flags) {
    if ((flags & RCC_CSR_PORRSTF) != 0) {
        return RESET_CAUSE_POWER_ON;
    }
    if ((flags & RCC_CSR_BORRSTF) != 0) {
        return RESET_CAUSE_BROWN_OUT;
    }
    if ((flags & (RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)) != 0) {
        return RESET_CAUSE_WATCHDOG;
    }
    if ((flags & RCC_CSR_SFTRSTF) != 0) {
        switch (reset_record.mark) {
        case MARK_FAULT:
            return RESET_CAUSE_HARD_FAULT;
        case MARK_HANG:
            return RESET_CAUSE_WATCHDOG;
        default:
            return RESET_CAUSE_SOFTWARE;
        }
    }
    // Every reset shows at the pin, hence last.
    return (flags & RCC_CSR_PINRSTF) != 0 ? RESET_CAUSE_EXTERNAL : 0;
}

void reset_init(bool has_slept) {
    cause = has_slept ? RESET_CAUSE_SOFTWARE : cause_of(RCC->csr);
    RCC->csr |= RCC_CSR_RMVF;
    const bool is_told =
        reset_record.mark == MARK_FAULT || reset_record.mark == MARK_HANG;
    if (is_told && (cause & (RESET_CAUSE_HARD_FAULT | RESET_CAUSE_WATCHDOG)) != 0) {
        address = reset_record.pc;
    }
    reset_record.mark = 0;
    SCB->ccr |= SCB_CCR_DIV_0_TRP;
    SCB->shpr[15 - 4] = PRIORITY_TICK;
}

uint8_t board_reset_cause(void) {
    return cause;
}

uint32_t board_reset_address(void) {
    return address;
}

void reset_watch(void) {
    IWDG->kr = IWDG_START;  // before the rest, because it starts the oscillator
    IWDG->kr = IWDG_UNLOCK;
    IWDG->pr = PRESCALER_32;
    IWDG->rlr = RELOAD;
    ticks = 0;
    is_watched = true;
}

void board_watchdog_kick(void) {
    IWDG->kr = IWDG_RELOAD;
    ticks = 0;
}

_Noreturn void reset_now(void) {
    cpu_barrier();
    SCB->aircr = SCB_AIRCR_RESET;
    for (;;) {
    }
}

_Noreturn void board_reset(void) {
    reset_record.mark = MARK_ASKED;
    reset_now();
}

// `frame` is what the processor has pushed; it may lie outside the stack's memory, when
// the stack is what is wrong.
__attribute__((used)) static _Noreturn void die(const uint32_t *frame, enum mark mark) {
    const uintptr_t depth = (uintptr_t)frame - (uintptr_t)stack_bottom;
    const bool is_there = depth <= (uintptr_t)stack_size - FRAME_BYTES;
    reset_record = (struct reset_record){
        .mark = mark,
        .lr = is_there ? frame[5] : 0,
        .pc = is_there ? frame[6] : 0,
        .psr = is_there ? frame[7] : 0,
        .cfsr = SCB->cfsr,
        .hfsr = SCB->hfsr,
        .address = SCB->bfar,  // shared with mmfar
    };
    reset_now();
}

__attribute__((used)) static _Noreturn void die_of_fault(const uint32_t *frame) {
    die(frame, MARK_FAULT);
}

// On a separate stack, at the end of memory.
__attribute__((naked)) void reset_fault(void) {
    __asm__ volatile("mov r0, sp\n\t"
                     "ldr sp, =ram_end\n\t"
                     "b die_of_fault");
}

__attribute__((used)) static void tick(const uint32_t *frame) {
    idle_has_work = true;
    if (!is_watched) {
        return;
    }
    ticks++;
    if (ticks > TICKS_MAX) {
        die(frame, MARK_HANG);
    }
}

// The least urgent of all, so that what it interrupts is the main loop.
__attribute__((naked)) void reset_tick(void) {
    __asm__ volatile("mov r0, sp\n\t"
                     "b tick");
}
