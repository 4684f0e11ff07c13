// SPDX-License-Identifier: MIT
// Init, then forever: sensor to probe, probe to wire. All that knows a chip is behind
// board.h; all that knows a probe is in core/.
#include <stddef.h>

#include "board.h"
#include "core/probe/probe.h"

enum {
    STEP_US = 5000,            // of the button, the periodic messages and the LED
    NO_DATA_READY_US = 50000,  // ten samples of the slowest sensor, 200 Hz
    RETRY_US = 200000,         // between two attempts to bring the sensor up
    BURSTS_FAILED_MAX = 5,     // in a row, before the sensor is set up again
};

// Where the sensor is on its way to samples.
enum acquisition_phase {
    PHASE_WAITING,  // before the next attempt
    PHASE_SETUP,
    PHASE_SAMPLING,
};

static struct probe probe;

static struct {
    enum acquisition_phase phase;
    uint32_t since_us;  // start of the wait, or the last sample
    uint8_t failed;     // bursts in a row
    bool has_gap;       // samples were lost before the next one
} acquisition;

static enum cause cause_of(enum bus_result result) {
    switch (result) {
    case BUS_NACK:
        return CAUSE_NACK;
    case BUS_STUCK:
        return CAUSE_STUCK_BUS;
    default:
        return CAUSE_TIMEOUT;
    }
}

// Why a transaction of set-up failed, which the driver does not pass on.
static enum bus_result setup_failure;

static enum bus_result noted(enum bus_result result) {
    if (result != BUS_OK) {
        setup_failure = result;
    }
    return result;
}

static enum bus_result read_noted(void *port, uint8_t address, uint8_t reg,
                                  uint8_t *data, uint8_t length) {
    const struct bus_device *bus = port;
    return noted(bus->read(bus->port, address, reg, data, length));
}

static enum bus_result write_noted(void *port, uint8_t address, uint8_t reg,
                                   const uint8_t *data, uint8_t length) {
    const struct bus_device *bus = port;
    return noted(bus->write(bus->port, address, reg, data, length));
}

// Stops sampling, says why, frees the bus, and starts over a moment later.
static void give_up(enum event event, enum cause cause, int32_t detail,
                    uint32_t now_us) {
    board_sampling_stop();
    if (board_bus_recover() != BUS_OK) {
        cause = CAUSE_STUCK_BUS;
    }
    probe_sensor_failed(&probe, event, cause, detail, true, now_us);
    acquisition.phase = PHASE_WAITING;
    acquisition.since_us = now_us;
    acquisition.has_gap = true;
}

static void start_sampling(void) {
    const struct sensor_driver *sensor = board_sensor();
    struct bus_burst bursts[SENSOR_BURSTS_MAX];
    const uint8_t count = sensor->bursts(sensor->state, bursts);
    board_sampling_start(bursts, count);
}

static void begin_setup(void) {
    const struct sensor_driver *sensor = board_sensor();
    sensor->begin(sensor->state);
    acquisition.phase = PHASE_SETUP;
    acquisition.failed = 0;
}

static void set_up(uint32_t now_us) {
    const struct sensor_driver *sensor = board_sensor();
    const struct bus_device bus = {read_noted, write_noted, (void *)board_bus()};
    switch (sensor->setup(sensor->state, &bus, now_us)) {
    case SENSOR_OK:
        start_sampling();
        probe_sensor_ready(&probe, sensor->identity(sensor->state), now_us);
        acquisition.phase = PHASE_SAMPLING;
        acquisition.since_us = now_us;
        break;
    case SENSOR_BUSY:
        break;
    case SENSOR_WRONG_CHIP:
        give_up(EVENT_SENSOR_FAULT, CAUSE_WRONG_CHIP,
                sensor->identity(sensor->state)->who_am_i[0], now_us);
        break;
    case SENSOR_STUCK:
        give_up(EVENT_SENSOR_FAULT, CAUSE_TIMEOUT, 0, now_us);
        break;
    default:
        give_up(EVENT_BUS_FAULT, cause_of(setup_failure), 0, now_us);
        break;
    }
}

