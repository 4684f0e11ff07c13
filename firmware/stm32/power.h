// SPDX-License-Identifier: MIT
// The battery, its charger, and sleep.
//
// For who calls: power_start() comes first of all in board_init(), power_init() once
// the ports and ADC1 have their clocks, then power_step() every 100 ms or oftener.
// True means: the battery is low, told once. End the log, say so (battery_low with
// power_battery_mv(), going_to_sleep), wait until the card is done and
// board_send_is_idle(), put the sensor to power-down, then power_sleep().
#ifndef POWER_H
#define POWER_H

#include <stdbool.h>
#include <stdint.h>

// Sleeps where that is what the last program has ended for, and returns true. Before
// any watchdog: one that runs cannot be stopped.
bool power_start(void);

void power_init(void);
bool power_step(uint32_t now_us);

// For the message `equipment`: mV, 65535 where none is known; flags POWER_.
uint16_t power_battery_mv(void);
uint8_t power_flags(void);

// Restarts into sleep: all that runs is reset, the card deselected, the radio held in
// reset, the LED off. The button, held for 50 ms, or a charger's supply wakes; what
// follows is a start whose cause is a software reset.
_Noreturn void power_sleep(void);

#endif
