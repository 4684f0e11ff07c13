// SPDX-License-Identifier: MIT
// The functions of core/probe/equipment.h for this board: its clock, radio, SPI and
// power, and the memory of the log.
#include "core/probe/equipment.h"

#include "../board.h"
#include "chip.h"
#include "clock.h"
#include "idle.h"
#include "power.h"
#include "radio.h"
#include "spi.h"

enum { RING_SIZE = 65536 };  // 1.4 s of raw and pose at 380 Hz

// Out of the reach of the stack, in that of the card's DMA.
static struct logbook book;
static uint8_t ring[RING_SIZE];

static struct equipment equipment;

static bool keep(const uint8_t *frame, uint8_t length) {
    return logbook_put(&book, frame, length);
}

static void describe(struct message_equipment *out) {
    equipment_describe(&equipment, out);
}

static void go_to_sleep(void) {
    board_sampling_stop();
    const bool is_off = chip_power_down();
    (void)is_off;  // one that does not answer can't be told
    power_sleep();
}

static const struct equipment_port port = {
    .keep = keep,
    .describe = describe,
    .clock_is_spare = clock_is_spare,
    .battery_mv = power_battery_mv,
    .power_flags = power_flags,
    .radio_state = radio_state,
    .radio_resets = radio_resets,
    .power_step = power_step,
    .radio_step = radio_step,
    .radio_cause = radio_cause,
    .send_is_idle = board_send_is_idle,
    .sleep = go_to_sleep,
};

void board_equipment_begin(struct probe *probe) {
    equipment_begin(&equipment, &port, probe, &book);
    spi_init();
    logbook_init(&book, spi_card(), ring, sizeof ring);
}

void board_equipment_step(struct probe *probe, uint32_t now_us) {
    (void)probe;  // `begin` was given it
    if (equipment_step(&equipment, now_us)) {
        idle_has_work = true;
    }
}

bool board_equipment_is_done(void) {
    return equipment_is_done(&equipment);
}
