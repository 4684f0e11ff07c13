// SPDX-License-Identifier: MIT
// What reading and writing the registers of both dies does.
#include "chip.h"

#include <stddef.h>

// A register that the host may write: bits that are none and must stay 0, and bits that
// turn something on that is not modelled.
struct rule {
    uint8_t reg;
    uint8_t reserved;
    uint8_t unmodelled;
};

static const struct rule rules_g[] = {
    {REG_CTRL1_G, 0x00, 0x00},       {REG_CTRL2_G, 0xC0, 0x00},
    {REG_CTRL3_G, 0x00, 0xC7},  // INT_G, and a FIFO's flags
    {REG_CTRL4_G, 0x08, 0x01},  // SPI
    {REG_CTRL5_G, 0x20, 0x51},  // FIFO_EN, HPen, Out_Sel but LPF2
    {REG_REFERENCE_G, 0x00, 0x00},   {REG_FIFO_CTRL_G, 0x00, 0xE0},
    {REG_INT1_CFG_G, 0x00, 0xFF},    {REG_INT1_THS_XH_G, 0x80, 0x00},
    {REG_INT1_THS_XL_G, 0x00, 0x00}, {REG_INT1_THS_YH_G, 0x80, 0x00},
    {REG_INT1_THS_YL_G, 0x00, 0x00}, {REG_INT1_THS_ZH_G, 0x80, 0x00},
    {REG_INT1_THS_ZL_G, 0x00, 0x00}, {REG_INT1_DURATION_G, 0x00, 0x00},
};

static const struct rule rules_xm[] = {
    {REG_INT_CTRL_M, 0x00, 0x01},  // MIEN
    {REG_INT_THS_L_M, 0x00, 0x00},
    {REG_INT_THS_H_M, 0x80, 0x00},
    {REG_OFFSET_X_L_M, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 1, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 2, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 3, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 4, 0x00, 0xFF},
    {REG_OFFSET_Z_H_M, 0x00, 0xFF},
    {REG_REFERENCE_X, 0x00, 0x00},
    {REG_REFERENCE_X + 1, 0x00, 0x00},
    {REG_REFERENCE_Z, 0x00, 0x00},
    {REG_CTRL0_XM, 0x18, 0x67},  // FIFO_EN, WTM_EN, high-pass of clicks and interrupts
    {REG_CTRL1_XM, 0x00, 0x00},
    {REG_CTRL2_XM, 0x00, 0x01},  // SPI
    {REG_CTRL3_XM, 0x00, 0xF9},  // all but data-ready
    {REG_CTRL4_XM, 0x00, 0xF3},
    {REG_CTRL5_XM, 0x00, 0x00},
    {REG_CTRL6_XM, 0x9F, 0x00},
    {REG_CTRL7_XM, 0x18, 0x20},  // AFDS
    {REG_FIFO_CTRL_XM, 0x00, 0xE0},
    {REG_INT_GEN_1, 0x00, 0xFF},
    {REG_INT_GEN_1_THS, 0x80, 0x00},
    {REG_INT_GEN_1_DURATION, 0x80, 0x00},
    {REG_INT_GEN_2, 0x00, 0xFF},
    {REG_INT_GEN_2_THS, 0x80, 0x00},
    {REG_INT_GEN_2_DURATION, 0x80, 0x00},
    {REG_CLICK_CFG, 0xC0, 0x3F},
    {REG_CLICK_THS, 0x80, 0x00},
    {REG_TIME_LIMIT, 0x80, 0x00},
    {REG_TIME_LATENCY, 0x00, 0x00},
    {REG_TIME_WINDOW, 0x00, 0x00},
    {REG_ACT_THS, 0x80, 0x7F},
    {REG_ACT_DUR, 0x00, 0x00},
};

static void step(struct die *die) {
    if (die->moves_on) {
        die->pointer = (die->pointer + 1) & (REG_COUNT - 1);
    }
}

uint8_t lsm9ds0_chip_read_register(struct lsm9ds0_chip *chip, struct die *die) {
    const uint8_t at = die->pointer;
    uint8_t value = die->reg[at];
    if (at == REG_WHO_AM_I) {
        const struct chip_fault *fault =
            i2c_slave_find_fault(&chip->wire, CHIP_FAULT_WRONG_WHO_AM_I, die->number);
        value = fault != NULL ? fault->value : value;
    } else if (at >= REG_OUT_X_L && at < REG_OUT_X_L + 2 * AXES) {
        lsm9ds0_chip_release(chip, die == &chip->g ? CHIP_GYR : CHIP_ACC,
                             at - REG_OUT_X_L);
    } else if (die == &chip->xm && at >= REG_OUT_X_L_M && at <= REG_OUT_Z_H_M) {
        lsm9ds0_chip_release(chip, CHIP_MAG, at - REG_OUT_X_L_M);
    }
    step(die);
    return value;
}

