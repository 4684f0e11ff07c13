// SPDX-License-Identifier: MIT
// A board's equipment other than sensor, wire and button: clock, radio, card, battery.
// When to log, when to sleep, and what the probe hears of it; the message `equipment`.
#ifndef EQUIPMENT_H
#define EQUIPMENT_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/rn41.h"
#include "core/probe/probe.h"
#include "core/storage/logbook.h"

// The board functions that equipment needs. Only `sleep` waits.
struct equipment_port {
    // What the probe calls without saying which equipment it means: logbook_put() and
    // equipment_describe() of this board's.
    bool (*keep)(const uint8_t *frame, uint8_t length);
    void (*describe)(struct message_equipment *out);

    // The crystal has failed: the clock is the spare one.
    bool (*clock_is_spare)(void);
    // As struct message_equipment has them.
    uint16_t (*battery_mv)(void);
    uint8_t (*power_flags)(void);
    enum radio (*radio_state)(void);
    uint16_t (*radio_resets)(void);
    // True once when the battery becomes low, which POWER_LOW says from then on.
    bool (*power_step)(uint32_t now_us);
    enum rn41_event (*radio_step)(uint32_t now_us);
    // Why the radio was given up, after RN41_FAULT.
    enum cause (*radio_cause)(void);
    // True when everything handed to the wire has left.
    bool (*send_is_idle)(void);
    // Stops sampling, powers the sensor down and sleeps. What wakes is a start: it does
    // not return.
    void (*sleep)(void);
};

struct equipment {
    const struct equipment_port *port;
    struct probe *probe;
    struct logbook *book;
    struct probe_log log;
    bool began_spare;  // the crystal did not start
    bool has_told_clock;
    bool has_dropped;  // the radio's link, at dropped_us
    bool is_falling_asleep;
    bool has_said_good_night;
    uint32_t dropped_us;
    uint32_t falling_since_us;
};

// Says so to the probe, after probe_begin(). All must stay valid, and logbook_init()
// comes before the first step.
void equipment_begin(struct equipment *equipment, const struct equipment_port *port,
                     struct probe *probe, struct logbook *book);

// Moves everything on; call it each turn of the main loop. True: again at once, the log
// has more to do.
bool equipment_step(struct equipment *equipment, uint32_t now_us);

// Nothing is left to be written: power may fail. After wants_reset it becomes
// true automatically.
bool equipment_is_done(const struct equipment *equipment);

// Fills all but messages_*.
void equipment_describe(const struct equipment *equipment,
                        struct message_equipment *out);

#endif
