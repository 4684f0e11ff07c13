// SPDX-License-Identifier: MIT
// From the data-ready edge to the bytes of a sample, all by interrupt: TIM3 captures
// the time and starts the bursts, the I2C handlers move their bytes, board_reading_take
// hands them over.
//
// The stamp is the device time of the handler less what TIM3 has counted since the
// edge. Both count microseconds, not in step: it is within 1 us of the edge, however
// late the handler runs.
#include "sampling.h"

#include "../board.h"
#include "clock.h"
#include "cpu.h"
#include "generic/slots.h"
#include "i2c.h"
#include "idle.h"
#include "pins.h"

enum {
    SLOTS = 8,            // 10 ms at 760 Hz that the main loop may be late
    BURST_US_MAX = 4500,  // six times what 21 bytes in three bursts take at 400 kHz
    // An edge whose reading could not begin at once waits this long for it. Then the
    // next reading may have overwritten its own: its time would be wrong.
    WAIT_US_MAX = 1000,
    // Interrupts in a row that bring nothing, 0.3 us each: a clock that is held while a
    // START waits for it.
    IDLE_EVENTS_MAX = 1000,
};

// Shared with the handlers, which never interrupt each other; slots.h protects them.
static struct slots slots;
static struct reading readings[SLOTS];
static struct bus_burst transfers[SENSOR_BURSTS_MAX];  // that make a reading
static uint8_t transfers_count;
static uint32_t begun_us;
static uint16_t idle_events;
static bool is_waiting;  // an edge at `edge_us` has no bursts yet
static uint32_t edge_us;
static bool is_stale;  // the reading's time is unknown: it is thrown away
static volatile uint32_t ready;

static struct reading *filling(void) {
    return &readings[slots.filled % SLOTS];
}

void sampling_init(void) {
    TIM3->psc = APB1_TIMER_MHZ - 1;
    TIM3->arr = UINT16_MAX;
    TIM3->egr = TIM_EGR_UG;
    // An edge counts once eight looks, 95 ns, have seen it.
    TIM3->ccmr2 = TIM_CCMR2_CC3_INPUT | TIM_CCMR2_IC3_FILTER(3);
    TIM3->ccer = TIM_CCER_CC3E;
    TIM3->cr1 = TIM_CR1_CEN;
}

static void fail(enum bus_result result) {
    slots.failure = result;
    idle_has_work = true;
}

// The sensor holds the line high until it is read: every edge is followed by a reading,
// be it late, or there would be no other.
static void begin_if_due(void) {
    if (!is_waiting || slots.is_running || slots_are_full(&slots, SLOTS)) {
        return;
    }
    is_waiting = false;
    slots.is_running = true;
    idle_events = 0;
    begun_us = clock_us();
    if (!is_stale && begun_us - edge_us > WAIT_US_MAX) {
        is_stale = true;
        slots_miss_one(&slots);
    }
    if (!is_stale) {
        slots_stamp(&slots, filling(), edge_us);
    }
    if (!i2c_read(transfers, transfers_count, filling()->bytes)) {
        fail(i2c_abort());
    }
}

void sampling_edge(void) {
    const uint32_t flags = TIM3->sr;
    const uint32_t count = TIM3->cnt;
    const uint32_t now_us = clock_us();
    const uint16_t since_us = (uint16_t)(count - TIM3->ccr3);  // clears CC3IF
    TIM3->sr = ~TIM_SR_CC3OF;
    ready++;
    if ((flags & TIM_SR_CC3OF) != 0) {  // a second edge came before this handler did
        ready++;
        slots_miss_one(&slots);
    }
    if (is_waiting) {
        slots_miss_one(&slots);
    }
    is_waiting = true;
    edge_us = now_us - since_us;
    begin_if_due();
}

void sampling_bus(void) {
    switch (i2c_step()) {
    case I2C_WAITS:
        idle_events++;
        if (idle_events == IDLE_EVENTS_MAX) {
            fail(i2c_abort());
        }
        return;
    case I2C_MOVED:
        idle_events = 0;
        return;
    default:
        break;
    }
    if (!slots.is_running || slots.failure != BUS_OK) {
        return;
    }
    if (i2c_result() != BUS_OK) {
        fail(i2c_result());
        return;
    }
    if (!is_stale) {
        slots.filled++;
        idle_has_work = true;
    }
    is_stale = false;
    slots.is_running = false;
    begin_if_due();
}

// True once no burst is on the bus. One that takes too long is ended. Interrupts are
// off.
static bool is_over(void) {
    if (slots.is_running && slots.failure == BUS_OK &&
        clock_us() - begun_us > BURST_US_MAX) {
        fail(i2c_abort());
    }
    return !slots.is_running || slots.failure != BUS_OK;
}

void board_sampling_start(const struct bus_burst *bursts, uint8_t count) {
    board_sampling_stop();
    // A stale reading has taken nothing of what was missed.
    slots_restart(&slots, slots.is_running && !is_stale ? filling()->missed : 0);
    for (uint8_t i = 0; i < count; i++) {
        transfers[i] = bursts[i];
    }
    transfers_count = count;
    i2c_init();
    irq_enable(IRQ_I2C1_EVENT, PRIORITY_SAMPLING);
    irq_enable(IRQ_I2C1_ERROR, PRIORITY_SAMPLING);
    const uint32_t primask = cpu_mask();
    // The age of a reading that already waits is unknown.
    is_waiting = (GPIOB->idr & BIT(PIN_DATA_READY)) != 0;
    is_stale = is_waiting;
    edge_us = clock_us();
    TIM3->sr = 0;  // its edge, and those of the past
    TIM3->dier = TIM_DIER_CC3IE;
    cpu_barrier();
    irq_enable(IRQ_TIM3, PRIORITY_SAMPLING);
    begin_if_due();
    cpu_unmask(primask);
}

// Lets bursts that run come to their end: a device cut off while it sends holds SDA.
void board_sampling_stop(void) {
    irq_disable(IRQ_TIM3);
    TIM3->dier = 0;
    bool is_quiet;
    do {
        const uint32_t primask = cpu_mask();
        if (is_waiting) {
            is_waiting = false;
            slots_miss_one(&slots);
        }
        is_quiet = is_over();
        cpu_unmask(primask);
    } while (!is_quiet);
    irq_disable(IRQ_I2C1_EVENT);
    irq_disable(IRQ_I2C1_ERROR);
}

enum reading_result board_reading_take(struct reading *out) {
    GPIOC->bsrr = BIT(PIN_BUSY) << 16;
    const bool is_taken = slots_take(&slots, readings, SLOTS, out);
    if (is_taken) {
        GPIOC->bsrr = BIT(PIN_BUSY);  // until the next look for a sample
    }
    enum reading_result result = is_taken ? READING_OK : READING_NONE;
    const uint32_t primask = cpu_mask();
    if (is_over() && !is_taken) {
        result = slots_failure(&slots);
    }
    begin_if_due();  // there is a slot again
    cpu_unmask(primask);
    return result;
}

uint32_t board_samples_ready(void) {
    return ready;
}
