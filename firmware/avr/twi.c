// SPDX-License-Identifier: MIT
// Set-up's transfers on the two-wire bus, by polling, and the lines of a bus to be
// freed.
#include "twi.h"

#include <avr/io.h>
#include <stdbool.h>
#include <util/delay.h>
#include <util/twi.h>

#include "../board.h"
#include "clock.h"
#include "generic/bus_recovery.h"
#include "pins.h"

enum {
    // F_CPU / (16 + 2 * TWBR) = 400 kHz ("Bit Rate Generator Unit").
    BIT_RATE = 12,
    // A whole transfer: 150 bytes, and twice what set-up's longest takes at a tenth of
    // the clock.
    TRANSFER_TICKS_MAX = 4000 * CLOCK_TICKS_PER_US,
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

// One step of a transfer: clears TWINT, which starts it, and waits for its status.
// TW_NO_INFO: the time that began at `begun` ran out.
static uint8_t step(uint8_t control, uint16_t begun) {
    TWCR = (uint8_t)(_BV(TWINT) | _BV(TWEN) | control);
    while ((TWCR & _BV(TWINT)) == 0) {
        if ((uint16_t)(clock_ticks() - begun) > TRANSFER_TICKS_MAX) {
            return TW_NO_INFO;
        }
    }
    return TW_STATUS;
}

static uint8_t send(uint8_t byte, uint16_t begun) {
    TWDR = byte;
    return step(0, begun);
}

static enum bus_result stop(uint16_t begun) {
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
    while ((TWCR & _BV(TWSTO)) != 0) {
        if ((uint16_t)(clock_ticks() - begun) > TRANSFER_TICKS_MAX) {
            return twi_abort();
        }
    }
    return BUS_OK;
}

// Ends a transfer that got `status`.
static enum bus_result fail(uint8_t status, uint16_t begun) {
    if (status == TW_MT_SLA_NACK || status == TW_MT_DATA_NACK ||
        status == TW_MR_SLA_NACK) {
        const enum bus_result stopped = stop(begun);
        return stopped == BUS_OK ? BUS_NACK : stopped;
    }
    const enum bus_result aborted = twi_abort();
    // Lost arbitration, or a START or STOP that is not ours: with one master somebody
    // else pulls at the wires.
    return status == TW_NO_INFO ? aborted : BUS_STUCK;
}

// START, the address for writing, the register.
static uint8_t point_at(uint8_t address, uint8_t reg, uint16_t begun) {
    uint8_t status = step(_BV(TWSTA), begun);
    if (status != TW_START) {
        return status;
    }
    status = send((uint8_t)(address << 1) | TW_WRITE, begun);
    return status == TW_MT_SLA_ACK ? send(reg, begun) : status;
}

static enum bus_result read_registers(void *port, uint8_t address, uint8_t reg,
                                      uint8_t *data, uint8_t length) {
    (void)port;
    const uint16_t begun = clock_ticks();
    uint8_t status = point_at(address, reg, begun);
    if (status != TW_MT_DATA_ACK) {
        return fail(status, begun);
    }
    status = step(_BV(TWSTA), begun);
    if (status != TW_REP_START) {
        return fail(status, begun);
    }
    status = send((uint8_t)(address << 1) | TW_READ, begun);
    if (status != TW_MR_SLA_ACK) {
        return fail(status, begun);
    }
    for (; length > 0; length--) {
        // The last byte gets no acknowledge, so that the device lets go of SDA.
        const bool is_last = length == 1;
        status = step(is_last ? 0 : _BV(TWEA), begun);
        if (status != (is_last ? TW_MR_DATA_NACK : TW_MR_DATA_ACK)) {
            return fail(status, begun);
        }
        *data++ = TWDR;
    }
    return stop(begun);
}

static enum bus_result write_registers(void *port, uint8_t address, uint8_t reg,
                                       const uint8_t *data, uint8_t length) {
    (void)port;
    const uint16_t begun = clock_ticks();
    uint8_t status = point_at(address, reg, begun);
    for (; status == TW_MT_DATA_ACK && length > 0; length--) {
        status = send(*data++, begun);
    }
    return status == TW_MT_DATA_ACK ? stop(begun) : fail(status, begun);
}

const struct bus_device board_bus = {read_registers, write_registers, 0};

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
