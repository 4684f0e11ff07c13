// SPDX-License-Identifier: MIT
// What this board has beside sensor, wire and button, and how the probe hears of it.
#include "../board.h"

#include "clock.h"

static bool has_told_clock;
static bool began_spare;  // the crystal did not start

static void describe(struct message_equipment *out) {
    out->clock = clock_is_spare() ? CLOCK_SPARE : CLOCK_CRYSTAL;
    out->radio = RADIO_CABLE;
}

void board_extras_begin(struct probe_port *port) {
    port->equipment = describe;
    began_spare = clock_is_spare();
}

void board_extras_step(struct probe *probe, uint32_t now_us) {
    if (clock_is_spare() && !has_told_clock) {
        has_told_clock = true;
        probe_tell(probe, EVENT_CLOCK_FAILED, CAUSE_CRYSTAL, !began_spare, now_us);
    }
}

bool board_extras_are_done(void) {
    return true;
}
