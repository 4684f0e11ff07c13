// SPDX-License-Identifier: MIT
// A sensor module as a virtual board has it: the chips on it, their wire, and the pin
// that signals new data.
//
// mpu9250     an MPU-9250; its pin is INT.
// lsm6dsox    Adafruit 4517: an LSM6DSOX and a LIS3MDL, at 0x6A and 0x1C; the pin is
//             INT1 of the LSM6DSOX. The magnetometer's DRDY is not connected, as no
//             STEMMA QT cable has wires for either.
// Others are the same with a relative of the LSM6DSOX in its place: `pairs` in
// module.c.
//
// The axes of the pair: both dies measure along the same ones, x, y and z of the
// LSM6DSOX. No picture of the 4517 was at hand. Adafruit's AHRS library joins both dies
// of these boards with no change of axes, and on the FeatherWing with the same two
// chips (4569) the LIS3MDL is turned by 180 degrees against the LSM6DSOX, which brings
// its x and y (left and down the page with pin 1 at the top left, so dRonin) to right
// and up.
#ifndef SIM_CHIPS_MODULE_H
#define SIM_CHIPS_MODULE_H

#include <stdbool.h>
#include <stdint.h>

#include "chip_fault.h"
#include "chip_motion.h"
#include "i2c_bus.h"

struct module_config {
    const char *name;  // one of the above; null: mpu9250
    struct chip_motion_source motion;
    bool starts_at_once;  // answers from power-up on, for tests of the wire
};

struct module;

// What is wrong with a name, in words; null: nothing.
const char *module_misnamed(const char *name);
// A module whose power comes at time 0. Null where memory is out or the name is not
// known.
struct module *module_new(const struct module_config *config);
void module_free(struct module *module);
// Power goes and comes back at now_ns; faults stay.
void module_power_cycle(struct module *module, uint64_t now_ns);

// Lets time pass.
void module_advance(struct module *module, uint64_t now_ns);
// When something next happens by itself; UINT64_MAX where nothing will.
uint64_t module_next_event(const struct module *module);
bool module_pin_is_high(const struct module *module);
struct i2c_bus *module_bus(struct module *module);

// Of the pair: of both chips, or of die 1, the LSM6DSOX, or 2, the LIS3MDL; SDA is held
// by the first unless it is of die 2. False where a chip has as many as it can.
bool module_add_fault(struct module *module, const struct chip_fault *fault);

uint64_t module_transactions(const struct module *module);
// The first thing that the host did against the documents; null: nothing.
const char *module_complaint(const struct module *module);

#endif
