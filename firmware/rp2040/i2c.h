// SPDX-License-Identifier: MIT
// The sensor's bus, which is I2C0.
#ifndef I2C_H
#define I2C_H

#include "hardware/i2c.h"

#define SENSOR_BUS i2c0
enum { SENSOR_BUS_IRQ = I2C0_IRQ };

#endif
