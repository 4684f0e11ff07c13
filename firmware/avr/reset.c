// SPDX-License-Identifier: MIT
// Why the board started, and how to start it again: the watchdog does both.
#include "../board.h"

#include <avr/interrupt.h>
#include <avr/wdt.h>

#include "core/wire/messages.h"
#include "reset.h"
#include "start.h"

_Static_assert(RESET_CAUSE_POWER_ON == _BV(PORF) &&
                   RESET_CAUSE_EXTERNAL == _BV(EXTRF) &&
                   RESET_CAUSE_BROWN_OUT == _BV(BORF) &&
                   RESET_CAUSE_WATCHDOG == _BV(WDRF),
               "the protocol numbers the causes as MCUSR does");

// A number that memory is unlikely to hold by itself.
enum { ASKED_FOR = 0xB007 };

// Outlives a reset.
static uint16_t asked __attribute__((section(".noinit")));
static uint8_t cause;

void reset_init(void) {
    cause = start_reset_flags;
    if (asked == ASKED_FOR && (cause & RESET_CAUSE_WATCHDOG) != 0) {
        cause ^= RESET_CAUSE_WATCHDOG | RESET_CAUSE_SOFTWARE;
    }
    asked = 0;
    // Longer than any step of the main loop, shorter than a person's patience.
    wdt_enable(WDTO_500MS);
}

uint8_t board_reset_cause(void) {
    return cause;
}

// Its watchdog resets and leaves no trace.
uint32_t board_reset_address(void) {
    return 0;
}

void board_watchdog_kick(void) {
    wdt_reset();
}

_Noreturn void board_reset(void) {
    cli();
    asked = ASKED_FOR;
    // Off first: libsimavr keeps a running watchdog's time-out when it is shortened.
    wdt_disable();
    wdt_enable(WDTO_15MS);
    for (;;) {
    }
}

// An interrupt that nobody enabled: memory is not to be trusted; the watchdog restarts.
ISR(BADISR_vect) {
    for (;;) {
    }
}