// A burst failed: one sample is lost. Frees the bus and goes on, or sets the sensor up
// again when that does not help.
static void survive_burst(enum bus_result failure, uint32_t now_us) {
    ++acquisition.failed;
    acquisition.has_gap = true;
    if (acquisition.failed >= BURSTS_FAILED_MAX) {
        give_up(EVENT_BUS_FAULT, cause_of(failure), acquisition.failed, now_us);
        return;
    }
    board_sampling_stop();
    if (board_bus_recover() != BUS_OK) {
        give_up(EVENT_BUS_FAULT, CAUSE_STUCK_BUS, acquisition.failed, now_us);
        return;
    }
    probe_sensor_failed(&probe, EVENT_BUS_FAULT, cause_of(failure), acquisition.failed,
                        false, now_us);
    start_sampling();
}

// Fills in what a burst brought; false where that was none. Not inline, so that its
// bytes are off the stack while the sample is worked on.
__attribute__((noinline)) static bool take_sample(struct sample *sample,
                                                  uint32_t now_us) {
    const struct sensor_driver *sensor = board_sensor();
    struct board_sample taken;
    switch (board_sample_take(&taken)) {
    case BOARD_SAMPLE_OK:
        break;
    case BOARD_SAMPLE_FAILED:
        survive_burst(taken.failure, now_us);
        return false;
    default:
        if (now_us - acquisition.since_us >= NO_DATA_READY_US) {
            give_up(EVENT_SENSOR_FAULT, CAUSE_NO_DATA_READY, 0, now_us);
        }
        return false;
    }
    sample->has_gap = acquisition.has_gap;
    if (!sensor->parse(sensor->state, taken.bytes, taken.time_us, sample)) {
        survive_burst(BUS_STUCK, now_us);
        return false;
    }
    if (taken.missed > 0) {
        probe_overrun(&probe, taken.missed, now_us);
        sample->has_gap = true;
    }
    acquisition.has_gap = false;
    acquisition.failed = 0;
    acquisition.since_us = now_us;
    return true;
}

// Returns true where a sample was worked on.
static bool acquire(uint32_t now_us) {
    struct sample sample;
    switch (acquisition.phase) {
    case PHASE_WAITING:
        if (now_us - acquisition.since_us >= RETRY_US) {
            begin_setup();
        }
        return false;
    case PHASE_SETUP:
        set_up(now_us);
        return false;
    default:
        break;
    }
    if (!take_sample(&sample, now_us)) {
        return false;
    }
    probe_sample(&probe, &sample);
    return true;
}

// Not inline, as take_sample.
__attribute__((noinline)) static void begin(uint32_t now_us) {
    static struct outlet wire = {.put = board_send};
    static struct probe_port port = {
        .wire = &wire,
        .samples_ready = board_samples_ready,
        .stack_free = board_stack_free,
        .supply_mv = board_supply_mv,
        .entropy = board_entropy,
    };
    port.storage = board_storage();
    board_extras_begin(&port);
    uint8_t id[8];
    const bool has_id = board_unique_id(id);
    const struct probe_board board = {
        .kind = board_kind(),
        .reset_cause = board_reset_cause(),
        .reset_address = board_reset_address(),
        .firmware = FIRMWARE_BUILD,
        .unique_id = has_id ? id : NULL,
    };
    probe_begin(&probe, &port, &board, now_us);
    begin_setup();
}

int main(void) {
    board_init();
    uint32_t stepped_us = board_time_us();
    begin(stepped_us);
    for (;;) {
        board_watchdog_kick();
        const uint32_t now_us = board_time_us();
        const bool worked = acquire(now_us);
        for (int16_t byte = board_receive(); byte >= 0; byte = board_receive()) {
            // Not the time before a sample's work: a reply says when it was heard.
            probe_receive(&probe, (uint8_t)byte, board_time_us());
        }
        if (now_us - stepped_us >= STEP_US) {
            stepped_us = now_us;
            probe_step(&probe, board_button_is_down(), now_us);
            board_led_set(probe_led(&probe, now_us));
        }
        board_extras_step(&probe, now_us);
        if (worked) {
            probe_worked(&probe, (board_time_us() - now_us) * board_cycles_per_us());
        }
        if (probe.wants_reset && board_send_is_idle() && board_extras_are_done()) {
            board_reset();
        }
        if (acquisition.phase == PHASE_SETUP) {
            board_pause();  // it waits for no interrupt
        } else {
            board_idle();
        }
    }
}