// DS CTRL_REG5_XM: 100 Hz with the accelerometer above 50 Hz or off, 110 and 111 not at
// all; M_RES is 00 or 11.
static void check_mag(struct lsm9ds0_chip *chip) {
    const uint8_t *reg = chip->xm.reg;
    const int modr = (reg[REG_CTRL5_XM] >> M_ODR_SHIFT) & 0x07;
    const int res = (reg[REG_CTRL5_XM] >> M_RES_SHIFT) & 0x03;
    const int aodr = reg[REG_CTRL1_XM] >> A_ODR_SHIFT;
    if (res == 1 || res == 2) {
        lsm9ds0_chip_complain(chip, "LSM9DS0: a magnetic resolution that is reserved");
    }
    if ((reg[REG_CTRL7_XM] & M_MODE) >= M_POWER_DOWN ||
        (reg[REG_CTRL7_XM] & M_LOW_POWER)) {
        return;
    }
    if (modr > M_ODR_100_HZ) {
        lsm9ds0_chip_complain(chip, "LSM9DS0: a magnetic data rate that is reserved");
    } else if (modr == M_ODR_100_HZ && aodr > 0 && aodr <= A_ODR_50_HZ) {
        lsm9ds0_chip_complain(
            chip, "LSM9DS0: 100 Hz of the magnetometer with a slow accelerometer");
    }
}

static void begin_boot(struct lsm9ds0_chip *chip, struct die *die) {
    die->boot_end = chip->wire.now_ns + chip->config.startup_ns;
    for (int i = 0; i < SENSORS; i++) {
        const enum chip_quantity quantity = (enum chip_quantity)i;
        if (lsm9ds0_chip_die_of(chip, quantity) == die) {
            lsm9ds0_chip_set_next_tick(chip, quantity);
        }
    }
}

static void wrote_g(struct lsm9ds0_chip *chip, uint8_t at, uint8_t old, uint8_t value) {
    const uint8_t changed = old ^ value;
    if (at == REG_CTRL1_G && changed) {
        if (!(old & G_PD)) {
            chip->gyr_on_ns = chip->wire.now_ns;
        }
        lsm9ds0_chip_restart_clock(chip, CHIP_GYR);
    } else if (at == REG_CTRL4_G) {
        if (((value >> G_ST_SHIFT) & 0x03) == 2) {
            lsm9ds0_chip_complain(
                chip, "LSM9DS0: a self-test of the gyroscope that is reserved");
        }
        if (changed & G_BDU) {
            lsm9ds0_chip_release_all(chip, CHIP_GYR);
        }
    } else if (at == REG_CTRL5_G && (value & BOOT)) {
        begin_boot(chip, &chip->g);
    }
}

static void wrote_xm(struct lsm9ds0_chip *chip, uint8_t at, uint8_t old,
                     uint8_t value) {
    const uint8_t changed = old ^ value;
    switch (at) {
    case REG_CTRL0_XM:
        if (value & BOOT) {
            begin_boot(chip, &chip->xm);
        }
        break;
    case REG_CTRL1_XM:
        if ((value >> A_ODR_SHIFT) > A_ODR_LAST) {
            lsm9ds0_chip_complain(
                chip, "LSM9DS0: an acceleration data rate that is reserved");
        }
        if (changed >> A_ODR_SHIFT) {
            lsm9ds0_chip_restart_clock(chip, CHIP_ACC);
        }
        if (changed & XM_BDU) {
            lsm9ds0_chip_release_all(chip, CHIP_ACC);
            lsm9ds0_chip_release_all(chip, CHIP_MAG);
        }
        check_mag(chip);
        break;
    case REG_CTRL2_XM:
        if (((value >> A_FS_SHIFT) & 0x07) > A_FS_LAST ||
            ((value >> A_ST_SHIFT) & 0x03) == 3) {
            lsm9ds0_chip_complain(chip,
                                  "LSM9DS0: a range or self-test that is not allowed");
        }
        break;
    case REG_CTRL5_XM:
        if (changed & (0x07 << M_ODR_SHIFT)) {
            lsm9ds0_chip_restart_clock(chip, CHIP_MAG);
        }
        check_mag(chip);
        break;
    case REG_CTRL7_XM:
        if (changed & (M_MODE | M_LOW_POWER) || (value & M_MODE) == M_SINGLE) {
            lsm9ds0_chip_restart_clock(chip, CHIP_MAG);
        }
        check_mag(chip);
        break;
    default:
        break;
    }
}

static const struct rule *find_rule(const struct lsm9ds0_chip *chip,
                                    const struct die *die) {
    const bool is_g = die == &chip->g;
    const struct rule *rules = is_g ? rules_g : rules_xm;
    const size_t count = is_g ? sizeof rules_g / sizeof rules_g[0]
                              : sizeof rules_xm / sizeof rules_xm[0];
    for (size_t i = 0; i < count; i++) {
        if (rules[i].reg == die->pointer) {
            return &rules[i];
        }
    }
    return NULL;
}

void lsm9ds0_chip_write_register(struct lsm9ds0_chip *chip, struct die *die,
                                 uint8_t value) {
    const uint8_t at = die->pointer;
    const struct rule *rule = find_rule(chip, die);
    if (die->boot_end != NEVER) {  // the documents don't define this
        lsm9ds0_chip_complain(chip, "LSM9DS0: a register written during a reboot");
    }
    if (rule == NULL) {
        lsm9ds0_chip_complain(
            chip, "LSM9DS0: a register written that is reserved or read-only");
    } else {
        if (value & rule->reserved) {
            lsm9ds0_chip_complain(chip, "LSM9DS0: a reserved bit set");
        }
        if (value & rule->unmodelled) {
            lsm9ds0_chip_complain(chip,
                                  "LSM9DS0: something turned on that is not modelled");
        }
        const uint8_t old = die->reg[at];
        die->reg[at] = value & (uint8_t)~rule->reserved;
        if (die == &chip->g) {
            wrote_g(chip, at, old, die->reg[at]);
        } else {
            wrote_xm(chip, at, old, die->reg[at]);
        }
    }
    step(die);
}
