// SPDX-License-Identifier: MIT
// What all modelled sensors have in common; see ../sensor_chip.h and model.h.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

// Life

static void advance(void *self, uint64_t now_ns) {
    sensor_chip_advance(self, now_ns);
}

struct sensor_chip *sensor_chip_new(const struct sensor_model *model, size_t size,
                                    const void *config, size_t config_size) {
    struct sensor_chip *chip = calloc(1, size);
    if (chip == NULL) {
        return NULL;
    }
    chip->model = model;
    memcpy(&chip->config, config, sizeof chip->config);
    memcpy(chip + 1, config, config_size);
    chip->wire =
        (struct i2c_slave){.ops = &model->wire, .advance = advance, .chip = chip};
    chip->motion = chip_motion_from(chip->config.motion);
    sensor_chip_power_cycle(chip, 0);
    return chip;
}

void sensor_chip_free(struct sensor_chip *chip) {
    free(chip);
}

void sensor_chip_power_cycle(struct sensor_chip *chip, uint64_t now_ns) {
    chip->wire.now_ns = now_ns;
    chip->wire.answers_ns = now_ns + chip->config.startup_ns;
    chip->wire.is_transfer = false;
    i2c_slave_release(&chip->wire);
    chip->model->power_up(chip);
}

void sensor_chip_hold(struct sensor_chip *chip, const double gyr_rad_s[3],
                      const double acc_m_s2[3], const double mag_ut[3]) {
    chip_motion_hold(&chip->motion, gyr_rad_s, acc_m_s2, mag_ut);
}

void sensor_chip_set_temperature(struct sensor_chip *chip, double temperature_c) {
    chip->config.temperature_c = temperature_c;
}

// Time

uint64_t sensor_chip_next_event(const struct sensor_chip *chip) {
    return chip->model->next_event(chip);
}

// What happens to the chip once.
static void suffer(struct sensor_chip *chip) {
    static const enum chip_fault_kind kinds[] = {CHIP_FAULT_REGISTER_FLIP,
                                                 CHIP_FAULT_MAG_HUNG};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        const struct chip_fault *fault = i2c_slave_next_fault(&chip->wire, kinds[i]);
        if (fault != NULL) {
            chip->model->suffer(chip, fault);
        }
    }
    if (i2c_slave_next_fault(&chip->wire, CHIP_FAULT_BROWN_OUT) != NULL) {
        sensor_chip_power_cycle(chip, chip->wire.now_ns);
    }
}

void sensor_chip_advance(struct sensor_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = sensor_chip_next_event(chip);
        if (next > now_ns || next == NEVER) {
            break;
        }
        chip->wire.now_ns = next;
        chip->model->do_events(chip);
        suffer(chip);
    }
    if (now_ns > chip->wire.now_ns) {
        chip->wire.now_ns = now_ns;
    }
    suffer(chip);
}

bool sensor_chip_pin_is_high(const struct sensor_chip *chip, unsigned pin) {
    return chip->model->pin_is_high(chip, pin);
}

struct i2c_slave *sensor_chip_wire(struct sensor_chip *chip) {
    return &chip->wire;
}

// For tests

uint8_t sensor_chip_peek(const struct sensor_chip *chip, uint8_t die, uint8_t reg) {
    return chip->model->peek(chip, die, reg);
}

uint64_t sensor_chip_transactions(const struct sensor_chip *chip) {
    return chip->wire.transactions;
}

uint64_t sensor_chip_samples(const struct sensor_chip *chip,
                             enum chip_quantity quantity) {
    return chip->model->samples(chip, quantity);
}

const char *sensor_chip_complaint(const struct sensor_chip *chip) {
    return chip->complaint[0] != '\0' ? chip->complaint : NULL;
}

// For the models

void sensor_chip_complain_of(struct sensor_chip *chip, const char *name,
                             const char *what) {
    if (chip->complaint[0] == '\0') {
        (void)snprintf(chip->complaint, sizeof chip->complaint, "%s: %s", name, what);
    }
}

void sensor_chip_complain(struct sensor_chip *chip, const char *what) {
    sensor_chip_complain_of(chip, chip->model->name, what);
}

bool sensor_chip_suffers(const struct sensor_chip *chip, enum chip_fault_kind kind,
                         uint8_t die) {
    return i2c_slave_find_fault(&chip->wire, kind, die) != NULL;
}

bool sensor_chip_is_silent(const struct sensor_chip *chip, enum chip_quantity quantity,
                           uint8_t die) {
    const struct chip_fault *fault =
        i2c_slave_find_fault(&chip->wire, CHIP_FAULT_NO_DATA_READY, die);
    return fault != NULL && (fault->value == 0 || fault->value == quantity + 1);
}

double sensor_chip_response(const struct sensor_chip *chip, enum chip_fault_kind kind,
                            uint8_t die) {
    return sensor_chip_suffers(chip, kind, die) ? 0.1 : 1.0;
}

uint8_t sensor_chip_identity(const struct sensor_chip *chip, uint8_t die,
                             uint8_t who_am_i) {
    const struct chip_fault *fault =
        i2c_slave_find_fault(&chip->wire, CHIP_FAULT_WRONG_WHO_AM_I, die);
    return fault != NULL ? fault->value : who_am_i;
}

void sensor_chip_recorded(const struct sensor_chip *chip, enum chip_quantity quantity,
                          double period_ns, double mean[3]) {
    const int64_t now = (int64_t)chip->wire.now_ns;
    const int64_t half = (int64_t)llround(0.5 * period_ns);
    chip_motion_mean(&chip->motion, quantity, now - half, now + half, mean);
}

void sensor_chip_low_passed(const struct sensor_chip *chip, enum chip_quantity quantity,
                            struct lowpass lowpass, double period_ns, double mean[3]) {
    if (chip->motion.source.is_recorded) {
        sensor_chip_recorded(chip, quantity, period_ns, mean);
        return;
    }
    const int64_t now = (int64_t)chip->wire.now_ns;
    const int64_t half = (int64_t)llround(0.5 * 0.443e9 / lowpass.bandwidth_hz);
    int64_t delay = (int64_t)llround(lowpass.delay_ms * 1e6);
    if (delay < half) {
        delay = half;
    }
    chip_motion_mean(&chip->motion, quantity, now - delay - half, now - delay + half,
                     mean);
}
