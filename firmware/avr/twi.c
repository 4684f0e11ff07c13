// SPDX-License-Identifier: MIT
// The two-wire bus without a transfer: its clock, and its lines where they are to be
// freed.
#include "twi.h"

#include <avr/io.h>
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

enum bus_result twi_abort(void) {
    TWCR = 0;
    return pins_bus_is_high() ? BUS_TIMEOUT : BUS_STUCK;
}

_Static_assert((int)BUS_SDA == 1 && (int)BUS_SCL == 2, "as pins.h takes them");

uint8_t bus_lines(uint8_t pulled) {
    pins_bus_pull(pulled);
    _delay_us(BUS_HALF_CLOCK_US);
    return pins_bus_look() & BUS_BOTH;
}

// Takes 3 ms at most, 0.1 ms where SCL is not held.
enum bus_result board_bus_recover(void) {
    (void)twi_abort();
    const enum bus_result result = bus_recovery_run();
    twi_init();
    return result;
}
