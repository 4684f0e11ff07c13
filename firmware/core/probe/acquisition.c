// SPDX-License-Identifier: MIT
// Set-up, samples and recovery of the sensor; see acquisition.h.
#include "core/probe/acquisition.h"

#include <stddef.h>

#include "core/drivers/ports_of.h"

enum {
    SILENCE_US = 50000,     // without data-ready: ten samples of the slowest sensor
    RETRY_US = 200000,      // between two attempts to bring the sensor up
    BURSTS_FAILED_MAX = 5,  // in a row, before the sensor is set up again
    // Samples between two looks after the sensor; and how soon after an edge a look
    // begins, because it must be done at the next, which at 760 Hz comes after 1.3 ms.
    // It waits for such a sample up to 55 more.
    CHECK_SAMPLES = 200,
    CHECK_WITHIN_US = 1000,
    SILENCES_MAX = 2,  // set-ups without an edge, before the sensor is asked
};

// One and a half periods of a sensor, times its rate in Hz.
#define GAP_PERIODS_US UINT32_C(1500000)
// One and a quarter.
#define LISTENING_PERIODS_US UINT32_C(1250000)

// How a step ended: as enum reading_result has it, or enum sensor_result.
enum outcome {
    OUTCOME_OK = READING_OK,
    OUTCOME_NOTHING = READING_NONE,
    OUTCOME_NACK = READING_NACK,
    OUTCOME_TIMEOUT = READING_TIMEOUT,
    OUTCOME_BUS_STUCK = READING_STUCK,  // the last one that is the bus' fault
    OUTCOME_WRONG_CHIP = SENSOR_WRONG_CHIP,
    OUTCOME_STUCK = SENSOR_STUCK,
    OUTCOME_UNSET = SENSOR_UNSET,
    OUTCOME_NO_FORCE = SENSOR_NO_FORCE,
    OUTCOME_MAG_CHANGED = SENSOR_MAG_CHANGED,
    OUTCOME_MAG_STUCK = SENSOR_MAG_STUCK,
    OUTCOME_SILENT = OUTCOME_MAG_STUCK - 1,
};

_Static_assert((int)OUTCOME_OK == SENSOR_OK && (int)OUTCOME_NOTHING == SENSOR_BUSY &&
                   (int)OUTCOME_NACK == SENSOR_BUS_NACK &&
                   (int)OUTCOME_TIMEOUT == SENSOR_BUS_TIMEOUT &&
                   (int)OUTCOME_BUS_STUCK == SENSOR_BUS_STUCK,
               "what readings and set-up share has the same numbers");

static const IN_FLASH uint8_t causes[] = {
    [-OUTCOME_NACK] = CAUSE_NACK,           [-OUTCOME_TIMEOUT] = CAUSE_TIMEOUT,
    [-OUTCOME_BUS_STUCK] = CAUSE_STUCK_BUS, [-OUTCOME_WRONG_CHIP] = CAUSE_WRONG_CHIP,
    [-OUTCOME_STUCK] = CAUSE_TIMEOUT,       [-OUTCOME_UNSET] = CAUSE_REGISTERS,
    [-OUTCOME_NO_FORCE] = CAUSE_FORCE,      [-OUTCOME_MAG_CHANGED] = CAUSE_MAG_SILENT,
    [-OUTCOME_MAG_STUCK] = CAUSE_MAG_STUCK, [-OUTCOME_SILENT] = CAUSE_NO_DATA_READY,
};

#ifdef ACQUISITION_WIRED_ONLY
static const IN_FLASH struct sensor_driver *
sensor_of(const struct acquisition *acquisition) {
    return ACQUISITION_PORT(acquisition)->sensor;
}

static uint8_t bursts_of(const IN_FLASH struct sensor_driver *sensor) {
    return sensor->bursts_count;
}
#else
static const IN_FLASH struct sensor_driver *
sensor_of(const struct acquisition *acquisition) {
    return acquisition->sensor;
}

// One of length 0 ends them.
static uint8_t bursts_of(const IN_FLASH struct sensor_driver *sensor) {
    uint8_t count = 0;
    while (count < sensor->bursts_count && sensor->bursts[count].length > 0) {
        ++count;
    }
    return count;
}
#endif

// Not inline: two copies would take more of the AVR's flash.
__attribute__((noinline)) static void start_sampling(struct acquisition *acquisition) {
    const IN_FLASH struct sensor_driver *sensor = sensor_of(acquisition);
#ifndef ACQUISITION_WIRED_ONLY
    if (acquisition->is_polled) {
        polled_begin(&acquisition->polled, sensor->identity->rate_hz);
        return;
    }
#endif
    ACQUISITION_PORT(acquisition)->start_sampling(sensor->bursts, bursts_of(sensor));
}

