// SPDX-License-Identifier: MIT
// From the data-ready edge to the bytes of a sample, all by interrupt: the pin's stamps
// the time and starts the bursts, the I2C's moves their bytes, board_reading_take hands
// them over.
//
// The chip has no input capture: the stamp is the time of the handler. All code runs
// from RAM, so neither the flash's cache nor a write of the flash holds it up; what
// does are the handlers of the same priority, 3 us, and masked interrupts, 2 us.
#include "sampling.h"

#include "../board.h"
#include "generic/slots.h"
#include "hardware/gpio.h"
#include "hardware/irq.h"
#include "hardware/sync.h"
#include "hardware/timer.h"
#include "i2c.h"
#include "idle.h"
#include "pins.h"

enum {
    // 0.6 s at 200 Hz that the main loop may be late: the longest erasure of a sector
    // of flash takes 0.4 s.
    SLOTS = 128,
    BURST_US_MAX = 4500,
    // An edge whose reading could not begin at once waits this long for it. Then the
    // next reading may have overwritten its own: its time would be wrong.
    WAIT_US_MAX = 1000,
    FIFO_BYTES = 16,   // of the I2C, each way
    REFILL_BELOW = 5,  // commands that wait when more are asked for
    DRAIN_ABOVE = 8,   // bytes that have come when they are taken
};

#define INTERRUPTS                                                                     \
    (I2C_IC_INTR_MASK_M_TX_ABRT_BITS | I2C_IC_INTR_MASK_M_TX_EMPTY_BITS |              \
     I2C_IC_INTR_MASK_M_RX_FULL_BITS | I2C_IC_INTR_MASK_M_STOP_DET_BITS)

volatile bool idle_has_work;

// Shared with the handlers, which have one priority and never interrupt each other;
// slots.h protects them.
static struct slots slots;
static struct reading readings[SLOTS];
static struct bus_burst transfers[SENSOR_BURSTS_MAX];  // that make a reading
static uint8_t transfers_count;
static uint8_t current;     // of the transfers, that is on the bus
static uint8_t asked, got;  // of its bytes
static uint8_t *target;     // of its next byte
static uint32_t begun_us;
static bool is_waiting;  // an edge at `edge_us` has no bursts yet
static uint32_t edge_us;
static bool is_stale;  // the reading's time is unknown: it is thrown away
static volatile uint32_t ready;

static struct reading *filling(void) {
    return &readings[slots.filled % SLOTS];
}

static void fail(enum bus_result result) {
    SENSOR_BUS->hw->intr_mask = 0;
    slots.failure = result;
    idle_has_work = true;
}

// Asks for as many bytes as the FIFO for them has room for; with a STOP behind the
// last.
static void ask(void) {
    i2c_hw_t *const hw = SENSOR_BUS->hw;
    const uint8_t length = transfers[current].length;
    while (asked < length && asked - got < FIFO_BYTES &&
           (hw->status & I2C_IC_STATUS_TFNF_BITS) != 0) {
        uint32_t command = I2C_IC_DATA_CMD_CMD_BITS;
        if (asked == 0) {
            command |= I2C_IC_DATA_CMD_RESTART_BITS;
        }
        asked++;
        if (asked == length) {
            command |= I2C_IC_DATA_CMD_STOP_BITS;
            hw->intr_mask = INTERRUPTS & ~I2C_IC_INTR_MASK_M_TX_EMPTY_BITS;
        }
        hw->data_cmd = command;
    }
}

static void begin_transfer(void) {
    i2c_hw_t *const hw = SENSOR_BUS->hw;
    hw->enable = 0;  // "IC_TAR": it can be written only then
    hw->tar = transfers[current].address;
    hw->rx_tl = DRAIN_ABOVE - 1;
    hw->tx_tl = REFILL_BELOW - 1;
    hw->enable = 1;
    (void)hw->clr_intr;
    asked = 0;
    got = 0;
    hw->intr_mask = INTERRUPTS;
    hw->data_cmd = transfers[current].reg;
    ask();
}

// A sensor may hold the line high until it is read: every edge is followed by a
// reading, be it late, or there would be no other.
static void begin_if_due(void) {
    if (!is_waiting || slots.is_running || slots_are_full(&slots, SLOTS)) {
        return;
    }
    is_waiting = false;
    slots.is_running = true;
    begun_us = time_us_32();
    if (!is_stale && begun_us - edge_us > WAIT_US_MAX) {
        is_stale = true;
        slots_miss_one(&slots);
    }
    if (!is_stale) {
        slots_stamp(&slots, filling(), edge_us);
    }
    current = 0;
    target = filling()->bytes;
    begin_transfer();
}

