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

static uint8_t mask_of(enum bus_line line) {
    return line == BUS_SDA ? _BV(PIN_SDA) : _BV(PIN_SCL);
}

enum bus_result twi_abort(void) {
    TWCR = 0;
    return lines_are_high() ? BUS_TIMEOUT : BUS_STUCK;
}

// A line is pulled low by being an output at 0, and let go by being an input.
void bus_line_pull_low(enum bus_line line) {
    DDRC |= mask_of(line);
    _delay_us(BUS_HALF_CLOCK_US);
}

void bus_line_let_go(enum bus_line line) {
    DDRC &= (uint8_t)~mask_of(line);
    _delay_us(BUS_HALF_CLOCK_US);
}

bool bus_line_is_high(enum bus_line line) {
    return (PINC & mask_of(line)) != 0;
}

// Takes 3 ms at most, 0.1 ms where nobody holds SCL.
enum bus_result board_bus_recover(void) {
    (void)twi_abort();
    const enum bus_result result = bus_recovery_run();
    twi_init();
    return result;
}
