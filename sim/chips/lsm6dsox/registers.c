// SPDX-License-Identifier: MIT
// What reading and writing the registers does.
#include "chip.h"

// DS 9; what the LSM6DSO and LSM6DSOX have and the LSM6DSO32 has not (OIS,
// ROUNDING_STATUS, XL_FS_MODE) is not modelled.
static const struct st_rule rules[] = {
    {REG_FUNC_CFG_ACCESS, 0x3F, 0xC0},
    {REG_PIN_CTRL, 0x00, 0x00},
    {REG_FIFO_CTRL1, 0x00, 0x00},
    {REG_FIFO_CTRL2, 0x28, 0x00},
    {REG_FIFO_CTRL3, 0x00, 0xFF},
    {REG_FIFO_CTRL4, 0x08, 0xF7},
    {REG_COUNTER_BDR_REG1, 0x18, 0x67},
    {REG_COUNTER_BDR_REG2, 0x00, 0xFF},
    {REG_INT1_CTRL, 0x00, 0xF8},
    {REG_INT2_CTRL, 0x80, 0x78},
    {REG_CTRL1_XL, 0x01, 0x00},
    {REG_CTRL2_G, 0x01, 0x00},  // but for an ISM330DHCX
    {REG_CTRL3_C, 0x02, 0x08},  // SPI
    {REG_CTRL4_C, 0x91, 0x00},
    {REG_CTRL5_C, 0x00, 0xF0},   // ultra-low power, circular bursts
    {REG_CTRL6_C, 0x00, 0xE0},   // DEN
    {REG_CTRL7_G, 0x08, 0x45},   // high-pass, OIS
    {REG_CTRL8_XL, 0x00, 0x1E},  // high-pass, fast settling, the other ranges
    {REG_CTRL9_XL, 0x01, 0x1C},  // DEN
    {REG_CTRL10_C, 0xDF, 0x20},  // timestamps
    {REG_TAP_CFG0, 0x80, 0x3E},
    {REG_TAP_CFG1, 0x00, 0x00},
    {REG_TAP_CFG2, 0x00, 0xE0},
    {REG_TAP_THS_6D, 0x00, 0x00},
    {REG_INT_DUR2, 0x00, 0x00},
    {REG_WAKE_UP_THS, 0x00, 0x00},
    {REG_WAKE_UP_DUR, 0x00, 0x00},
    {REG_FREE_FALL, 0x00, 0x00},
    {REG_MD1_CFG, 0x00, 0xFF},
    {REG_MD2_CFG, 0x00, 0xFF},
    {REG_I3C_BUS_AVB, 0xE6, 0x00},
    {REG_X_OFS_USR, 0x00, 0x00},
    {REG_Y_OFS_USR, 0x00, 0x00},
    {REG_Z_OFS_USR, 0x00, 0x00},
};

// DS 9.2: bits that must be 1.
enum { PIN_CTRL_ONES = 0x3F };

// DS table 50: IF_INC.
static void step(struct lsm6dsox_chip *chip) {
    chip->die.moves_on = (chip->die.reg[REG_CTRL3_C] & IF_INC) != 0;
    st_step(&chip->die);
}

uint8_t lsm6dsox_chip_read(void *self, uint8_t die) {
    struct lsm6dsox_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    uint8_t value = chip->die.reg[at];
    if (at == REG_WHO_AM_I) {
        value = sensor_chip_identity(&chip->base, die, value);
    } else if (at >= REG_OUT_TEMP_L && at <= REG_OUTZ_H_A) {
        lsm6dsox_chip_release(chip, at);
    }
    step(chip);
    return value;
}

static void begin_reset(struct lsm6dsox_chip *chip) {
    chip->is_i3c_only = lsm6dsox_chip_pin_is_high(chip, LSM6DSOX_CHIP_INT1);
    if (chip->is_i3c_only) {
        sensor_chip_complain(&chip->base, "a reset while INT1 is high");
    }
    chip->reset_end = chip->base.wire.now_ns + chip->config.reset_ns;
}

static void wrote_ctrl3(struct lsm6dsox_chip *chip, uint8_t changed, uint8_t value) {
    if (changed & BDU) {
        lsm6dsox_chip_release_all(chip);
    }
    if ((value & BOOT) && (value & SW_RESET)) {
        sensor_chip_complain(&chip->base, "BOOT and SW_RESET at once");
    }
    if (value & SW_RESET) {
        begin_reset(chip);
    } else if (value & BOOT) {
        chip->die.wait_end = chip->base.wire.now_ns + chip->config.boot_ns;
    }
}

static void check(struct lsm6dsox_chip *chip) {
    const uint8_t *reg = chip->die.reg;
    const uint8_t acc = reg[REG_CTRL1_XL] >> ODR_SHIFT;
    const uint8_t gyr = reg[REG_CTRL2_G] >> ODR_SHIFT;
    if (acc > ODR_1_6_HZ || gyr > ODR_LAST) {  // DS tables 44, 48
        sensor_chip_complain(&chip->base, "a data rate that is not allowed");
    }
    if (((reg[REG_CTRL5_C] >> ST_G_SHIFT) & ST_MASK) == 2 ||
        (reg[REG_CTRL5_C] & ST_MASK) == 3) {  // DS tables 55, 56
        sensor_chip_complain(&chip->base, "a self-test that is not allowed");
    }
    if ((reg[REG_PIN_CTRL] & PIN_CTRL_ONES) != PIN_CTRL_ONES) {
        sensor_chip_complain(&chip->base, "a bit cleared that must be 1");
    }
}

static void wrote(struct lsm6dsox_chip *chip, uint8_t at, uint8_t old) {
    const uint8_t value = chip->die.reg[at];
    check(chip);
    if (at == REG_CTRL2_G && (old >> ODR_SHIFT) == ODR_OFF) {
        chip->gyr_on_ns = chip->base.wire.now_ns;
    }
    if (at == REG_CTRL3_C) {
        wrote_ctrl3(chip, old ^ value, value);
    } else if (at == REG_CTRL4_C && (value & I2C_DISABLE)) {
        sensor_chip_complain(&chip->base, "I2C turned off");
        i2c_slave_release(&chip->base.wire);
    }
    lsm6dsox_chip_set_rates(chip);
}

void lsm6dsox_chip_write(void *self, uint8_t die, uint8_t value) {
    struct lsm6dsox_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    const uint8_t old = chip->die.reg[at];
    const struct st_rule *rule =
        st_find_rule(rules, sizeof rules / sizeof rules[0], at);
    static const struct st_rule with_4000_dps = {REG_CTRL2_G, 0x00, 0x00};
    if (at == REG_CTRL2_G && chip->config.has_4000_dps) {
        rule = &with_4000_dps;
    }
    (void)die;
    if (chip->reset_end != NEVER) {
        sensor_chip_complain(&chip->base, "a register written during a reset");
    }
    // DS 10: what is no register may damage it permanently.
    if (st_write(&chip->base, &chip->die, rule, "reset", value)) {
        wrote(chip, at, old);
    }
    step(chip);
}
