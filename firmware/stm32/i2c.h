// SPDX-License-Identifier: MIT
// I2C1 as set-up and sampling share it: one state machine, moved on by polling or by
// interrupt.
#ifndef I2C_H
#define I2C_H

#include <stdbool.h>

#include "core/drivers/bus.h"

enum i2c_progress {
    I2C_WAITS,  // for an event that has not come
    I2C_MOVED,
    I2C_OVER,  // i2c_result() says how
};

// Bus clock 400 kHz, no transfer.
void i2c_init(void);

// Starts to read `count` bursts into `bytes`, one behind the other, with a repeated
// START between them; the I2C interrupts call i2c_step until it is over. False where
// the STOP before does not come to its end.
bool i2c_read(const struct bus_burst *bursts, uint8_t count, uint8_t *bytes);

enum i2c_progress i2c_step(void);
enum bus_result i2c_result(void);

// Takes the bus from the hardware and forgets what it was doing. Returns why a transfer
// can't have ended: BUS_STUCK where a line is low, else BUS_TIMEOUT.
enum bus_result i2c_abort(void);

#endif
