// SPDX-License-Identifier: MIT
// Clock, radio, card and battery, each monitored separately; see equipment.h.
#include "core/probe/equipment.h"

enum {
    // From the end of a stream to sleep: the second's messages have gone out, settings
    // have been written.
    LAST_WORDS_US = 1500000,
    LAST_WORDS_US_MAX = 5000000,  // a wire that is held, a card that is stuck
};

void equipment_describe(const struct equipment *equipment,
                        struct message_equipment *out) {
    const struct equipment_port *port = equipment->port;
    out->clock = port->clock_is_spare() ? CLOCK_SPARE : CLOCK_CRYSTAL;
    out->battery = port->battery_mv();
    out->power = port->power_flags();
    out->radio = (uint8_t)port->radio_state();
    out->radio_resets = port->radio_resets();
    logbook_describe(equipment->book, out);
}

void equipment_begin(struct equipment *equipment, const struct equipment_port *port,
                     struct probe *probe, struct logbook *book) {
    *equipment = (struct equipment){
        .port = port,
        .probe = probe,
        .book = book,
        .log = {.outlet = {.put = port->keep}},
        .began_spare = port->clock_is_spare(),
    };
    probe_equip(probe, &equipment->log, port->describe);
}

static void follow_clock(struct equipment *equipment, uint32_t now_us) {
    if (equipment->port->clock_is_spare() && !equipment->has_told_clock) {
        equipment->has_told_clock = true;
        probe_tell(equipment->probe, EVENT_CLOCK_FAILED, CAUSE_CRYSTAL,
                   !equipment->began_spare, now_us);
    }
}

// Only the card records that a link has dropped: the next host that connects is told
// how long it was lost, in ms.
static void follow_radio(struct equipment *equipment, uint32_t now_us) {
    struct probe *probe = equipment->probe;
    const uint32_t gone_us = now_us - equipment->dropped_us;
    switch (equipment->port->radio_step(now_us)) {
    case RN41_LINKED:
        probe_say_hello(probe, now_us);
        probe_tell(probe, EVENT_RADIO_CONNECTED, CAUSE_NONE,
                   equipment->has_dropped ? (int32_t)(gone_us / 1000) : 0, now_us);
        equipment->has_dropped = false;
        break;
    case RN41_DROPPED:
        equipment->has_dropped = true;
        equipment->dropped_us = now_us;
        probe_tell(probe, EVENT_RADIO_DROPPED, CAUSE_NONE, 0, now_us);
        break;
    case RN41_FAULT:
        probe_tell(probe, EVENT_RADIO_FAULT, equipment->port->radio_cause(), 0, now_us);
        break;
    default:
        break;
    }
}

// A recording is as long as the stream, or as the card is there.
static bool follow_card(struct equipment *equipment, uint32_t now_us) {
    struct probe *probe = equipment->probe;
    const bool has_more = logbook_step(equipment->book, now_us);
    struct logbook_change change;
    while (logbook_take_change(equipment->book, &change)) {
        if (change.event == EVENT_LOG_ENDED && equipment->log.is_on) {
            probe_log(probe, false, now_us);
        }
        probe_tell(probe, (enum event)change.event, (enum cause)change.cause,
                   change.detail, now_us);
    }
    const bool is_wanted = probe->is_streaming && !probe->wants_reset;
    if (is_wanted && !equipment->log.is_on && logbook_open(equipment->book)) {
        probe_log(probe, true, now_us);
    } else if (!is_wanted && equipment->log.is_on) {
        probe_log(probe, false, now_us);
        logbook_close(equipment->book,
                      equipment->is_falling_asleep ? CAUSE_BATTERY : CAUSE_NONE);
    }
    return has_more;
}

bool equipment_is_done(const struct equipment *equipment) {
    return !equipment->log.is_on && logbook_is_idle(equipment->book);
}

static void fall_asleep(struct equipment *equipment, uint32_t now_us) {
    const struct equipment_port *port = equipment->port;
    const uint32_t elapsed_us = now_us - equipment->falling_since_us;
    const bool is_late = elapsed_us >= LAST_WORDS_US_MAX;
    if (!equipment->has_said_good_night) {
        if (is_late || (elapsed_us >= LAST_WORDS_US && equipment_is_done(equipment))) {
            equipment->has_said_good_night = true;
            probe_tell(equipment->probe, EVENT_GOING_TO_SLEEP, CAUSE_BATTERY,
                       port->battery_mv(), now_us);
        }
    } else if (is_late || port->send_is_idle()) {
        port->sleep();
    }
}

static void follow_battery(struct equipment *equipment, uint32_t now_us) {
    const struct equipment_port *port = equipment->port;
    struct probe *probe = equipment->probe;
    if (port->power_step(now_us)) {
        probe_tell(probe, EVENT_BATTERY_LOW, CAUSE_BATTERY, port->battery_mv(), now_us);
        equipment->is_falling_asleep = true;
        equipment->has_said_good_night = false;
        equipment->falling_since_us = now_us;
    }
    if (!equipment->is_falling_asleep) {
        return;
    }
    if ((port->power_flags() & POWER_LOW) == 0) {
        equipment->is_falling_asleep = false;  // a charger came in time
        return;
    }
    probe_set_streaming(probe, false, CAUSE_BATTERY, now_us);
    fall_asleep(equipment, now_us);
}

bool equipment_step(struct equipment *equipment, uint32_t now_us) {
    follow_clock(equipment, now_us);
    follow_radio(equipment, now_us);
    follow_battery(equipment, now_us);
    return follow_card(equipment, now_us);
}
