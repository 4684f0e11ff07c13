// SPDX-License-Identifier: MIT
// The two lines of I2C1, SCL and SDA: whether I2C1 has the pins, whether the sensor
// holds SDA low, and what the firmware does with them as pins.
#include "chips/lsm9ds0.h"
#include "f405/f405.h"

enum {
    PIN_SCL = 6,  // PB6
    PIN_SDA = 7,  // PB7
    AF_I2C = 4,
};

struct i2c_slave *i2c_wire(const struct f405 *m) {
    return lsm9ds0_chip_wire(m->sensor);
}

bool i2c_is_held(const struct f405 *m) {
    return i2c_slave_holds_sda(i2c_wire(m), f405_ns(f405_when(m)));
}

bool i2c_has_pins(const struct f405 *m) {
    return pins_is_alternate(m, PORT_B, PIN_SCL, AF_I2C) &&
           pins_is_alternate(m, PORT_B, PIN_SDA, AF_I2C);
}

void i2c_tell_bus(struct f405 *m, bool is_start) {
    if (m->on_bus != NULL) {
        m->on_bus(m->context, is_start);
    }
}

// The lines driven as pins: pulses that free a sensor holding SDA, and a STOP by hand.
void i2c_follow_pins(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    const bool is_ours = !i2c_has_pins(m);
    const bool scl = !is_ours || pins_level(m, PORT_B, PIN_SCL);
    if (is_ours && scl && !i2c->scl_was_high) {
        i2c_slave_scl_pulse(i2c_wire(m), f405_ns(f405_when(m)));
    }
    const bool sda = !is_ours || pins_level(m, PORT_B, PIN_SDA);
    if (is_ours && scl && i2c->scl_was_high && sda && !i2c->sda_was_high) {
        // SDA rises while SCL is high.
        i2c_slave_stop(i2c_wire(m), f405_ns(f405_when(m)));
        i2c_tell_bus(m, false);
    }
    i2c->scl_was_high = scl;
    i2c->sda_was_high = sda;
}

// SDA is pulled low for a moment: the sensor sees a START within a byte and drops out
// of the transfer; the peripheral reports it and goes on (RM, "Bus error"). Of a byte
// that the sensor was sending the bits still to come are ones.
void f405_glitch(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if (i2c->doing != BUS_ADDRESS && i2c->doing != BUS_SEND &&
        i2c->doing != BUS_RECEIVE) {
        return;
    }
    if (i2c->doing == BUS_RECEIVE) {
        const uint64_t now = f405_when(m);
        const uint64_t end = m->at[EVENT_I2C];
        const uint64_t left = (end > now ? end - now : 0) / i2c_bit_ps(m);
        i2c->torn &= i2c_slave_read(i2c_wire(m), f405_ns(now), true) |
                     (uint8_t)((1U << (left > 8 ? 8 : left)) - 1);
    }
    i2c_slave_stop(i2c_wire(m), f405_ns(f405_when(m)));
    f405_spurious_berr(m);
}