static void begin_setup(struct acquisition *acquisition) {
    const IN_FLASH struct sensor_driver *sensor = sensor_of(acquisition);
    sensor->begin(sensor->state);
    acquisition->phase = ACQUISITION_SETUP;
    acquisition->failed = 0;
#ifndef ACQUISITION_WIRED_ONLY
    acquisition->listens = false;
#endif
}

void acquisition_begin(struct acquisition *acquisition,
                       const IN_FLASH struct acquisition_port *port,
                       struct probe *probe) {
    *acquisition = (struct acquisition){.probe = probe};
    SET_PORT(acquisition, port);
#ifndef ACQUISITION_WIRED_ONLY
    acquisition->sensor = port->sensor;
#endif
    begin_setup(acquisition);
}

static enum outcome set_up(struct acquisition *acquisition, uint32_t now_us) {
    const IN_FLASH struct sensor_driver *sensor = sensor_of(acquisition);
    const enum sensor_result result =
        sensor->setup(sensor->state, ACQUISITION_PORT(acquisition)->bus, now_us);
    if (result == SENSOR_OK) {
#ifndef ACQUISITION_WIRED_ONLY
        acquisition->is_found = true;
#endif
        start_sampling(acquisition);
        probe_sensor_ready(acquisition->probe, sensor->identity, now_us);
        acquisition->phase = ACQUISITION_SAMPLING;
        acquisition->since_us = now_us;
        acquisition->sample_us = (uint16_t)now_us;
        return OUTCOME_NOTHING;
    }
    return (enum outcome)result;
}

#ifndef ACQUISITION_WIRED_ONLY
// Where nobody has answered, or something else, tries the sensor that may be there in
// its place; false where that was the last one. No fault is told before; then it is
// that of the first, unless only the other is there.
static bool tries_another(struct acquisition *acquisition, enum outcome *outcome) {
    const IN_FLASH struct sensor_driver *other = acquisition->sensor->or_else;
    const bool is_other = *outcome == OUTCOME_WRONG_CHIP || *outcome == OUTCOME_UNSET ||
                          *outcome == OUTCOME_NO_FORCE;
    if (acquisition->is_found || (*outcome != OUTCOME_NACK && !is_other)) {
        return false;
    }
    if (other) {
        acquisition->first = (enum sensor_result) * outcome;
        acquisition->sensor = other;
        begin_setup(acquisition);
        return true;
    }
    if (*outcome == OUTCOME_NACK &&
        acquisition->sensor != ACQUISITION_PORT(acquisition)->sensor) {
        acquisition->sensor = ACQUISITION_PORT(acquisition)->sensor;
        *outcome = (enum outcome)acquisition->first;
    }
    return false;
}

// Asks the sensor, and reads its sample; as take_reading() of a board with the wire.
static enum reading_result ask(struct acquisition *acquisition, struct reading *out) {
    const IN_FLASH struct acquisition_port *port = ACQUISITION_PORT(acquisition);
    const IN_FLASH struct bus_device *bus = port->bus;
    const IN_FLASH struct sensor_driver *sensor = acquisition->sensor;
    const struct sensor_ready *ready = sensor->ready;
    const uint32_t begun_us = port->time_us();
    if (polled_wait_us(&acquisition->polled, begun_us) > 0) {
        return READING_NONE;
    }
    uint8_t flags;
    enum bus_result result =
        bus->read(bus->port, ready->address, ready->reg, &flags, 1);
    if (result != BUS_OK) {
        return (enum reading_result)result;
    }
    // The chip looks when the last of the four bytes begins.
    const uint32_t ended_us = port->time_us();
    const uint32_t at_us = ended_us - (ended_us - begun_us) / 4;
    if ((flags & ready->mask) == 0) {
        polled_no(&acquisition->polled, at_us);
        return READING_NONE;
    }
    uint8_t *bytes = out->bytes;
    for (uint8_t i = 0; i < bursts_of(sensor); i++) {
        const struct bus_burst *burst = &sensor->bursts[i];
        result = bus->read(bus->port, burst->address, burst->reg, bytes, burst->length);
        if (result != BUS_OK) {
            return (enum reading_result)result;
        }
        bytes += burst->length;
    }
    return polled_yes(&acquisition->polled, at_us, &out->time_us, &out->missed)
               ? READING_OK
               : READING_NONE;
}