static void end_reading(void) {
    SENSOR_BUS->hw->intr_mask = 0;
    if (!is_stale) {
        slots.filled++;
        idle_has_work = true;
    }
    is_stale = false;
    slots.is_running = false;
    begin_if_due();
}

static void on_bus(void) {
    i2c_hw_t *const hw = SENSOR_BUS->hw;
    const uint32_t state = hw->raw_intr_stat;
    if ((state & I2C_IC_RAW_INTR_STAT_TX_ABRT_BITS) != 0) {
        (void)hw->clr_tx_abrt;
        fail(BUS_NACK);
        return;
    }
    while (hw->rxflr != 0 && got < transfers[current].length) {
        *target++ = (uint8_t)hw->data_cmd;
        got++;
    }
    ask();
    if ((state & I2C_IC_RAW_INTR_STAT_STOP_DET_BITS) == 0) {
        return;
    }
    (void)hw->clr_stop_det;
    if (got < transfers[current].length) {
        fail(BUS_TIMEOUT);
        return;
    }
    current++;
    if (current < transfers_count) {
        begin_transfer();
    } else {
        end_reading();
    }
}

static void on_edge(void) {
    const uint32_t now_us = time_us_32();
    gpio_acknowledge_irq(PIN_DATA_READY, GPIO_IRQ_EDGE_RISE);
    ready++;
    if (is_waiting) {
        slots_miss_one(&slots);
    }
    is_waiting = true;
    edge_us = now_us;
    begin_if_due();
}

void sampling_init(void) {
    gpio_init(PIN_BUSY);
    gpio_set_dir(PIN_BUSY, GPIO_OUT);
    gpio_init(PIN_DATA_READY);
    gpio_pull_down(PIN_DATA_READY);  // a wire that is off brings no edges
    irq_set_exclusive_handler(SENSOR_BUS_IRQ, on_bus);
    irq_set_exclusive_handler(IO_IRQ_BANK0, on_edge);
    irq_set_priority(SENSOR_BUS_IRQ, PICO_HIGHEST_IRQ_PRIORITY);
    irq_set_priority(IO_IRQ_BANK0, PICO_HIGHEST_IRQ_PRIORITY);
    irq_set_enabled(IO_IRQ_BANK0, true);
}

// True once no burst is on the bus. One that takes too long is ended. Interrupts are
// off.
static bool is_over(void) {
    if (slots.is_running && slots.failure == BUS_OK &&
        time_us_32() - begun_us > BURST_US_MAX) {
        fail(BUS_TIMEOUT);
    }
    return !slots.is_running || slots.failure != BUS_OK;
}

void board_sampling_start(const struct bus_burst *bursts, uint8_t count) {
    board_sampling_stop();
    // A stale reading has none of the missed samples.
    slots_restart(&slots, slots.is_running && !is_stale ? filling()->missed : 0);
    for (uint8_t i = 0; i < count; i++) {
        transfers[i] = bursts[i];
    }
    transfers_count = count;
    const uint32_t mask = save_and_disable_interrupts();
    // The age of a reading that already waits is unknown.
    is_waiting = gpio_get(PIN_DATA_READY);
    is_stale = is_waiting;
    edge_us = time_us_32();
    gpio_acknowledge_irq(PIN_DATA_READY, GPIO_IRQ_EDGE_RISE);  // and those of the past
    gpio_set_irq_enabled(PIN_DATA_READY, GPIO_IRQ_EDGE_RISE, true);
    irq_set_enabled(SENSOR_BUS_IRQ, true);
    begin_if_due();
    restore_interrupts(mask);
}

// Lets bursts that run come to their end: a device cut off while it sends holds SDA.
void board_sampling_stop(void) {
    gpio_set_irq_enabled(PIN_DATA_READY, GPIO_IRQ_EDGE_RISE, false);
    bool is_quiet;
    do {
        const uint32_t mask = save_and_disable_interrupts();
        if (is_waiting) {
            is_waiting = false;
            slots_miss_one(&slots);
        }
        is_quiet = is_over();
        restore_interrupts(mask);
    } while (!is_quiet);
    irq_set_enabled(SENSOR_BUS_IRQ, false);
    SENSOR_BUS->hw->intr_mask = 0;
}

enum reading_result board_reading_take(struct reading *out) {
    gpio_put(PIN_BUSY, false);
    const bool is_taken = slots_take(&slots, readings, SLOTS, out);
    gpio_put(PIN_BUSY, is_taken);  // until the next look for a sample
    enum reading_result result = is_taken ? READING_OK : READING_NONE;
    const uint32_t mask = save_and_disable_interrupts();
    if (is_over() && !is_taken) {
        result = slots_failure(&slots);
    }
    begin_if_due();  // there is a slot again
    restore_interrupts(mask);
    return result;
}

uint32_t board_samples_ready(void) {
    return ready;
}
