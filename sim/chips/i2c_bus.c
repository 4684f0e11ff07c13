// SPDX-License-Identifier: MIT
// See i2c_bus.h.
#include "i2c_bus.h"

#include <stddef.h>

// While one holds SDA, the others read zeros instead of the host's byte: they take no
// part until the next START.
static bool deafen(struct i2c_bus *bus, uint64_t now_ns) {
    const bool is_held = i2c_bus_holds_sda(bus, now_ns);
    for (unsigned i = 0; is_held && i < bus->count; i++) {
        i2c_slave_release(bus->slaves[i]);
    }
    return is_held;
}

bool i2c_bus_start(struct i2c_bus *bus, uint64_t now_ns, uint8_t address,
                   bool is_read) {
    bool ack = false;
    for (unsigned i = 0; i < bus->count; i++) {
        ack = i2c_slave_start(bus->slaves[i], now_ns, address, is_read) || ack;
    }
    return !deafen(bus, now_ns) && ack;
}

bool i2c_bus_write(struct i2c_bus *bus, uint64_t now_ns, uint8_t byte) {
    // The one that is addressed last: another one may take hold of SDA with this byte.
    struct i2c_slave *addressed = NULL;
    for (unsigned i = 0; i < bus->count; i++) {
        if (i2c_slave_is_addressed(bus->slaves[i])) {
            addressed = bus->slaves[i];
        } else {
            (void)i2c_slave_write(bus->slaves[i], now_ns, byte);
        }
    }
    (void)deafen(bus, now_ns);
    return addressed != NULL && i2c_slave_write(addressed, now_ns, byte);
}

// Open drain: a zero of any of them wins.
uint8_t i2c_bus_read(struct i2c_bus *bus, uint64_t now_ns, bool ack) {
    uint8_t value = 0xFF;
    for (unsigned i = 0; i < bus->count; i++) {
        value &= i2c_slave_read(bus->slaves[i], now_ns, ack);
    }
    return value;
}

void i2c_bus_stop(struct i2c_bus *bus, uint64_t now_ns) {
    for (unsigned i = 0; i < bus->count; i++) {
        i2c_slave_stop(bus->slaves[i], now_ns);
    }
}

bool i2c_bus_holds_sda(struct i2c_bus *bus, uint64_t now_ns) {
    bool is_held = false;
    for (unsigned i = 0; i < bus->count; i++) {
        is_held = i2c_slave_holds_sda(bus->slaves[i], now_ns) || is_held;
    }
    return is_held;
}

void i2c_bus_scl_pulse(struct i2c_bus *bus, uint64_t now_ns) {
    for (unsigned i = 0; i < bus->count; i++) {
        i2c_slave_scl_pulse(bus->slaves[i], now_ns);
    }
}
