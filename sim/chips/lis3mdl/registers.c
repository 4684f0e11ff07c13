// SPDX-License-Identifier: MIT
// What reading and writing the registers does.
#include "chip.h"

#include <stddef.h>

// A register that the host may write: bits that are none and must stay 0, and bits that
// turn something on that is not modelled.
struct rule {
    uint8_t reg;
    uint8_t reserved;
    uint8_t unmodelled;
};

// DS 7.
static const struct rule rules[] = {
    {REG_CTRL1, 0x00, 0x00},     {REG_CTRL2, 0x93, 0x00},
    {REG_CTRL3, 0xD8, 0x04},                               // SPI
    {REG_CTRL4, 0xF1, 0x00},     {REG_CTRL5, 0x3F, 0x80},  // FAST_READ
    {REG_INT_CFG, 0x10, 0x01},                             // the interrupt
    {REG_INT_THS_L, 0x00, 0x00}, {REG_INT_THS_H, 0x80, 0x00},
};

static const struct rule offset_rule = {0, 0x00, 0x00};

static void step(struct lis3mdl_chip *chip) {
    if (chip->moves_on) {
        chip->pointer = (chip->pointer + 1) & (REG_COUNT - 1);
    }
}

uint8_t lis3mdl_chip_read_register(struct lis3mdl_chip *chip) {
    const uint8_t at = chip->pointer;
    uint8_t value = chip->reg[at];
    if (at == REG_WHO_AM_I) {
        const struct chip_fault *fault =
            i2c_slave_find_fault(&chip->wire, CHIP_FAULT_WRONG_WHO_AM_I, DIE);
        value = fault != NULL ? fault->value : value;
    } else if (at >= REG_OUT_X_L && at <= REG_OUT_Z_H) {
        lis3mdl_chip_release(chip, at - REG_OUT_X_L);
    }
    step(chip);
    return value;
}

static void wrote(struct lis3mdl_chip *chip, uint8_t at, uint8_t old) {
    const uint8_t value = chip->reg[at];
    const uint8_t changed = old ^ value;
    const bool is_single = (chip->reg[REG_CTRL3] & MD_MASK) == MD_SINGLE;
    switch (at) {
    case REG_CTRL1:
        if (changed & (uint8_t) ~(TEMP_EN | ST)) {
            lis3mdl_chip_restart_clock(chip);
        }
        break;
    case REG_CTRL2:
        if (value & (SOFT_RST | REBOOT)) {
            const uint64_t takes_ns =
                value & SOFT_RST ? chip->config.soft_reset_ns : chip->config.startup_ns;
            chip->wait_end = chip->wire.now_ns + takes_ns;
            lis3mdl_chip_restart_clock(chip);
        }
        break;
    case REG_CTRL3:
        if (changed || is_single) {
            lis3mdl_chip_restart_clock(chip);
        }
        break;
    case REG_CTRL5:
        if (changed & BDU) {
            lis3mdl_chip_release_all(chip);
        }
        break;
    case REG_INT_CFG:
        if (!(value & INT_CFG_ONE)) {  // AD; DS table 36
            lis3mdl_chip_complain(chip, "LIS3MDL: a bit cleared that must be 1");
        }
        break;
    default:
        break;
    }
    // DS CTRL_REG3, memory: single measurements go with 0.625 to 80 Hz.
    if (is_single && (chip->reg[REG_CTRL1] & FAST_ODR)) {
        lis3mdl_chip_complain(chip, "LIS3MDL: a single measurement with FAST_ODR");
    }
}

static const struct rule *find_rule(uint8_t reg) {
    if (reg >= REG_OFFSET_X_L && reg <= REG_OFFSET_Z_H) {
        return &offset_rule;
    }
    for (size_t i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        if (rules[i].reg == reg) {
            return &rules[i];
        }
    }
    return NULL;
}

void lis3mdl_chip_write_register(struct lis3mdl_chip *chip, uint8_t value) {
    const uint8_t at = chip->pointer;
    const struct rule *rule = find_rule(at);
    if (chip->wait_end != NEVER) {  // the documents don't define this
        lis3mdl_chip_complain(chip, "LIS3MDL: a register written during a reset");
    }
    if (rule == NULL) {
        lis3mdl_chip_complain(
            chip, "LIS3MDL: a register written that is reserved or read-only");
    } else {
        if (value & rule->reserved) {
            lis3mdl_chip_complain(chip, "LIS3MDL: a reserved bit set");
        }
        if (value & rule->unmodelled) {
            lis3mdl_chip_complain(chip,
                                  "LIS3MDL: something turned on that is not modelled");
        }
        const uint8_t old = chip->reg[at];
        chip->reg[at] = value & (uint8_t)~rule->reserved;
        wrote(chip, at, old);
    }
    step(chip);
}
