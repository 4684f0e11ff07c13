// SPDX-License-Identifier: MIT
// Several chips on one I2C wire, each a slave of its own: all see the same bytes and
// count the same transactions; any of them may hold SDA low, and none of the others
// hears the host meanwhile. With one chip this is its wire.
#ifndef SIM_CHIPS_I2C_BUS_H
#define SIM_CHIPS_I2C_BUS_H

#include <stdbool.h>
#include <stdint.h>

#include "i2c_slave.h"

enum { I2C_BUS_SLAVES_MAX = 2 };

struct i2c_bus {
    struct i2c_slave *slaves[I2C_BUS_SLAVES_MAX];
    unsigned count;
};

// As the functions of i2c_slave.h.
bool i2c_bus_start(struct i2c_bus *bus, uint64_t now_ns, uint8_t address, bool is_read);
bool i2c_bus_write(struct i2c_bus *bus, uint64_t now_ns, uint8_t byte);
uint8_t i2c_bus_read(struct i2c_bus *bus, uint64_t now_ns, bool ack);
void i2c_bus_stop(struct i2c_bus *bus, uint64_t now_ns);
bool i2c_bus_holds_sda(struct i2c_bus *bus, uint64_t now_ns);
void i2c_bus_scl_pulse(struct i2c_bus *bus, uint64_t now_ns);

#endif
