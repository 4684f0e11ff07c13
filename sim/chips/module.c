// SPDX-License-Identifier: MIT
// See module.h.
#include "module.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lis3mdl.h"
#include "lsm6dsox.h"
#include "mpu9250.h"

enum { DIE_IMU = 1, DIE_MAG };

// An MPU-9250 alone, or the pair: the LSM6DSOX, then the LIS3MDL.
struct module {
    struct sensor_chip *chips[I2C_BUS_SLAVES_MAX];
    struct i2c_bus bus;
};

// The inertial chips of the pair: their names, and what WHO_AM_I answers.
static const struct pair {
    const char *name;
    uint8_t who_am_i;
    struct lsm6dsox_chip_config (*defaults)(void);
} pairs[] = {
    {"lsm6dsox", 0x6C, lsm6dsox_chip_defaults},  // DS table 41; AD: LSM6DSOX_CHIP_ID
    // AD: ISM330DHCX_CHIP_ID; LX: st_lsm6dsx_sensor_settings
    {"ism330dhcx", 0x6B, lsm6dsox_chip_defaults},
    {"lsm6dsv16x", 0x70, lsm6dsv16x_chip_defaults},  // ST's lsm6dsv_reg.h
};

enum { PAIRS = sizeof pairs / sizeof pairs[0] };

static const struct pair *pair_of(const char *name) {
    for (int i = 0; name != NULL && i < PAIRS; i++) {
        if (strcmp(name, pairs[i].name) == 0) {
            return &pairs[i];
        }
    }
    return NULL;
}

const char *module_misnamed(const char *name) {
    static char words[80];
    if (name == NULL || strcmp(name, "mpu9250") == 0 || pair_of(name) != NULL) {
        return NULL;
    }
    (void)snprintf(words, sizeof words, "--sensor is one of mpu9250");
    for (int i = 0; i < PAIRS; i++) {
        const size_t length = strlen(words);
        (void)snprintf(words + length, sizeof words - length, ", %s", pairs[i].name);
    }
    return words;
}

static void configure(struct sensor_chip_config *sensor,
                      const struct module_config *config) {
    sensor->motion = config->motion;
    sensor->startup_ns = config->starts_at_once ? 0 : sensor->startup_ns;
}

static void add(struct module *module, struct sensor_chip *chip) {
    if (chip != NULL) {
        module->chips[module->bus.count] = chip;
        module->bus.slaves[module->bus.count] = sensor_chip_wire(chip);
        module->bus.count++;
    }
}

struct module *module_new(const struct module_config *config) {
    struct module *module =
        module_misnamed(config->name) == NULL ? calloc(1, sizeof *module) : NULL;
    if (module == NULL) {
        return NULL;
    }
    const struct pair *pair = pair_of(config->name);
    const unsigned count = pair != NULL ? 2 : 1;
    if (pair != NULL) {
        struct lsm6dsox_chip_config imu = pair->defaults();
        imu.who_am_i = pair->who_am_i;
        struct lis3mdl_chip_config mag = lis3mdl_chip_defaults();
        configure(&imu.sensor, config);
        configure(&mag.sensor, config);
        add(module, lsm6dsox_chip_new(&imu));
        add(module, lis3mdl_chip_new(&mag));
    } else {
        struct mpu9250_chip_config own = mpu9250_chip_defaults();
        configure(&own.sensor, config);
        add(module, mpu9250_chip_new(&own));
    }
    if (module->bus.count < count) {
        module_free(module);
        return NULL;
    }
    return module;
}

void module_free(struct module *module) {
    for (unsigned i = 0; module != NULL && i < module->bus.count; i++) {
        sensor_chip_free(module->chips[i]);
    }
    free(module);
}

void module_power_cycle(struct module *module, uint64_t now_ns) {
    for (unsigned i = 0; i < module->bus.count; i++) {
        sensor_chip_power_cycle(module->chips[i], now_ns);
    }
}

void module_advance(struct module *module, uint64_t now_ns) {
    for (unsigned i = 0; i < module->bus.count; i++) {
        sensor_chip_advance(module->chips[i], now_ns);
    }
}

uint64_t module_next_event(const struct module *module) {
    uint64_t next = UINT64_MAX;
    for (unsigned i = 0; i < module->bus.count; i++) {
        const uint64_t own = sensor_chip_next_event(module->chips[i]);
        next = own < next ? own : next;
    }
    return next;
}

bool module_pin_is_high(const struct module *module) {
    return sensor_chip_pin_is_high(module->chips[0], 0);
}

struct i2c_bus *module_bus(struct module *module) {
    return &module->bus;
}

bool module_add_fault(struct module *module, const struct chip_fault *fault) {
    if (module->bus.count == 1) {
        return i2c_slave_add_fault(module->bus.slaves[0], fault);
    }
    struct chip_fault own = *fault;
    own.die = 0;
    bool is_of_imu = fault->die != DIE_MAG;
    bool is_of_mag = fault->die != DIE_IMU;
    switch (fault->kind) {
    case CHIP_FAULT_NO_MAG:
        is_of_imu = false;
        is_of_mag = true;
        break;
    case CHIP_FAULT_GYR_SELF_TEST:
    case CHIP_FAULT_ACC_SELF_TEST:
        is_of_imu = true;
        is_of_mag = false;
        break;
    case CHIP_FAULT_STUCK_SDA:
        is_of_mag = !is_of_imu;
        break;
    default:
        break;
    }
    return (!is_of_imu || i2c_slave_add_fault(module->bus.slaves[0], &own)) &&
           (!is_of_mag || i2c_slave_add_fault(module->bus.slaves[1], &own));
}

uint64_t module_transactions(const struct module *module) {
    return sensor_chip_transactions(module->chips[0]);
}

const char *module_complaint(const struct module *module) {
    const char *complaint = NULL;
    for (unsigned i = 0; complaint == NULL && i < module->bus.count; i++) {
        complaint = sensor_chip_complaint(module->chips[i]);
    }
    return complaint;
}
