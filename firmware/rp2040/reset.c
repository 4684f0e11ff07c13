// SPDX-License-Identifier: MIT
// Two watchdogs. The first is SysTick, which can say where the program hangs; the
// second is the hardware's, for when not even interrupts come. What is to be known
// after a reset is in the watchdog's scratch registers, which only a loss of power
// clears.
#include "reset.h"

#include "../board.h"
#include "hardware/exception.h"
#include "hardware/structs/systick.h"
#include "hardware/structs/vreg_and_chip_reset.h"
#include "hardware/structs/watchdog.h"
#include "hardware/watchdog.h"
#include "idle.h"

enum {
    TICK_US = 1000,
    TICKS_MAX = 200,  // 0.2 s without a kick: longer than any step of the main loop
    WATCHDOG_MS = 500,
    // SysTick's control: count, interrupt, from the processor's clock.
    SYSTICK_ON = 7,
    // The bootrom uses the scratch registers from 4 on.
    SCRATCH_MARK = 0,
    SCRATCH_ADDRESS = 1,
    FRAME_PC = 6,  // of the words that the processor has pushed
};

// Numbers that a register is unlikely to hold by itself.
enum mark { MARK_FAULT = 0x0FA17BAD, MARK_HANG = 0x4A46BAD1, MARK_ASKED = 0x0B007ED1 };

extern uint32_t __StackBottom, __StackTop;  // of the linker script

static uint8_t cause;
static uint32_t address;
static volatile uint8_t ticks;  // since the last kick
static volatile bool is_watched;

static uint8_t cause_of(uint32_t mark) {
    if (watchdog_hw->reason != 0) {
        switch (mark) {
        case MARK_FAULT:
            return RESET_CAUSE_HARD_FAULT;
        case MARK_ASKED:
            return RESET_CAUSE_SOFTWARE;
        default:
            return RESET_CAUSE_WATCHDOG;
        }
    }
    const uint32_t chip = vreg_and_chip_reset_hw->chip_reset;
    if ((chip & VREG_AND_CHIP_RESET_CHIP_RESET_HAD_POR_BITS) != 0) {
        return RESET_CAUSE_POWER_ON;  // or a brown-out, which the chip does not tell
    }
    if ((chip & VREG_AND_CHIP_RESET_CHIP_RESET_HAD_RUN_BITS) != 0) {
        return RESET_CAUSE_EXTERNAL;
    }
    return 0;
}

void reset_init(void) {
    const uint32_t mark = watchdog_hw->scratch[SCRATCH_MARK];
    cause = cause_of(mark);
    const bool is_told = mark == MARK_FAULT || mark == MARK_HANG;
    if (is_told && watchdog_hw->reason != 0) {
        address = watchdog_hw->scratch[SCRATCH_ADDRESS];
    }
    watchdog_hw->scratch[SCRATCH_MARK] = 0;
}

uint8_t board_reset_cause(void) {
    return cause;
}

uint32_t board_reset_address(void) {
    return address;
}

void reset_watch(void) {
    systick_hw->rvr = TICK_US * SYS_CLK_MHZ - 1;
    systick_hw->cvr = 0;
    systick_hw->csr = SYSTICK_ON;
    (void)exception_set_priority(SYSTICK_EXCEPTION, PICO_LOWEST_EXCEPTION_PRIORITY);
    watchdog_enable(WATCHDOG_MS, true);
    ticks = 0;
    is_watched = true;
}

void board_watchdog_kick(void) {
    watchdog_update();
    ticks = 0;
}

static _Noreturn void reset_now(enum mark mark) {
    watchdog_hw->scratch[SCRATCH_MARK] = mark;
    watchdog_reboot(0, 0, 1);
    for (;;) {
    }
}

_Noreturn void board_reset(void) {
    reset_now(MARK_ASKED);
}

// `frame` may lie outside the stack, if the stack is the cause.
__attribute__((used)) static _Noreturn void die(const uint32_t *frame, enum mark mark) {
    const bool is_there = frame >= &__StackBottom && frame + FRAME_PC < &__StackTop;
    watchdog_hw->scratch[SCRATCH_ADDRESS] = is_there ? frame[FRAME_PC] : 0;
    reset_now(mark);
}

__attribute__((used)) static _Noreturn void die_of_fault(const uint32_t *frame) {
    die(frame, MARK_FAULT);
}

// Names of the SDK. On the stack's other end: it may be the cause.
__attribute__((naked)) void isr_hardfault(void) {
    __asm__ volatile("mov r0, sp\n\t"
                     "ldr r1, =__StackTop\n\t"
                     "mov sp, r1\n\t"
                     "bl die_of_fault\n\t");
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

// The least urgent of all, so it interrupts the main loop alone.
__attribute__((naked)) void isr_systick(void) {
    __asm__ volatile("mov r0, sp\n\t"
                     "push {r0, lr}\n\t"
                     "bl tick\n\t"
                     "pop {r0, pc}\n\t");
}
