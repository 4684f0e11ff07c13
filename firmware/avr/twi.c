// SPDX-License-Identifier: MIT
// The two-wire bus without a transfer: its clock, and its lines where they are to be
// freed.
#include "twi.h"

#include <avr/io.h>
#include <stdbool.h>
#include <util/delay.h>

#include "../board.h"
#include "generic/bus_recovery.h"
#include "pins.h"

enum {
    // F_CPU / (16 + 2 * TWBR) = 400 kHz ("Bit Rate Generator Unit").
    BIT_RATE = 12,
};

void twi_init(void) {
    TWBR = BIT_RATE;
    TWSR = 0;  // prescaler 1
    TWCR = _BV(TWEN);
}

static bool lines_are_high(void) {
    const uint8_t lines = _BV(PIN_SDA) | _BV(PIN_SCL);
    return (PINC & lines) == lines;
}

enum bus_result twi_abort(void) {
    TWCR = 0;
    return lines_are_high() ? BUS_TIMEOUT : BUS_STUCK;
}

_Static_assert(PIN_SCL == PIN_SDA + 1 && (int)BUS_SCL == 2 * (int)BUS_SDA,
               "the lines are beside each other");

// A line is pulled low by being an output at 0, and let go by being an input, which all
// other pins of this port are.
uint8_t bus_lines(uint8_t pulled) {
    DDRC = (uint8_t)(pulled << PIN_SDA);
    _delay_us(BUS_HALF_CLOCK_US);
    return (PINC >> PIN_SDA) & BUS_BOTH;
}

// Takes 3 ms at most, 0.1 ms where nobody holds SCL.
enum bus_result board_bus_recover(void) {
    (void)twi_abort();
    const enum bus_result result = bus_recovery_run();
    twi_init();
    return result;
}
