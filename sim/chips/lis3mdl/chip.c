// SPDX-License-Identifier: MIT
// The model's life, its time, its pin and its place on the wire.
#include "chip.h"

#include <stdlib.h>
#include <string.h>

#define MS UINT64_C(1000000)  // in nanoseconds
#define US UINT64_C(1000)

void lis3mdl_chip_complain(struct lis3mdl_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

// The wire

static void advance(void *chip, uint64_t now_ns) {
    lis3mdl_chip_advance(chip, now_ns);
}

static uint8_t find_die(void *self, uint8_t address) {
    const struct lis3mdl_chip *chip = self;
    // DS 5.1: 00111x0, x being SA1.
    return address == (chip->config.sa1 ? 0x1E : 0x1C) &&
                   i2c_slave_find_fault(&chip->wire, CHIP_FAULT_NO_MAG, DIE) == NULL
               ? DIE
               : I2C_SLAVE_NOBODY;
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    struct lis3mdl_chip *chip = self;
    (void)die;
    chip->pointer = byte & (REG_COUNT - 1);
    chip->moves_on = (byte & 0x80) != 0;  // DS 5.1.1
}

static void write_byte(void *chip, uint8_t die, uint8_t byte) {
    (void)die;
    lis3mdl_chip_write_register(chip, byte);
}

static uint8_t read_byte(void *chip, uint8_t die) {
    (void)die;
    return lis3mdl_chip_read_register(chip);
}

static const struct i2c_slave_chip wire_ops = {
    .advance = advance,
    .find_die = find_die,
    .set_pointer = set_pointer,
    .write = write_byte,
    .read = read_byte,
};

struct i2c_slave *lis3mdl_chip_wire(struct lis3mdl_chip *chip) {
    return &chip->wire;
}

// Life

struct lis3mdl_chip_config lis3mdl_chip_defaults(void) {
    return (struct lis3mdl_chip_config){
        .temperature_c = 25.0,
        .startup_ns = 10 * MS,      // no document says; AD waits as long after a reset
        .soft_reset_ns = 100 * US,  // no document says
        .who_am_i = 0x3D,           // LX, AD
        .int_cfg = 0xE8,            // DS table 16, memory
        .axes = {1, 2, 3},
        // AN: 1 to 3 gauss in X and Y, 0.1 to 1 in Z.
        .self_test_ut = {200.0, 200.0, 50.0},
    };
}

struct lis3mdl_chip *lis3mdl_chip_new(const struct lis3mdl_chip_config *config) {
    struct lis3mdl_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    chip->wire = (struct i2c_slave){.ops = &wire_ops, .chip = chip};
    chip->motion = chip_motion_from(config->motion, config->context);
    lis3mdl_chip_power_cycle(chip, 0);
    return chip;
}

void lis3mdl_chip_free(struct lis3mdl_chip *chip) {
    free(chip);
}

// DS table 16: the column of reset values; others are 0.
static void reset(struct lis3mdl_chip *chip) {
    memset(chip->reg, 0, sizeof chip->reg);
    chip->reg[REG_WHO_AM_I] = chip->config.who_am_i;
    chip->reg[REG_CTRL1] = 0x10;
    chip->reg[REG_CTRL3] = MD_POWER_DOWN;
    chip->reg[REG_INT_CFG] = chip->config.int_cfg;
    chip->half_read = 0;
    chip->waiting = 0;
    chip->wait_end = NEVER;
    lis3mdl_chip_restart_clock(chip);
}

void lis3mdl_chip_power_cycle(struct lis3mdl_chip *chip, uint64_t now_ns) {
    chip->wire.now_ns = now_ns;
    chip->wire.answers_ns = now_ns + chip->config.startup_ns;
    chip->wire.is_transfer = false;
    i2c_slave_release(&chip->wire);
    chip->pointer = 0;
    chip->moves_on = false;
    chip->samples = 0;
    memset(chip->latest, 0, sizeof chip->latest);
    reset(chip);
}

void lis3mdl_chip_hold(struct lis3mdl_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]) {
    chip_motion_hold(&chip->motion, gyr_rad_s, acc_m_s2, mag_ut);
}

void lis3mdl_chip_set_temperature(struct lis3mdl_chip *chip, double temperature_c) {
    chip->config.temperature_c = temperature_c;
}

// Time

uint64_t lis3mdl_chip_next_event(const struct lis3mdl_chip *chip) {
    return chip->tick_ns < chip->wait_end ? chip->tick_ns : chip->wait_end;
}

// A reset ends with reset values, a reboot with its bit back at 0.
static void end_wait(struct lis3mdl_chip *chip) {
    chip->wait_end = NEVER;
    if (chip->reg[REG_CTRL2] & SOFT_RST) {
        reset(chip);
    } else {
        chip->reg[REG_CTRL2] &= (uint8_t)~REBOOT;
        lis3mdl_chip_restart_clock(chip);
    }
}

// What happens to the chip once.
static void suffer(struct lis3mdl_chip *chip) {
    const struct chip_fault *fault =
        i2c_slave_next_fault(&chip->wire, CHIP_FAULT_REGISTER_FLIP);
    if (fault != NULL) {
        chip->reg[fault->reg & (REG_COUNT - 1)] = fault->value;
        lis3mdl_chip_restart_clock(chip);
    }
    if (i2c_slave_next_fault(&chip->wire, CHIP_FAULT_BROWN_OUT) != NULL) {
        lis3mdl_chip_power_cycle(chip, chip->wire.now_ns);
    }
}

void lis3mdl_chip_advance(struct lis3mdl_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = lis3mdl_chip_next_event(chip);
        if (next > now_ns || next == NEVER) {
            break;
        }
        chip->wire.now_ns = next;
        if (chip->tick_ns == next) {
            lis3mdl_chip_take_sample(chip);
        } else {
            end_wait(chip);
        }
        suffer(chip);
    }
    if (now_ns > chip->wire.now_ns) {
        chip->wire.now_ns = now_ns;
    }
    suffer(chip);
}

bool lis3mdl_chip_drdy_is_high(const struct lis3mdl_chip *chip) {
    return (chip->reg[REG_STATUS] & DATA_ALL) != 0;
}

// For tests

uint8_t lis3mdl_chip_peek(const struct lis3mdl_chip *chip, uint8_t reg) {
    return chip->reg[reg & (REG_COUNT - 1)];
}

uint64_t lis3mdl_chip_transactions(const struct lis3mdl_chip *chip) {
    return chip->wire.transactions;
}

uint64_t lis3mdl_chip_samples(const struct lis3mdl_chip *chip) {
    return chip->samples;
}

const char *lis3mdl_chip_complaint(const struct lis3mdl_chip *chip) {
    return chip->complaint;
}
