// SPDX-License-Identifier: MIT
// The watchdog's modes, over three starts.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>

#include "probes_avr.h"

static volatile uint8_t timeouts;

ISR(WDT_vect) {
    timeouts++;
}

static void set_watchdog(uint8_t control) {
    wdt_reset();
    WDTCSR = (1 << WDCE) | (1 << WDE);
    WDTCSR = control;
}

static void delay_40_ms(void) {
    delay_ticks(2500);
}

void watchdog_modes(uint8_t causes) {
    TCCR1B = 1 << CS12;  // 16 us a tick
    if (causes == (1 << PORF)) {
        MCUSR = 0;
        set_watchdog(1 << WDIE);
        sei();
        delay_40_ms();
        cli();
        RESULT[0] = timeouts;
        delay_40_ms();
        WDTCSR = (1 << WDIE) | (1 << WDP2);  // without the timed sequence
        RESULT[1] = WDTCSR;
        sei();
        set_watchdog((1 << WDIE) | (1 << WDE));
        timeouts = 0;
        RESULT[8] = 1;  // the host measures the time to the reset
        while (timeouts == 0) {
        }
        RESULT[2] = WDTCSR;
        for (;;) {
        }
    }
    MCUSR = 0xFF;  // sets none
    if (causes == (1 << WDRF)) {
        RESULT[3] = WDTCSR;
        set_watchdog(0);
        RESULT[4] = WDTCSR;
        RESULT[8] = 2;  // the host pulls the reset pin now
        for (;;) {
        }
    }
    RESULT[5] = MCUSR;
    RESULT[6] = WDTCSR;
    MCUSR = 0;
    set_watchdog(0);
    RESULT[7] = WDTCSR;
    delay_40_ms();
}
