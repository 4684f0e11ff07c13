// SPDX-License-Identifier: MIT
// Devices wired to the pins beside the sensor and the card: radio, cell and charger.
#ifndef SIM_F405_PERIPHERALS_WIRED_H
#define SIM_F405_PERIPHERALS_WIRED_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_wired {
    bool is_cts_high, is_reset_low;  // as the radio has them
    int rts, pio2;                   // as the pins have them
    bool has_battery, is_external, is_charging;
    uint32_t from_mv, to_mv;  // a straight line in time
    uint64_t from_ps, for_ps;
    double pin_mv;  // of PC0 where nothing holds it
};

void wired_power_up(struct f405 *m);
void wired_event(struct f405 *m);
// Passes on the bytes that the radio has sent to the host. To be called after each call
// that advances the radio.
void wired_tell_host(struct f405 *m);
// The firmware, or time, has changed something on these wires.
void wired_follow(struct f405 *m);
// What they drive: 0, 1, or -1 for nothing.
int wired_level(const struct f405 *m, unsigned port, unsigned pin);
// PC0 has been set up again.
void wired_settle(struct f405 *m);
// The voltage at PC0 and, in *ohms, the resistance behind it; 0: nothing drives it.
double wired_analog_mv(const struct f405 *m, double *ohms);

#endif
