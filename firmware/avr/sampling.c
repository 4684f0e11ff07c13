// SPDX-License-Identifier: MIT
// From the data-ready edge to the bytes of a sample, all by interrupt: INT0 stamps the
// time and starts the burst, the TWI handler moves its bytes, board_sample_take hands
// them over. Two slots, so that one fills while the main loop is late with the other.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>
#include <util/twi.h>

#include "../board.h"
#include "clock.h"
#include "idle.h"
#include "twi.h"

enum {
    SLOTS = 2,
    BURST_US_MAX = 4500,  // seven times what 24 bytes take at 400 kHz
};

// TWCR for each kind of step; all clear TWINT, which starts it.
enum {
    GO = _BV(TWINT) | _BV(TWEN) | _BV(TWIE),
    GO_START = GO | _BV(TWSTA),
    GO_ACKNOWLEDGE = GO | _BV(TWEA),
    GO_STOP = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO),
};

// Shared with the handlers. The main loop reads the slots from `taken` to `filled`,
// both single bytes that one side writes; all else it touches with interrupts off.
static struct board_sample slots[SLOTS];
static volatile uint8_t filled;  // slots completed, by the handlers
static volatile uint8_t taken;   // slots handed over, by the main loop
static struct bus_burst burst;
static uint8_t *cursor;    // where the next byte goes
static uint8_t remaining;  // bytes of the burst still to come
// A burst is on the bus, into slots[filled % SLOTS]; after a failure it stays so until
// sampling is started again, which keeps others away.
static bool is_running;
static enum bus_result failure;  // of that burst
static bool is_reported;
static uint16_t missed;  // edges without a burst since the last that had one
static uint32_t ready;

static void miss(uint16_t edges) {
    const uint16_t sum = (uint16_t)(missed + edges);
    missed = sum < edges ? UINT16_MAX : sum;
}

ISR(INT0_vect) {
    const uint32_t now_us = clock_us_masked();
    ready++;
    if (is_running || (uint8_t)(filled - taken) == SLOTS) {
        if (missed != UINT16_MAX) {
            missed++;
        }
        return;
    }
    struct board_sample *slot = &slots[filled % SLOTS];
    slot->time_us = now_us;
    slot->missed = missed;
    missed = 0;
    cursor = slot->bytes;
    remaining = burst.length;
    is_running = true;
    // The STOP of the burst before may still be on its way; the START then follows it.
    TWCR = (uint8_t)(GO_START | (TWCR & _BV(TWSTO)));
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
        TWCR = GO_START;
        return;
    case TW_REP_START:
        TWDR = (uint8_t)(burst.address << 1) | TW_READ;
        TWCR = GO;
        return;
    case TW_MR_SLA_ACK:
        TWCR = remaining == 1 ? GO : GO_ACKNOWLEDGE;
        return;
    case TW_MR_DATA_NACK:
        if (remaining != 1) {
            break;
        }
        *cursor = TWDR;
        TWCR = GO_STOP;
        filled++;
        is_running = false;
        idle_has_work = true;
        return;
    case TW_MT_SLA_NACK:
    case TW_MT_DATA_NACK:
    case TW_MR_SLA_NACK:
        TWCR = GO_STOP;
        failure = BUS_NACK;
        idle_has_work = true;
        return;
    default:
        break;
    }
    // Lost arbitration, or a START or STOP that is not ours: with one master somebody
    // else pulls at the wires.
    TWCR = 0;
    failure = BUS_STUCK;
    idle_has_work = true;
}

// True once no burst is on the bus. One that takes too long is ended. Interrupts are
// off.
static bool is_over(void) {
    if (is_running && failure == BUS_OK &&
        clock_us_masked() - slots[filled % SLOTS].time_us > BURST_US_MAX) {
        failure = twi_abort();
    }
    return !is_running || failure != BUS_OK;
}

// This board's sensor has one burst a sample.
void board_sampling_start(const struct bus_burst *bursts, uint8_t count) {
    (void)count;
    board_sampling_stop();
    if (is_running) {  // failed: the edges missed before it go with the next burst
        miss(slots[filled % SLOTS].missed);
    }
    miss((uint8_t)(filled - taken));  // read, but nobody will take them
    taken = filled;
    burst = bursts[0];
    failure = BUS_OK;
    is_running = false;
    is_reported = false;
    twi_init();
    EICRA = _BV(ISC01) | _BV(ISC00);  // INT0 at the rising edge
    EIFR = _BV(INTF0);                // none of the past
    EIMSK = _BV(INT0);
}

// Lets a burst that runs come to its end: a device cut off while it sends holds SDA.
void board_sampling_stop(void) {
    EIMSK = 0;
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

enum board_sample_result board_sample_take(struct board_sample *out) {
    if (filled != taken) {
        GPIOR0 = 1;  // until board_idle
        *out = slots[taken % SLOTS];
        taken++;
        return BOARD_SAMPLE_OK;
    }
    enum board_sample_result result = BOARD_SAMPLE_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (is_over() && failure != BUS_OK && !is_reported && filled == taken) {
            is_reported = true;
            out->failure = failure;
            result = BOARD_SAMPLE_FAILED;
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
