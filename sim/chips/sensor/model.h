// SPDX-License-Identifier: MIT
// What the models of sensors are built on: struct sensor_chip, which each of them has
// as its first member, and the functions that only they differ in.
#ifndef SIM_CHIPS_SENSOR_MODEL_H
#define SIM_CHIPS_SENSOR_MODEL_H

#include <stddef.h>

#include "../chip_motion.h"
#include "../i2c_slave.h"
#include "../sensor_chip.h"

#define NEVER UINT64_MAX
#define MS UINT64_C(1000000)  // in nanoseconds
#define US UINT64_C(1000)

// The functions of a model; `self` is its struct. The time is now_ns of its wire.
struct sensor_model {
    const char *name;
    struct i2c_slave_chip wire;
    void (*power_up)(void *self);  // all but the wire is as power finds it
    uint64_t (*next_event)(const void *self);
    void (*do_events)(void *self);  // those of this instant
    // CHIP_FAULT_REGISTER_FLIP or CHIP_FAULT_MAG_HUNG, once.
    void (*suffer)(void *self, const struct chip_fault *fault);
    bool (*pin_is_high)(const void *self, unsigned pin);
    uint8_t (*peek)(const void *self, uint8_t die, uint8_t reg);
    uint64_t (*samples)(const void *self, enum chip_quantity quantity);
};

struct sensor_chip {
    const struct sensor_model *model;
    struct sensor_chip_config config;
    struct i2c_slave wire;
    struct chip_motion motion;
    char complaint[96];  // empty: none
};

// A model of `size` bytes whose power comes at time 0. Its own configuration, which
// begins with struct sensor_chip_config, is the member behind struct sensor_chip. Null
// where memory is out.
struct sensor_chip *sensor_chip_new(const struct sensor_model *model, size_t size,
                                    const void *config, size_t config_size);
// Keeps the first thing that the host did against the documents; of the chip, or of a
// die that has another name.
void sensor_chip_complain(struct sensor_chip *chip, const char *what);
void sensor_chip_complain_of(struct sensor_chip *chip, const char *name,
                             const char *what);

// Whether a fault of that kind is active on a die (0: whichever it is of).
bool sensor_chip_suffers(const struct sensor_chip *chip, enum chip_fault_kind kind,
                         uint8_t die);
// Whether a fault has a sensor take no samples.
bool sensor_chip_is_silent(const struct sensor_chip *chip, enum chip_quantity quantity,
                           uint8_t die);
// The part of a self-test's response that a fault leaves: all, or a tenth.
double sensor_chip_response(const struct sensor_chip *chip, enum chip_fault_kind kind,
                            uint8_t die);
// WHO_AM_I as a die answers it.
uint8_t sensor_chip_identity(const struct sensor_chip *chip, uint8_t die,
                             uint8_t who_am_i);

// A low-pass: its -3 dB bandwidth and the delay it brings.
struct lowpass {
    double bandwidth_hz;
    double delay_ms;
};
// The motion behind a low-pass, a moving average centred on the delay, later where it
// would see the future. Over w it has its -3 dB point at 0.443 / w. Motion recorded
// behind such a low-pass is only brought to the sample rate.
void sensor_chip_low_passed(const struct sensor_chip *chip, enum chip_quantity quantity,
                            struct lowpass lowpass, double period_ns, double mean[3]);
void sensor_chip_recorded(const struct sensor_chip *chip, enum chip_quantity quantity,
                          double period_ns, double mean[3]);

#endif
