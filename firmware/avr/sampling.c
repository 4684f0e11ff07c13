// SPDX-License-Identifier: MIT
// From the data-ready edge to the bytes of a sample, all by interrupt (handlers.S);
// board_reading_take hands them over. Two slots, so that one fills while the main loop
// is late with the other. The transfers of set-up go through the same handler.
#include <avr/io.h>
#include <stddef.h>
#include <util/atomic.h>

#include "../board.h"
#include "clock.h"
#include "handlers.h"
#include "pins.h"
#include "twi.h"

enum {
    // Seven times what 24 bytes take at 400 kHz.
    TRANSFER_TICKS_MAX = 4500 * CLOCK_TICKS_PER_US,
};

#define IS_AT(member, place) (offsetof(struct sampling, member) == (place))
_Static_assert(IS_AT(slots.filled, SAMPLING_FILLED) &&
                   IS_AT(slots.taken, SAMPLING_TAKEN) &&
                   IS_AT(slots.is_running, SAMPLING_IS_RUNNING) &&
                   IS_AT(slots.failure, SAMPLING_FAILURE) &&
                   IS_AT(slots.missed, SAMPLING_MISSED) &&
                   IS_AT(is_write, SAMPLING_IS_WRITE) &&
                   IS_AT(remaining, SAMPLING_REMAINING) &&
                   IS_AT(cursor, SAMPLING_CURSOR) && IS_AT(begun, SAMPLING_BEGUN) &&
                   IS_AT(burst.address, SAMPLING_ADDRESS) &&
                   IS_AT(burst.reg, SAMPLING_REG) &&
                   IS_AT(burst.length, SAMPLING_LENGTH) && IS_AT(ready, SAMPLING_READY),
               "as handlers.h tells the handlers");
#ifdef SAMPLING_TWO_BURSTS
_Static_assert(IS_AT(second.address, SAMPLING_SECOND_ADDRESS) &&
                   IS_AT(second.reg, SAMPLING_SECOND_REG) &&
                   IS_AT(second.length, SAMPLING_SECOND_LENGTH) &&
                   IS_AT(is_second, SAMPLING_IS_SECOND),
               "as handlers.h tells the handlers");
#endif
_Static_assert(sizeof(struct reading) == READING_SIZE &&
                   offsetof(struct reading, bytes) == 0 &&
                   offsetof(struct reading, time_us) == READING_TIME &&
                   offsetof(struct reading, missed) == READING_TIME + 4,
               "as handlers.S fills it");
_Static_assert((uint8_t)BUS_NACK == FAILURE_NACK && (uint8_t)BUS_STUCK == FAILURE_STUCK,
               "as handlers.h has them");
_Static_assert(READING_SLOTS == 2, "one bit tells them apart");

// Shared with the handlers, which slots.h protects.
struct sampling sampling;
struct reading sampling_readings[READING_SLOTS];

static inline struct reading *filling(void) {
    return (sampling.slots.filled & 1) != 0 ? &sampling_readings[1]
                                            : &sampling_readings[0];
}

// True once no transfer is on the bus. One that takes too long is ended. Interrupts are
// off.
static bool is_over(void) {
    if (!sampling.slots.is_running || sampling.slots.failure != BUS_OK) {
        return true;
    }
    if ((uint16_t)(TCNT1 - sampling.begun) > TRANSFER_TICKS_MAX) {
        sampling.slots.failure = twi_abort();
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
    sampling.burst = (struct bus_burst){address, reg, length};
#ifdef SAMPLING_TWO_BURSTS
    sampling.second.length = 0;
#endif
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        sampling_begin(data);
    }
    settle();
    const enum bus_result result = sampling.slots.failure;
    sampling.slots.failure = BUS_OK;
    sampling.slots.is_running = false;
    sampling.slots.taken = sampling.slots.filled;  // it is no reading
    return result;
}

enum bus_result sampling_read(void *port, uint8_t address, uint8_t reg, uint8_t *data,
                              uint8_t length) {
    (void)port;
    return transfer(address, reg, data, length);
}

enum bus_result sampling_write(void *port, uint8_t address, uint8_t reg,
                               const uint8_t *data, uint8_t length) {
    (void)port;
    sampling.is_write = true;
    const enum bus_result result = transfer(address, reg, (uint8_t *)data, length);
    sampling.is_write = false;
    return result;
}

const IN_FLASH struct bus_device board_bus = {sampling_read, sampling_write, 0};

// This board's sensor has one burst a sample, or with SAMPLING_TWO_BURSTS two.
void board_sampling_start(const struct bus_burst *bursts, uint8_t count) {
    (void)count;
    board_sampling_stop();
    sampling.burst = bursts[0];
#ifdef SAMPLING_TWO_BURSTS
    sampling.second = bursts[1];
#endif
    twi_init();
    pins_data_ready_listen();
}

// Lets a burst that runs come to its end: a device cut off while it sends holds SDA.
void board_sampling_stop(void) {
    EIMSK = 0;
    settle();
    slots_restart(&sampling.slots, sampling.slots.is_running ? filling()->missed : 0);
}

// GPIOR0 is 1 from the taking of a sample until the next look for one: an emulator or a
// logic analyser's pin can measure the work between.
enum reading_result board_reading_take(struct reading *out) {
    GPIOR0 = 0;
    if (slots_take(&sampling.slots, sampling_readings, READING_SLOTS, out)) {
        GPIOR0 = 1;
        return READING_OK;
    }
    enum reading_result result = READING_NONE;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (is_over()) {
            result = slots_failure(&sampling.slots);
        }
    }
    return result;
}

uint32_t board_samples_ready(void) {
    uint32_t edges;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        edges = sampling.ready;
    }
    return edges;
}
