// SPDX-License-Identifier: MIT
// What this board has beside sensor, wire and button, as the message `equipment` tells
// it: clock, radio, card, battery. When to log, when to sleep, what the probe hears of
// it; the registers are in clock.c, radio.c, spi.c and power.c.
#include "../board.h"

#include "chip.h"
#include "clock.h"
#include "core/storage/logbook.h"
#include "idle.h"
#include "power.h"
#include "radio.h"
#include "spi.h"

enum {
    RING_SIZE = 65536,  // 1.4 s of raw and pose at 380 Hz
    // From the end of a stream to sleep: the second's messages have gone out, settings
    // have been written.
    LAST_WORDS_US = 1500000,
    LAST_WORDS_US_MAX = 5000000,  // a wire that is held, a card that is stuck
};

// Out of the reach of the stack, in that of the card's DMA.
static struct logbook book;
static uint8_t ring[RING_SIZE];

static bool keep(const uint8_t *bytes, uint8_t length) {
    return logbook_put(&book, bytes, length);
}

static struct probe_log card_log = {.outlet = {.put = keep}};

static bool has_told_clock;
static bool began_spare;  // the crystal did not start

static bool has_dropped;  // the radio's link, at dropped_us
static uint32_t dropped_us;

// On the way to sleep.
static bool is_falling_asleep;
static bool has_said_good_night;
static uint32_t falling_since_us;

static void describe(struct message_equipment *out) {
    out->clock = clock_is_spare() ? CLOCK_SPARE : CLOCK_CRYSTAL;
    out->battery = power_battery_mv();
    out->power = power_flags();
    out->radio = (uint8_t)radio_state();
    out->radio_resets = radio_resets();
    logbook_describe(&book, out);
}

void board_equipment_begin(struct probe *probe) {
    probe_equip(probe, &card_log, describe);
    began_spare = clock_is_spare();
    spi_init();
    logbook_init(&book, spi_card(), ring, sizeof ring);
}

static void follow_clock(struct probe *probe, uint32_t now_us) {
    if (clock_is_spare() && !has_told_clock) {
        has_told_clock = true;
        probe_tell(probe, EVENT_CLOCK_FAILED, CAUSE_CRYSTAL, !began_spare, now_us);
    }
}

// Nobody but the card hears that a link has dropped: how long it was gone, in ms, is
// told to whoever connects next.
static void follow_radio(struct probe *probe, uint32_t now_us) {
    switch (radio_step(now_us)) {
    case RN41_LINKED:
        probe_say_hello(probe, now_us);
        probe_tell(probe, EVENT_RADIO_CONNECTED, CAUSE_NONE,
                   has_dropped ? (int32_t)((now_us - dropped_us) / 1000) : 0, now_us);
        has_dropped = false;
        break;
    case RN41_DROPPED:
        has_dropped = true;
        dropped_us = now_us;
        probe_tell(probe, EVENT_RADIO_DROPPED, CAUSE_NONE, 0, now_us);
        break;
    case RN41_FAULT:
        probe_tell(probe, EVENT_RADIO_FAULT, radio_cause(), 0, now_us);
        break;
    default:
        break;
    }
}

// A recording is as long as the stream, or as the card is there.
static void follow_card(struct probe *probe, uint32_t now_us) {
    if (logbook_step(&book, now_us)) {
        idle_has_work = true;
    }
    struct logbook_change change;
    while (logbook_take_change(&book, &change)) {
        if (change.event == EVENT_LOG_ENDED && card_log.is_on) {
            probe_log(probe, false, now_us);
        }
        probe_tell(probe, (enum event)change.event, (enum cause)change.cause,
                   change.detail, now_us);
    }
    const bool is_wanted = probe->is_streaming && !probe->wants_reset;
    if (is_wanted && !card_log.is_on && logbook_open(&book)) {
        probe_log(probe, true, now_us);
    } else if (!is_wanted && card_log.is_on) {
        probe_log(probe, false, now_us);
        logbook_close(&book, is_falling_asleep ? CAUSE_BATTERY : CAUSE_NONE);
    }
}

bool board_equipment_is_done(void) {
    return !card_log.is_on && logbook_is_idle(&book);
}

static void fall_asleep(struct probe *probe, uint32_t now_us) {
    const uint32_t elapsed_us = now_us - falling_since_us;
    const bool is_late = elapsed_us >= LAST_WORDS_US_MAX;
    if (!has_said_good_night) {
        if (is_late || (elapsed_us >= LAST_WORDS_US && board_equipment_is_done())) {
            has_said_good_night = true;
            probe_tell(probe, EVENT_GOING_TO_SLEEP, CAUSE_BATTERY, power_battery_mv(),
                       now_us);
        }
        return;
    }
    if (!is_late && !board_send_is_idle()) {
        return;
    }
    board_sampling_stop();
    const bool is_off = chip_power_down();
    (void)is_off;  // one that does not answer can't be told
    power_sleep();
}

static void follow_battery(struct probe *probe, uint32_t now_us) {
    if (power_step(now_us)) {
        probe_tell(probe, EVENT_BATTERY_LOW, CAUSE_BATTERY, power_battery_mv(), now_us);
        is_falling_asleep = true;
        has_said_good_night = false;
        falling_since_us = now_us;
    }
    if (!is_falling_asleep) {
        return;
    }
    if ((power_flags() & POWER_LOW) == 0) {
        is_falling_asleep = false;  // a charger came in time
        return;
    }
    probe_set_streaming(probe, false, CAUSE_BATTERY, now_us);
    fall_asleep(probe, now_us);
}

void board_equipment_step(struct probe *probe, uint32_t now_us) {
    follow_clock(probe, now_us);
    follow_radio(probe, now_us);
    follow_battery(probe, now_us);
    follow_card(probe, now_us);
}
