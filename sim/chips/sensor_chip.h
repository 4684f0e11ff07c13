// SPDX-License-Identifier: MIT
// A modelled sensor, whichever chip it is: its power, its time, the motion that it
// measures, its pins and its place on the I2C wire. Each chip's own header has its
// configuration and makes one; the models' side is sensor/model.h.
//
// Time is an argument, in nanoseconds since power came, and never goes back. A model
// asks for motion in SI units along right-handed axes and converts it to its own.
#ifndef SIM_CHIPS_SENSOR_CHIP_H
#define SIM_CHIPS_SENSOR_CHIP_H

#include <stdbool.h>
#include <stdint.h>

#include "chip_motion.h"
#include "i2c_slave.h"

// Every chip's configuration begins with this.
struct sensor_chip_config {
    struct chip_motion_source motion;  // held: as sensor_chip_hold() has it
    double temperature_c;
    uint64_t startup_ns;  // from power-up until registers answer
};

struct sensor_chip;

void sensor_chip_free(struct sensor_chip *chip);
// Power goes and comes back at now_ns; faults stay.
void sensor_chip_power_cycle(struct sensor_chip *chip, uint64_t now_ns);

// The motion from now on where the configuration has no function. Before the first
// call: lying still, level, in a field of (0, 20, -40) uT.
void sensor_chip_hold(struct sensor_chip *chip, const double gyr_rad_s[3],
                      const double acc_m_s2[3], const double mag_ut[3]);
void sensor_chip_set_temperature(struct sensor_chip *chip, double temperature_c);

// Lets time pass; every other function with a time does so first.
void sensor_chip_advance(struct sensor_chip *chip, uint64_t now_ns);
// When something next happens by itself; UINT64_MAX where nothing will.
uint64_t sensor_chip_next_event(const struct sensor_chip *chip);
// The level of a pin (an open-drain one has its pull-up), 0 where the chip has one. It
// may also change with a byte on the wire: data-ready goes as the data are read.
bool sensor_chip_pin_is_high(const struct sensor_chip *chip, unsigned pin);

// The chip on the wire: its bytes, whole transactions, faults.
struct i2c_slave *sensor_chip_wire(struct sensor_chip *chip);

// For tests: a register of a die (from 1) with no side effects, transactions so far,
// samples of a quantity so far, and the first thing that the host did against the
// documents (null: nothing).
uint8_t sensor_chip_peek(const struct sensor_chip *chip, uint8_t die, uint8_t reg);
uint64_t sensor_chip_transactions(const struct sensor_chip *chip);
uint64_t sensor_chip_samples(const struct sensor_chip *chip,
                             enum chip_quantity quantity);
const char *sensor_chip_complaint(const struct sensor_chip *chip);

#endif
