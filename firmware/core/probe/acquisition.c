// SPDX-License-Identifier: MIT
// Set-up, samples and recovery of the sensor; see acquisition.h.
#include "core/probe/acquisition.h"

enum {
    SILENCE_US = 50000,     // without data-ready: ten samples of the slowest sensor
    RETRY_US = 200000,      // between two attempts to bring the sensor up
    BURSTS_FAILED_MAX = 5,  // in a row, before the sensor is set up again
};

_Static_assert((int)CAUSE_TIMEOUT - CAUSE_NACK == (int)BUS_NACK - BUS_TIMEOUT &&
                   (int)CAUSE_STUCK_BUS - CAUSE_NACK == (int)BUS_NACK - BUS_STUCK,
               "the protocol numbers the causes as the bus does, the other way");

static enum cause cause_of(enum bus_result result) {
    return (enum cause)(CAUSE_NACK + BUS_NACK - result);
}

// Stops sampling, says why, frees the bus, and starts over a moment later.
static void give_up(struct acquisition *acquisition, enum event event, enum cause cause,
                    int32_t detail, uint32_t now_us) {
    acquisition->port->stop_sampling();
    if (acquisition->port->recover_bus() != BUS_OK) {
        cause = CAUSE_STUCK_BUS;
    }
    probe_sensor_failed(acquisition->probe, event, cause, detail, true, now_us);
    acquisition->phase = ACQUISITION_WAITING;
    acquisition->since_us = now_us;
    acquisition->has_gap = true;
}

static void start_sampling(const struct acquisition *acquisition) {
    const struct sensor_driver *sensor = acquisition->port->sensor;
    struct bus_burst bursts[SENSOR_BURSTS_MAX];
    const uint8_t count = sensor->bursts(sensor->state, bursts);
    acquisition->port->start_sampling(bursts, count);
}

static void begin_setup(struct acquisition *acquisition) {
    const struct sensor_driver *sensor = acquisition->port->sensor;
    sensor->begin(sensor->state);
    acquisition->phase = ACQUISITION_SETUP;
    acquisition->failed = 0;
}

void acquisition_begin(struct acquisition *acquisition,
                       const IN_FLASH struct acquisition_port *port,
                       struct probe *probe) {
    *acquisition = (struct acquisition){.port = port, .probe = probe};
    begin_setup(acquisition);
}

static void set_up(struct acquisition *acquisition, uint32_t now_us) {
    const struct sensor_driver *sensor = acquisition->port->sensor;
    const enum sensor_result result =
        sensor->setup(sensor->state, acquisition->port->bus, now_us);
    switch (result) {
    case SENSOR_OK:
        start_sampling(acquisition);
        probe_sensor_ready(acquisition->probe, sensor->identity(sensor->state), now_us);
        acquisition->phase = ACQUISITION_SAMPLING;
        acquisition->since_us = now_us;
        break;
    case SENSOR_BUSY:
        break;
    case SENSOR_WRONG_CHIP:
        give_up(acquisition, EVENT_SENSOR_FAULT, CAUSE_WRONG_CHIP,
                sensor->identity(sensor->state)->who_am_i[0], now_us);
        break;
    case SENSOR_STUCK:
        give_up(acquisition, EVENT_SENSOR_FAULT, CAUSE_TIMEOUT, 0, now_us);
        break;
    default:
        give_up(acquisition, EVENT_BUS_FAULT, cause_of((enum bus_result)result), 0,
                now_us);
        break;
    }
}

// A burst failed: one sample is lost. Frees the bus and goes on, or sets the sensor up
// again when that does not help.
static void survive_burst(struct acquisition *acquisition, enum bus_result failure,
                          uint32_t now_us) {
    const IN_FLASH struct acquisition_port *port = acquisition->port;
    ++acquisition->failed;
    acquisition->has_gap = true;
    enum cause cause = cause_of(failure);
    if (acquisition->failed < BURSTS_FAILED_MAX) {
        port->stop_sampling();
        if (port->recover_bus() == BUS_OK) {
            probe_sensor_failed(acquisition->probe, EVENT_BUS_FAULT, cause,
                                acquisition->failed, false, now_us);
            start_sampling(acquisition);
            return;
        }
        cause = CAUSE_STUCK_BUS;
    }
    give_up(acquisition, EVENT_BUS_FAULT, cause, acquisition->failed, now_us);
}

// Fills in what a burst brought; false where that was none. Not inline, so that its
// bytes are off the stack while the sample is worked on.
__attribute__((noinline)) static bool
take_sample(struct acquisition *acquisition, struct sample *sample, uint32_t now_us) {
    const struct sensor_driver *sensor = acquisition->port->sensor;
    struct reading reading;
    const enum reading_result result = acquisition->port->take_reading(&reading);
    if (result == READING_NONE) {
        if (now_us - acquisition->since_us >= SILENCE_US) {
            give_up(acquisition, EVENT_SENSOR_FAULT, CAUSE_NO_DATA_READY, 0, now_us);
        }
        return false;
    }
    if (result != READING_OK) {
        survive_burst(acquisition, (enum bus_result)result, now_us);
        return false;
    }
    sample->has_gap = acquisition->has_gap;
    if (!sensor->parse(sensor->state, reading.bytes, reading.time_us, sample)) {
        survive_burst(acquisition, BUS_STUCK, now_us);
        return false;
    }
    if (reading.missed > 0) {
        probe_overrun(acquisition->probe, reading.missed, now_us);
        sample->has_gap = true;
    }
    acquisition->has_gap = false;
    acquisition->failed = 0;
    acquisition->since_us = now_us;
    return true;
}

bool acquisition_step(struct acquisition *acquisition, uint32_t now_us) {
    struct sample sample;
    switch (acquisition->phase) {
    case ACQUISITION_WAITING:
        if (now_us - acquisition->since_us >= RETRY_US) {
            begin_setup(acquisition);
        }
        return false;
    case ACQUISITION_SETUP:
        set_up(acquisition, now_us);
        return false;
    default:
        break;
    }
    if (!take_sample(acquisition, &sample, now_us)) {
        return false;
    }
    probe_sample(acquisition->probe, &sample);
    return true;
}
