// SPDX-License-Identifier: MIT
// Why the board started, and how to restart it. The watchdog's action is set by
// start.S: it resets, or after ATmegaBOOT interrupts.
#include "../board.h"

#include <avr/interrupt.h>
#include <avr/wdt.h>

#include "core/wire/messages.h"
#include "pins.h"
#include "start.h"

_Static_assert(RESET_CAUSE_POWER_ON == _BV(PORF) &&
                   RESET_CAUSE_EXTERNAL == _BV(EXTRF) &&
                   RESET_CAUSE_BROWN_OUT == _BV(BORF) &&
                   RESET_CAUSE_WATCHDOG == _BV(WDRF),
               "the protocol numbers the causes as MCUSR does");
_Static_assert(RESET_CAUSE_SOFTWARE == START_SOFTWARE, "as the protocol numbers it");
_Static_assert(START_500_MS == WDTO_500MS, "as <avr/wdt.h> numbers it");

uint8_t board_reset_cause(void) {
    return start_reset_cause;
}

// Its watchdog leaves no trace.
uint32_t board_reset_address(void) {
    return 0;
}

void board_watchdog_kick(void) {
    wdt_reset();
}

// ATmegaBOOT takes the UART at normal speed for granted. It comes back with WDIE set.
_Noreturn void board_reset(void) {
    cli();
    start_asked = START_ASKED;
    if ((WDTCSR & _BV(WDIE)) != 0) {
        UCSR0A = 0;
        __asm__ volatile("jmp %0" ::"i"(BOOTLOADER_START));
    }
    WDTCSR = _BV(WDCE) | _BV(WDE);
    WDTCSR = _BV(WDE);  // 16 ms
    for (;;) {
    }
}
