// SPDX-License-Identifier: MIT
// The model's life, its time and its place on the wire.
#include "chip.h"

#include <stdlib.h>
#include <string.h>

void mpu9250_chip_complain(struct mpu9250_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

bool mpu9250_chip_has_ak8963(const struct mpu9250_chip *chip) {
    return chip->config.has_ak8963 &&
           i2c_slave_find_fault(&chip->wire, CHIP_FAULT_NO_MAG, 0) == NULL;
}

void mpu9250_chip_reset(struct mpu9250_chip *chip) {
    const struct mpu9250_chip_config *config = &chip->config;
    mpu9250_chip_cut_aux(chip);
    memset(chip->reg, 0, sizeof chip->reg);
    memset(chip->inner, 0, sizeof chip->inner);
    memset(&chip->aux, 0, sizeof chip->aux);
    memcpy(&chip->reg[REG_SELF_TEST_X_GYRO], config->gyr_self_test, 3);
    memcpy(&chip->reg[REG_SELF_TEST_X_ACCEL], config->acc_self_test, 3);
    chip->reg[REG_PWR_MGMT_1] = 0x01;  // RM 3, the note under table 1
    chip->reg[REG_WHO_AM_I] = config->who_am_i;
    chip->aux.slave = 5;
    chip->aux.byte_ns = NEVER;
    chip->wire.answers_ns = chip->wire.now_ns + config->startup_ns;
    chip->awake_ns = chip->wire.now_ns;
    chip->is_asleep = false;
    chip->int_level = false;
    chip->int_end_ns = NEVER;
    chip->waits_for_aux = false;
    i2c_slave_release(&chip->wire);
    mpu9250_chip_restart_clock(chip);
}

// The wire

static void advance(void *chip, uint64_t now_ns) {
    mpu9250_chip_advance(chip, now_ns);
}

static uint8_t find_die(void *self, uint8_t address) {
    const struct mpu9250_chip *chip = self;
    if (address == (chip->config.ad0 ? 0x69 : 0x68)) {
        return DIE_MPU;
    }
    return address == AK_ADDRESS && mpu9250_chip_is_bypass(chip) &&
                   mpu9250_chip_has_ak8963(chip)
               ? DIE_AK
               : I2C_SLAVE_NOBODY;
}

// RM 4.19, 4.33.
bool mpu9250_chip_is_bypass(const struct mpu9250_chip *chip) {
    return (chip->reg[REG_INT_PIN_CFG] & INT_BYPASS_EN) != 0 &&
           (chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) == 0;
}

static bool holds_sda(void *self) {
    const struct mpu9250_chip *chip = self;
    return chip->aux_bus.is_held && mpu9250_chip_is_bypass(chip);
}

static void clock_scl(void *self) {
    struct mpu9250_chip *chip = self;
    if (holds_sda(chip) && chip->aux_bus.clocks > 0) {
        chip->aux_bus.clocks--;
        chip->aux_bus.is_held = chip->aux_bus.clocks > 0;
    }
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    struct mpu9250_chip *chip = self;
    if (die == DIE_MPU) {
        chip->pointer = byte & (REG_COUNT - 1);
    } else {
        chip->ak.pointer = byte;
    }
}

static void write_byte(void *chip, uint8_t die, uint8_t byte) {
    if (die == DIE_MPU) {
        mpu9250_chip_write_register(chip, byte);
    } else {
        mpu9250_chip_write_ak8963(chip, byte);
    }
}

static uint8_t read_byte(void *chip, uint8_t die) {
    return die == DIE_MPU ? mpu9250_chip_read_register(chip)
                          : mpu9250_chip_read_ak8963(chip);
}

static void show(void *chip) {
    mpu9250_chip_show(chip);
}

static const struct i2c_slave_chip wire_ops = {
    .advance = advance,
    .find_die = find_die,
    .set_pointer = set_pointer,
    .write = write_byte,
    .read = read_byte,
    .idle = show,
    .holds_sda = holds_sda,
    .clock = clock_scl,
};

struct i2c_slave *mpu9250_chip_wire(struct mpu9250_chip *chip) {
    return &chip->wire;
}

// Life

struct mpu9250_chip_config mpu9250_chip_defaults(void) {
    return (struct mpu9250_chip_config){
        .temperature_c = 25.0,
        .startup_ns = 100 * MS,
        .who_am_i = 0x71,
        .has_ak8963 = true,
        .mag_adjust = {176, 178, 166},
        // Responses of 145, 154 and 137 deg/s and of 0.42, 0.45 and 0.52 g.
        .gyr_self_test = {200, 206, 194},
        .acc_self_test = {98, 105, 120},
    };
}

struct mpu9250_chip *mpu9250_chip_new(const struct mpu9250_chip_config *config) {
    struct mpu9250_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    chip->wire = (struct i2c_slave){.ops = &wire_ops, .chip = chip};
    chip->motion = chip_motion_from(config->motion, config->context);
    mpu9250_chip_power_cycle(chip, 0);
    return chip;
}

void mpu9250_chip_free(struct mpu9250_chip *chip) {
    free(chip);
}

void mpu9250_chip_power_cycle(struct mpu9250_chip *chip, uint64_t now_ns) {
    chip->wire.now_ns = now_ns;
    chip->wire.is_transfer = false;
    chip->pointer = 0;
    mpu9250_chip_reset_ak8963(chip);
    mpu9250_chip_reset(chip);
    chip->aux_bus = (struct aux_bus){0};
}

void mpu9250_chip_hold(struct mpu9250_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]) {
    chip_motion_hold(&chip->motion, gyr_rad_s, acc_m_s2, mag_ut);
}

