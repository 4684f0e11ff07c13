// SPDX-License-Identifier: MIT
// Brings the sensor from reset to samples and keeps it there: set-up, retries, a bus to
// be freed, a sensor gone silent. Samples go to the probe, and so does what went wrong.
#ifndef ACQUISITION_H
#define ACQUISITION_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/bus.h"
#include "core/drivers/sensor.h"
#include "core/probe/polled.h"
#include "core/probe/probe.h"

// Why it failed is as enum bus_result has it; the bus then needs recovering.
enum reading_result {
    READING_OK = BUS_OK,
    READING_NONE = 1,  // none has come since the last one taken
    READING_NACK = BUS_NACK,
    READING_TIMEOUT = BUS_TIMEOUT,
    READING_STUCK = BUS_STUCK,
};

// What the interrupts of a board have read from the sensor after one data-ready edge.
struct reading {
    uint8_t bytes[BUS_BURST_MAX];  // of its bursts, one after the other
    uint32_t time_us;              // of the edge
    uint16_t missed;               // edges before it that got no reading
};

// The board functions that acquisition needs; board.h documents each of them.
struct acquisition_port {
    const IN_FLASH struct sensor_driver *sensor;  // the first that is tried
    const IN_FLASH struct bus_device *bus;        // for set-up, not while sampling
    enum bus_result (*recover_bus)(void);
    void (*start_sampling)(const struct bus_burst *bursts, uint8_t count);
    void (*stop_sampling)(void);
    enum reading_result (*take_reading)(struct reading *out);
#ifndef ACQUISITION_WIRED_ONLY
    uint32_t (*time_us)(void);  // for a sensor without a data-ready wire
#endif
};

enum acquisition_phase {
    ACQUISITION_WAITING,  // before the next attempt
    ACQUISITION_SETUP,
    ACQUISITION_SAMPLING,
};

struct acquisition {
#ifndef PORTS_FIXED
    const IN_FLASH struct acquisition_port *port;
#endif
    struct probe *probe;
#ifndef ACQUISITION_WIRED_ONLY
    // Of the port's, the one that is tried or was found; once it was, no other is
    // tried.
    const IN_FLASH struct sensor_driver *sensor;
    bool is_found;
#endif
    enum acquisition_phase phase;
    uint32_t since_us;   // start of the wait, or the last burst
    uint16_t sample_us;  // of the last sample, or the end of set-up; low 16 bits
    uint8_t failed;      // bursts in a row
    bool has_gap;        // samples were lost before the next one
    uint8_t unchecked;   // samples since the sensor was last looked after
#ifndef ACQUISITION_WIRED_ONLY
    // Edges don't come, or have never come: the sensor is asked. Where they once came
    // they are listened for, for a little more than a period, now and then.
    bool is_polled, is_wired, listens;
    uint8_t silences;       // set-ups in a row that have brought no edge
    uint32_t listening_us;  // since then
    struct polled polled;
    enum sensor_result first;  // why the first sensor was given up for another
#endif
};

// Starts set-up of the sensor. Both must stay valid.
void acquisition_begin(struct acquisition *acquisition,
                       const IN_FLASH struct acquisition_port *port,
                       struct probe *probe);

// One step: of set-up, of a wait, or the next sample. True where a sample was worked
// on. Call it after every interrupt; while the phase is ACQUISITION_SETUP, which waits
// for none, again after 1 ms or so.
bool acquisition_step(struct acquisition *acquisition, uint32_t now_us);

#ifdef ACQUISITION_WIRED_ONLY
static inline bool acquisition_is_due(const struct acquisition *acquisition,
                                      uint32_t now_us) {
    (void)acquisition;
    (void)now_us;
    return false;
}
static inline uint32_t acquisition_polled_edges(const struct acquisition *acquisition) {
    (void)acquisition;
    return 0;
}
#else
// The next step is due before a board that sleeps wakes again, 1 ms or so.
bool acquisition_is_due(const struct acquisition *acquisition, uint32_t now_us);
// Samples of a sensor without the wire, seen or reckoned, since boot.
uint32_t acquisition_polled_edges(const struct acquisition *acquisition);
#endif

#endif
