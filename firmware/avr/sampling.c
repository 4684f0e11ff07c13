// SPDX-License-Identifier: MIT
// From the data-ready edge to the bytes of a sample, all by interrupt: INT0 stamps the
// time and starts the burst, the TWI handler moves its bytes, board_reading_take hands
// them over. Two slots, so that one fills while the main loop is late with the other.
// The transfers of set-up go through the same handler.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>
#include <util/twi.h>

#include "../board.h"
#include "clock.h"
#include "generic/slots.h"
#include "idle.h"
#include "twi.h"

enum {
    // Seven times what 24 bytes take at 400 kHz.
    TRANSFER_TICKS_MAX = 4500 * CLOCK_TICKS_PER_US,
};

enum { READING_SLOTS = 2 };

// TWCR for each kind of step; all clear TWINT, which starts it.
enum {
    GO = _BV(TWINT) | _BV(TWEN) | _BV(TWIE),
    GO_START = GO | _BV(TWSTA),
    GO_ACKNOWLEDGE = GO | _BV(TWEA),
    GO_STOP = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO),
};

// Shared with the handlers, which slots.h protects.
static struct slots slots;
static struct reading readings[READING_SLOTS];
static struct bus_burst burst;
static bool is_write;      // of set-up: the bytes go to the device
static uint8_t *cursor;    // where the next byte goes, or comes from
static uint8_t remaining;  // bytes of the transfer still to come
static uint16_t begun;     // ticks
static uint32_t ready;

_Static_assert(READING_SLOTS == 2, "one bit tells them apart");

static inline struct reading *filling(void) {
    return (slots.filled & 1) != 0 ? &readings[1] : &readings[0];
}

static inline void begin(uint8_t *bytes, uint16_t ticks) {
    cursor = bytes;
    remaining = burst.length;
    begun = ticks;
    slots.is_running = true;
    // The STOP of the burst before may still be on its way; the START then follows it.
    TWCR = (uint8_t)(GO_START | (TWCR & _BV(TWSTO)));
}

ISR(INT0_vect) {
    const uint16_t ticks = TCNT1;
    const uint32_t now_us = clock_us_masked(ticks);
    ready++;
    if (slots.is_running || slots_are_full(&slots, READING_SLOTS)) {
        slots_miss_one(&slots);
        return;
    }
    struct reading *const slot = filling();
    slots_stamp(&slots, slot, now_us);
    begin(slot->bytes, ticks);
}

// What follows a status, but for the bytes that are read. Inline without choice: a call
// would have the handler save all registers first.
__attribute__((always_inline)) static inline void go_on(uint8_t status) {
    switch (status) {
    case TW_START:
        TWDR = (uint8_t)(burst.address << 1) | TW_WRITE;
        TWCR = GO;
        return;
    case TW_MT_SLA_ACK:
        TWDR = burst.reg;
        TWCR = GO;
        return;
    case TW_MT_DATA_ACK:
        if (!is_write) {
            TWCR = GO_START;
            return;
        }
        if (remaining != 0) {
            remaining--;
            TWDR = *cursor++;
            TWCR = GO;
            return;
        }
        TWCR = GO_STOP;
        break;
    case TW_REP_START:
        TWDR = (uint8_t)(burst.address << 1) | TW_READ;
        TWCR = GO;
        return;
    case TW_MR_SLA_ACK:
        TWCR = remaining == 1 ? GO : GO_ACKNOWLEDGE;
        return;
    case TW_MT_SLA_NACK:
    case TW_MT_DATA_NACK:
    case TW_MR_SLA_NACK:
        TWCR = GO_STOP;
        slots.failure = BUS_NACK;
        break;
    case TW_MR_DATA_NACK:
        if (remaining == 1) {
            *cursor = TWDR;
            TWCR = GO_STOP;
            break;
        }
        // fall through
    default:
        // Lost arbitration, or a START or STOP that is not ours: with one master
        // somebody else pulls at the wires.
        TWCR = 0;
        slots.failure = BUS_STUCK;
        break;
    }
    if (slots.failure == BUS_OK) {
        slots.filled++;
        slots.is_running = false;
    }
    idle_has_work = true;
}

// TWSR is the status, because its prescaler bits are 0. ("Transmission Modes".)
ISR(TWI_vect) {
    const uint8_t status = TWSR;
    if (status == TW_MR_DATA_ACK) {  // first, because it is by far the most frequent
        *cursor++ = TWDR;
        // The last byte gets no acknowledge, so that the device lets go of SDA.
        TWCR = --remaining == 1 ? GO : GO_ACKNOWLEDGE;
        return;
    }
    go_on(status);
}

// True once no transfer is on the bus. One that takes too long is ended. Interrupts are
// off.
static bool is_over(void) {
    if (!slots.is_running || slots.failure != BUS_OK) {
        return true;
    }
    if ((uint16_t)(TCNT1 - begun) > TRANSFER_TICKS_MAX) {
        slots.failure = twi_abort();
        return true;
    }
    return false;
}

// Lets a transfer come to its end.
static void settle(void) {
    bool is_quiet;
    do {
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
            is_quiet = is_over();
        }
    } while (!is_quiet);
    // Its STOP takes 3 us and would be cut short by the next transfer.
    for (uint8_t turn = 0; turn < UINT8_MAX && (TWCR & _BV(TWSTO)) != 0; turn++) {
    }
}

static enum bus_result transfer(uint8_t address, uint8_t reg, uint8_t *data,
                                uint8_t length) {
    burst = (struct bus_burst){address, reg, length};
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        begin(data, TCNT1);
    }
    settle();
    const enum bus_result result = slots.failure;
    slots.failure = BUS_OK;
    slots.is_running = false;
    slots.taken = slots.filled;  // it is no reading
    return result;
}

static enum bus_result read_registers(void *port, uint8_t address, uint8_t reg,
                                      uint8_t *data, uint8_t length) {
    (void)port;
    return transfer(address, reg, data, length);
}

static enum bus_result write_registers(void *port, uint8_t address, uint8_t reg,
                                       const uint8_t *data, uint8_t length) {
    (void)port;
    is_write = true;
    const enum bus_result result = transfer(address, reg, (uint8_t *)data, length);
    is_write = false;
    return result;
}

const IN_FLASH struct bus_device board_bus = {read_registers, write_registers, 0};

// This board's sensor has one burst a sample.
void board_sampling_start(const struct bus_burst *bursts, uint8_t count) {
    (void)count;
    board_sampling_stop();
    burst = bursts[0];
    twi_init();
    EICRA = _BV(ISC01) | _BV(ISC00);  // INT0 at the rising edge
    EIFR = _BV(INTF0);                // none of the past
    EIMSK = _BV(INT0);
}

// Lets a burst that runs come to its end: a device cut off while it sends holds SDA.
void board_sampling_stop(void) {
    EIMSK = 0;
    settle();
    slots_restart(&slots, slots.is_running ? filling()->missed : 0);
}

enum reading_result board_reading_take(struct reading *out) {
    if (slots_take(&slots, readings, READING_SLOTS, out)) {
        GPIOR0 = 1;  // until board_idle
        return READING_OK;
    }
    enum reading_result result = READING_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (is_over()) {
            result = slots_failure(&slots);
        }
    }
    return result;
}

uint32_t board_samples_ready(void) {
    uint32_t edges;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        edges = ready;
    }
    return edges;
}
