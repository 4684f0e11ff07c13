// SPDX-License-Identifier: MIT
// Init, then forever: sensor to probe, probe to wire. All that knows a chip is behind
// board.h; all that knows a probe is in core/.
#include "core/probe/commands.h"
#include "ports.h"

enum {
    STEP_US = 5000,  // of the button, the periodic messages and the LED
    WAITS_MAX = 4,   // samples in a row
};

static struct probe probe;
static struct acquisition acquisition;

void main_describe(struct message_hello *out) {
    static const IN_FLASH char firmware[] = FIRMWARE_BUILD;
    for (uint8_t i = 0; i < sizeof out->firmware && firmware[i] != '\0'; i++) {
        out->firmware[i] = firmware[i];
    }
    out->board = board_kind();
    out->reset_cause = board_reset_cause();
    out->reset_address = board_reset_address();
}

void main_measure(struct message_status *out) {
    const uint16_t supply_mv = board_supply_mv();
    out->supply = supply_mv > 0 ? supply_mv : STATUS_SUPPLY_NULL;
    out->samples_ready = board_samples_ready() + acquisition_polled_edges(&acquisition);
    out->stack_free = board_stack_free();
    out->receive_lost = board_receive_lost();
}

struct outlet main_wire;

int main(void) {
    board_init();
#ifndef PORTS_FIXED
    main_wire.put = board_send;
#endif
    uint32_t stepped_us = board_time_us();
    probe_begin(&probe, PORT_GIVEN(probe_port), stepped_us);
    board_equipment_begin(&probe);
    acquisition_begin(&acquisition, PORT_GIVEN(acquisition_port), &probe);
    uint8_t waited = 0;
    for (;;) {
        board_watchdog_kick();
        const uint32_t now_us = board_time_us();
        // All else has a turn without a sample, unless there are too many in a row:
        // with a sample's work, a restart would take longer than there is time for
        // both.
        if (acquisition_step(&acquisition, now_us)) {
            probe_worked(&probe, (board_time_us() - now_us) * board_cycles_per_us());
            if (++waited < WAITS_MAX) {
                continue;
            }
        }
        waited = 0;
        for (int16_t byte = board_receive(); byte >= 0; byte = board_receive()) {
            // Not the time of the turn: a reply says when it was heard.
            commands_receive(&probe, (uint8_t)byte, board_time_us());
        }
        if (now_us - stepped_us >= STEP_US) {
            stepped_us = now_us;
            probe_step(&probe, board_button_is_down(), now_us);
            board_led_set(probe_led(&probe, now_us));
        }
        board_equipment_step(&probe, now_us);
        if (probe.wants_reset && board_send_is_idle() && board_equipment_is_done()) {
            board_reset();
        }
        if (acquisition.phase == ACQUISITION_SETUP) {
            board_pause();  // it waits for no interrupt
        } else if (!acquisition_is_due(&acquisition, board_time_us())) {
            board_idle();
        }
    }
}