// Listens for edges instead of asking, until one has come, which was due, or the time
// is over.
static enum reading_result listen(struct acquisition *acquisition, struct reading *out,
                                  uint32_t now_us) {
    const IN_FLASH struct acquisition_port *port = ACQUISITION_PORT(acquisition);
    const enum reading_result result = port->take_reading(out);
    const uint16_t rate_hz = acquisition->sensor->identity->rate_hz;
    if (result == READING_NONE &&
        now_us - acquisition->listening_us < LISTENING_PERIODS_US / rate_hz) {
        return READING_NONE;
    }
    acquisition->listens = false;
    if (result == READING_OK && polled_is_next(&acquisition->polled, out->time_us)) {
        acquisition->is_polled = false;
        probe_tell(acquisition->probe, EVENT_BUS_RECOVERED, CAUSE_NO_DATA_READY, 0,
                   now_us);
        return READING_OK;
    }
    port->stop_sampling();
    return READING_NONE;
}

// No edge has come since boot, or in set-ups in a row: perhaps there is no wire, or it
// is off. True: asked from now on.
static bool goes_without_wire(struct acquisition *acquisition, uint32_t now_us) {
    if (acquisition->is_polled || acquisition->sensor->ready == NULL) {
        return false;
    }
    if (acquisition->is_wired && acquisition->silences < SILENCES_MAX) {
        ++acquisition->silences;
        return false;
    }
    ACQUISITION_PORT(acquisition)->stop_sampling();
    acquisition->is_polled = true;
    acquisition->since_us = now_us;
    start_sampling(acquisition);
    probe_tell(acquisition->probe, EVENT_DATA_READY_POLLED, CAUSE_NO_DATA_READY, 0,
               now_us);
    return true;
}

bool acquisition_is_due(const struct acquisition *acquisition, uint32_t now_us) {
    enum { SOON_US = 1200 };
    return acquisition->is_polled && acquisition->phase == ACQUISITION_SAMPLING &&
           polled_wait_us(&acquisition->polled, now_us) < SOON_US;
}

uint32_t acquisition_polled_edges(const struct acquisition *acquisition) {
    return acquisition->polled.edges;
}
#else
static bool tries_another(struct acquisition *acquisition, enum outcome *outcome) {
    (void)acquisition;
    (void)outcome;
    return false;
}

static bool goes_without_wire(struct acquisition *acquisition, uint32_t now_us) {
    (void)acquisition;
    (void)now_us;
    return false;
}
#endif

// Fills in what a burst brought; OUTCOME_OK where that is a sample. Not inline, so that
// its bytes are off the stack while the sample is worked on.
__attribute__((noinline)) static enum outcome
take_sample(struct acquisition *acquisition, struct sample *sample, uint32_t now_us) {
    struct reading reading;
#ifdef ACQUISITION_WIRED_ONLY
    const enum reading_result result =
        ACQUISITION_PORT(acquisition)->take_reading(&reading);
#else
    const enum reading_result result =
        acquisition->listens ? listen(acquisition, &reading, now_us)
        : acquisition->is_polled
            ? ask(acquisition, &reading)
            : ACQUISITION_PORT(acquisition)->take_reading(&reading);
    acquisition->is_wired |= !acquisition->is_polled && result == READING_OK;
#endif
    if (result != READING_OK) {
        return (enum outcome)result;
    }
    const IN_FLASH struct sensor_driver *sensor = sensor_of(acquisition);
    sample->has_gap = acquisition->has_gap;
    if (!sensor->parse(sensor->state, reading.bytes, reading.time_us, sample)) {
        return OUTCOME_BUS_STUCK;
    }
    if (reading.missed > 0) {
        probe_overrun(acquisition->probe, reading.missed, now_us);
        sample->has_gap = true;
    }
    // A sensor may also leave one out. In 16 bits: after 50 ms of silence it is set up
    // again.
    const uint16_t time_us = (uint16_t)reading.time_us;
    const uint16_t interval_us = (uint16_t)(time_us - acquisition->sample_us);
    acquisition->sample_us = time_us;
    if ((uint32_t)interval_us * sensor->identity->rate_hz > GAP_PERIODS_US) {
        sample->has_gap = true;
    }
    acquisition->has_gap = false;
    acquisition->failed = 0;
    acquisition->since_us = now_us;
    return OUTCOME_OK;
}

