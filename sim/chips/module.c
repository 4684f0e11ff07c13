// SPDX-License-Identifier: MIT
// See module.h.
#include "module.h"

#include <stdlib.h>
#include <string.h>

#include "lis3mdl.h"
#include "lsm6dsox.h"
#include "mpu9250.h"

enum { DIE_IMU = 1, DIE_MAG };

// Either an MPU-9250, or the pair.
struct module {
    struct mpu9250_chip *mpu9250;
    struct lsm6dsox_chip *imu;
    struct lis3mdl_chip *mag;
    struct i2c_bus bus;
};

static bool is_pair(const char *name) {
    return name != NULL && strcmp(name, "lsm6dsox") == 0;
}

bool module_is_known(const char *name) {
    return name == NULL || strcmp(name, "mpu9250") == 0 || is_pair(name);
}

static bool make_mpu9250(struct module *module, const struct module_config *config) {
    struct mpu9250_chip_config own = mpu9250_chip_defaults();
    own.motion = config->motion;
    own.context = config->context;
    own.is_recorded = config->is_recorded;
    own.startup_ns = config->starts_at_once ? 0 : own.startup_ns;
    module->mpu9250 = mpu9250_chip_new(&own);
    if (module->mpu9250 == NULL) {
        return false;
    }
    module->bus = (struct i2c_bus){{mpu9250_chip_wire(module->mpu9250)}, 1};
    return true;
}

static bool make_pair(struct module *module, const struct module_config *config) {
    struct lsm6dsox_chip_config imu = lsm6dsox_chip_defaults();
    imu.motion = config->motion;
    imu.context = config->context;
    imu.is_recorded = config->is_recorded;
    imu.startup_ns = config->starts_at_once ? 0 : imu.startup_ns;
    struct lis3mdl_chip_config mag = lis3mdl_chip_defaults();
    mag.motion = config->motion;
    mag.context = config->context;
    mag.startup_ns = config->starts_at_once ? 0 : mag.startup_ns;
    module->imu = lsm6dsox_chip_new(&imu);
    module->mag = lis3mdl_chip_new(&mag);
    if (module->imu == NULL || module->mag == NULL) {
        return false;
    }
    module->bus = (struct i2c_bus){
        {lsm6dsox_chip_wire(module->imu), lis3mdl_chip_wire(module->mag)}, 2};
    return true;
}

struct module *module_new(const struct module_config *config) {
    struct module *module =
        module_is_known(config->name) ? calloc(1, sizeof *module) : NULL;
    if (module == NULL) {
        return NULL;
    }
    const bool is_made = is_pair(config->name) ? make_pair(module, config)
                                               : make_mpu9250(module, config);
    if (!is_made) {
        module_free(module);
        return NULL;
    }
    return module;
}

void module_free(struct module *module) {
    if (module == NULL) {
        return;
    }
    mpu9250_chip_free(module->mpu9250);
    lsm6dsox_chip_free(module->imu);
    lis3mdl_chip_free(module->mag);
    free(module);
}

void module_power_cycle(struct module *module, uint64_t now_ns) {
    if (module->mpu9250 != NULL) {
        mpu9250_chip_power_cycle(module->mpu9250, now_ns);
    } else {
        lsm6dsox_chip_power_cycle(module->imu, now_ns);
        lis3mdl_chip_power_cycle(module->mag, now_ns);
    }
}

void module_advance(struct module *module, uint64_t now_ns) {
    if (module->mpu9250 != NULL) {
        mpu9250_chip_advance(module->mpu9250, now_ns);
    } else {
        lsm6dsox_chip_advance(module->imu, now_ns);
        lis3mdl_chip_advance(module->mag, now_ns);
    }
}

uint64_t module_next_event(const struct module *module) {
    if (module->mpu9250 != NULL) {
        return mpu9250_chip_next_event(module->mpu9250);
    }
    const uint64_t imu = lsm6dsox_chip_next_event(module->imu);
    const uint64_t mag = lis3mdl_chip_next_event(module->mag);
    return imu < mag ? imu : mag;
}

bool module_pin_is_high(const struct module *module) {
    return module->mpu9250 != NULL
               ? mpu9250_chip_int_is_high(module->mpu9250)
               : lsm6dsox_chip_pin_is_high(module->imu, LSM6DSOX_CHIP_INT1);
}

struct i2c_bus *module_bus(struct module *module) {
    return &module->bus;
}

bool module_add_fault(struct module *module, const struct chip_fault *fault) {
    if (module->mpu9250 != NULL) {
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
    return module->mpu9250 != NULL ? mpu9250_chip_transactions(module->mpu9250)
                                   : lsm6dsox_chip_transactions(module->imu);
}

const char *module_complaint(const struct module *module) {
    if (module->mpu9250 != NULL) {
        return mpu9250_chip_complaint(module->mpu9250);
    }
    const char *imu = lsm6dsox_chip_complaint(module->imu);
    return imu != NULL ? imu : lis3mdl_chip_complaint(module->mag);
}
