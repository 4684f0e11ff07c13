// SPDX-License-Identifier: MIT
// The two-wire bus as set-up and sampling share it.
#ifndef TWI_H
#define TWI_H

#include "core/drivers/bus.h"

// Bus clock 400 kHz, no transfer.
void twi_init(void);

// Takes the pins from the bus hardware and drops its transfer. Returns why a
// transfer can't have ended: BUS_STUCK where a line is low, else BUS_TIMEOUT.
enum bus_result twi_abort(void);

#endif
