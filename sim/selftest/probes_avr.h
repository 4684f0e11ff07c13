// SPDX-License-Identifier: MIT
// What the programs of the self-test share.
#ifndef SIM_SELFTEST_PROBES_AVR_H
#define SIM_SELFTEST_PROBES_AVR_H

#include "probes.h"

// Beyond the variables and below the stack: start-up code leaves it alone.
#define PROBE (*(volatile uint8_t *)PROBE_ADDRESS)
#define RESULT ((volatile uint16_t *)PROBE_RESULTS)

void delay_ticks(uint16_t ticks);  // of Timer1, which runs
void watchdog_modes(uint8_t causes);

#endif