void mpu9250_chip_set_temperature(struct mpu9250_chip *chip, double temperature_c) {
    chip->config.temperature_c = temperature_c;
}

// Time

uint64_t mpu9250_chip_next_event(const struct mpu9250_chip *chip) {
    uint64_t next = chip->tick_ns;
    if (chip->aux.byte_ns < next) {
        next = chip->aux.byte_ns;
    }
    if (chip->ak.measured_ns < next) {
        next = chip->ak.measured_ns;
    }
    if (chip->int_end_ns < next) {
        next = chip->int_end_ns;
    }
    return next;
}

// What happens to the chip once.
static void suffer(struct mpu9250_chip *chip) {
    const struct chip_fault *fault =
        i2c_slave_next_fault(&chip->wire, CHIP_FAULT_REGISTER_FLIP);
    if (fault != NULL) {
        chip->reg[fault->reg & (REG_COUNT - 1)] = fault->value;
        mpu9250_chip_set_next_tick(chip);
    }
    fault = i2c_slave_next_fault(&chip->wire, CHIP_FAULT_MAG_HUNG);
    if (fault != NULL) {
        chip->aux_bus = (struct aux_bus){true, fault->clocks};
    }
    if (i2c_slave_next_fault(&chip->wire, CHIP_FAULT_BROWN_OUT) != NULL) {
        mpu9250_chip_power_cycle(chip, chip->wire.now_ns);
    }
}

void mpu9250_chip_advance(struct mpu9250_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = mpu9250_chip_next_event(chip);
        if (next > now_ns) {
            break;
        }
        chip->wire.now_ns = next;
        if (chip->int_end_ns == next) {
            chip->int_end_ns = NEVER;
            chip->int_level = false;
        } else if (chip->ak.measured_ns == next) {
            mpu9250_chip_end_measurement(chip);
        } else if (chip->aux.byte_ns == next) {
            mpu9250_chip_move_aux_byte(chip);
        } else {
            mpu9250_chip_take_sample(chip);
        }
        suffer(chip);
    }
    if (now_ns > chip->wire.now_ns) {
        chip->wire.now_ns = now_ns;
    }
    suffer(chip);
}

bool mpu9250_chip_int_is_high(const struct mpu9250_chip *chip) {
    const bool is_active_low = (chip->reg[REG_INT_PIN_CFG] & INT_ACTL) != 0;
    return chip->int_level != is_active_low;
}

// For tests

uint8_t mpu9250_chip_peek(const struct mpu9250_chip *chip, uint8_t reg) {
    const uint8_t at = reg & (REG_COUNT - 1);
    return at >= REG_ACCEL_XOUT_H && at <= REG_EXT_SENS_DATA_23 ? chip->inner[at]
                                                                : chip->reg[at];
}

uint8_t mpu9250_chip_peek_ak8963(const struct mpu9250_chip *chip, uint8_t reg) {
    return reg < AK_COUNT ? chip->ak.reg[reg] : 0;
}

uint64_t mpu9250_chip_transactions(const struct mpu9250_chip *chip) {
    return chip->wire.transactions;
}

uint64_t mpu9250_chip_samples(const struct mpu9250_chip *chip) {
    return chip->samples;
}

const char *mpu9250_chip_complaint(const struct mpu9250_chip *chip) {
    return chip->complaint;
}