// Looks after the sensor now and then, soon after an edge: the bus is free then. Not
// inline, so that what it needs is off the stack while a sample is worked on.
__attribute__((noinline)) static enum outcome check(struct acquisition *acquisition,
                                                    uint32_t edge_us, uint32_t now_us) {
    ++acquisition->unchecked;
    // In 16 bits: no sample waits for 65 ms.
    const bool is_late =
        (uint16_t)((uint16_t)now_us - (uint16_t)edge_us) > CHECK_WITHIN_US;
    if (acquisition->unchecked < CHECK_SAMPLES ||
        (is_late && acquisition->unchecked < UINT8_MAX)) {
        return OUTCOME_OK;
    }
    const IN_FLASH struct acquisition_port *port = ACQUISITION_PORT(acquisition);
    const IN_FLASH struct sensor_driver *sensor = sensor_of(acquisition);
    acquisition->unchecked = 0;
#ifndef ACQUISITION_WIRED_ONLY
    if (acquisition->is_polled) {  // keep what is known of its edges
        const enum sensor_result found = sensor->check(sensor->state, port->bus);
        acquisition->listens = acquisition->is_wired;
        if (acquisition->listens) {
            acquisition->listening_us = now_us;
            port->start_sampling(sensor->bursts, bursts_of(sensor));
        }
        return (enum outcome)found;
    }
    acquisition->silences = 0;
#endif
    port->stop_sampling();
    const enum sensor_result result = sensor->check(sensor->state, port->bus);
    start_sampling(acquisition);
    return (enum outcome)result;
}

// Stops sampling, frees the bus and reports the cause. A failed burst loses one sample,
// and sampling continues; after other or repeated failures, or if the bus stays
// blocked, the sensor is set up again shortly after.
static void fail(struct acquisition *acquisition, enum outcome outcome,
                 uint32_t now_us) {
    const IN_FLASH struct acquisition_port *port = ACQUISITION_PORT(acquisition);
    enum event event = EVENT_SENSOR_FAULT;
    bool is_over = true;
    uint16_t detail;
    if (outcome >= OUTCOME_BUS_STUCK) {
        event = EVENT_BUS_FAULT;
        if (acquisition->phase == ACQUISITION_SAMPLING) {
            ++acquisition->failed;
            is_over = acquisition->failed == BURSTS_FAILED_MAX;
        }
        detail = acquisition->failed;
    } else {
        const struct sensor_identity *identity = sensor_of(acquisition)->identity;
        detail = (uint16_t)(identity->wrong_register * 256u + identity->who_am_i[0]);
    }
    port->stop_sampling();
    if (port->recover_bus() != BUS_OK) {
        outcome = OUTCOME_BUS_STUCK;
        is_over = true;
    }
    probe_sensor_failed(acquisition->probe, event, (enum cause)causes[-outcome], detail,
                        is_over, now_us);
    acquisition->has_gap = true;
    if (is_over) {
        acquisition->phase = ACQUISITION_WAITING;
        acquisition->since_us = now_us;
    } else {
        start_sampling(acquisition);
    }
}

bool acquisition_step(struct acquisition *acquisition, uint32_t now_us) {
    struct sample sample;
    enum outcome outcome;
    bool worked = false;
    const uint32_t elapsed_us = now_us - acquisition->since_us;
    if (acquisition->phase == ACQUISITION_WAITING) {
        if (elapsed_us >= RETRY_US) {
#ifndef ACQUISITION_WIRED_ONLY
            if (!acquisition->is_found) {
                acquisition->sensor = ACQUISITION_PORT(acquisition)->sensor;
            }
#endif
            begin_setup(acquisition);
        }
        return false;
    }
    if (acquisition->phase == ACQUISITION_SETUP) {
        outcome = set_up(acquisition, now_us);
        if (outcome < OUTCOME_OK && tries_another(acquisition, &outcome)) {
            return false;
        }
    } else {
        outcome = take_sample(acquisition, &sample, now_us);
        if (outcome == OUTCOME_NOTHING && elapsed_us >= SILENCE_US) {
            if (goes_without_wire(acquisition, now_us)) {
                return false;
            }
            acquisition->failed = 0;
            outcome = OUTCOME_SILENT;
        }
        if (outcome == OUTCOME_OK) {
            // cppcheck-suppress uninitStructMember  ; parse fills it where there is a
            // sample
            outcome = check(acquisition, sample.time_us, now_us);
            probe_sample(acquisition->probe, &sample);
            worked = true;
        }
    }
    if (outcome < OUTCOME_OK) {
        fail(acquisition, outcome, now_us);
    }
    return worked;
}
