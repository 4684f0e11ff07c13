// SPDX-License-Identifier: MIT
// What reading and writing the registers of both dies does.
#include "chip.h"

#include <stddef.h>

uint8_t lsm9ds0_chip_die_of(enum chip_quantity quantity) {
    return quantity == CHIP_GYR ? LSM9DS0_CHIP_G : LSM9DS0_CHIP_XM;
}

struct st_die *lsm9ds0_chip_die(struct lsm9ds0_chip *chip, uint8_t number) {
    return number == LSM9DS0_CHIP_G ? &chip->g : &chip->xm;
}

struct st_output lsm9ds0_chip_output(struct lsm9ds0_chip *chip,
                                     enum chip_quantity quantity) {
    uint8_t *g = chip->g.reg;
    uint8_t *xm = chip->xm.reg;
    // Bit 0 is x. The magnetometer has no enable bits.
    const bool has_bdu = (xm[REG_CTRL1_XM] & XM_BDU) != 0;
    switch (quantity) {
    case CHIP_GYR:
        return (struct st_output){
            .out = &g[REG_OUT_X_L],
            .status = &g[REG_STATUS],
            .enabled = g[REG_CTRL1_G] & G_AXES,
            .has_bdu = (g[REG_CTRL4_G] & G_BDU) != 0,
        };
    case CHIP_ACC:
        return (struct st_output){
            .out = &xm[REG_OUT_X_L],
            .status = &xm[REG_STATUS],
            .enabled = xm[REG_CTRL1_XM] & A_AXES,
            .has_bdu = has_bdu,
        };
    default:
        return (struct st_output){
            .out = &xm[REG_OUT_X_L_M],
            .status = &xm[REG_STATUS_M],
            .enabled = 0x07,
            .has_bdu = has_bdu,
        };
    }
}

// Those that any firmware here uses, and their neighbours.
static const struct st_rule rules_g[] = {
    {REG_CTRL1_G, 0x00, 0x00}, {REG_CTRL2_G, 0xC0, 0x00},
    {REG_CTRL3_G, 0x00, 0xC7},  // INT_G, and a FIFO's flags
    {REG_CTRL4_G, 0x08, 0x41},  // big-endian, SPI
    {REG_CTRL5_G, 0x20, 0x51},  // FIFO_EN, HPen, Out_Sel but LPF2
};

static const struct st_rule rules_xm[] = {
    {REG_INT_CTRL_M, 0x00, 0x01},  // MIEN
    {REG_CTRL0_XM, 0x18, 0x67},  // FIFO_EN, WTM_EN, high-pass of clicks and interrupts
    {REG_CTRL1_XM, 0x00, 0x00},   {REG_CTRL2_XM, 0x00, 0x01},  // SPI
    {REG_CTRL3_XM, 0x00, 0xF9},                                // all but data-ready
    {REG_CTRL4_XM, 0x00, 0xF3},   {REG_CTRL5_XM, 0x00, 0x00},
    {REG_CTRL6_XM, 0x9F, 0x00},   {REG_CTRL7_XM, 0x18, 0x24},  // AFDS, low power
};

static void release(struct lsm9ds0_chip *chip, enum chip_quantity quantity,
                    int number) {
    const struct st_output output = lsm9ds0_chip_output(chip, quantity);
    st_release(&chip->sensors[quantity].words, &output, number);
}

static void release_all(struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    const struct st_output output = lsm9ds0_chip_output(chip, quantity);
    st_release_all(&chip->sensors[quantity].words, &output);
}

uint8_t lsm9ds0_chip_read(void *self, uint8_t number) {
    struct lsm9ds0_chip *chip = self;
    struct st_die *die = lsm9ds0_chip_die(chip, number);
    const uint8_t at = die->pointer;
    uint8_t value = die->reg[at];
    if (at == REG_WHO_AM_I) {
        value = sensor_chip_identity(&chip->base, number, value);
    } else if (at >= REG_OUT_X_L && at < REG_OUT_X_L + 2 * AXES) {
        release(chip, number == LSM9DS0_CHIP_G ? CHIP_GYR : CHIP_ACC, at - REG_OUT_X_L);
    } else if (number == LSM9DS0_CHIP_XM && at >= REG_OUT_X_L_M &&
               at <= REG_OUT_Z_H_M) {
        release(chip, CHIP_MAG, at - REG_OUT_X_L_M);
    }
    st_step(die);
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
        sensor_chip_complain(&chip->base, "a magnetic resolution that is reserved");
    }
    const uint8_t mode = reg[REG_CTRL7_XM] & M_MODE;
    if (mode == M_SINGLE) {
        sensor_chip_complain(&chip->base,
                             "a single measurement, which is not modelled");
    }
    if (mode != M_CONTINUOUS) {
        return;
    }
    if (modr > M_ODR_100_HZ) {
        sensor_chip_complain(&chip->base, "a magnetic data rate that is reserved");
    } else if (modr == M_ODR_100_HZ && aodr > 0 && aodr <= A_ODR_50_HZ) {
        sensor_chip_complain(&chip->base,
                             "100 Hz of the magnetometer with a slow accelerometer");
    }
}

static void begin_boot(struct lsm9ds0_chip *chip, uint8_t number) {
    lsm9ds0_chip_die(chip, number)->wait_end =
        chip->base.wire.now_ns + chip->base.config.startup_ns;
    for (int i = 0; i < SENSORS; i++) {
        const enum chip_quantity quantity = (enum chip_quantity)i;
        if (lsm9ds0_chip_die_of(quantity) == number) {
            lsm9ds0_chip_set_next_tick(chip, quantity);
        }
    }
}

static void wrote_g(struct lsm9ds0_chip *chip, uint8_t at, uint8_t old, uint8_t value) {
    const uint8_t changed = old ^ value;
    if (at == REG_CTRL1_G && changed) {
        if (!(old & G_PD)) {
            chip->gyr_on_ns = chip->base.wire.now_ns;
        }
        lsm9ds0_chip_restart_clock(chip, CHIP_GYR);
    } else if (at == REG_CTRL4_G) {
        if (((value >> G_ST_SHIFT) & 0x03) == 2) {
            sensor_chip_complain(&chip->base,
                                 "a self-test of the gyroscope that is reserved");
        }
        if (changed & G_BDU) {
            release_all(chip, CHIP_GYR);
        }
    } else if (at == REG_CTRL5_G && (value & BOOT)) {
        begin_boot(chip, LSM9DS0_CHIP_G);
    }
}

static void wrote_xm(struct lsm9ds0_chip *chip, uint8_t at, uint8_t old,
                     uint8_t value) {
    const uint8_t changed = old ^ value;
    switch (at) {
    case REG_CTRL0_XM:
        if (value & BOOT) {
            begin_boot(chip, LSM9DS0_CHIP_XM);
        }
        break;
    case REG_CTRL1_XM:
        if ((value >> A_ODR_SHIFT) > A_ODR_LAST) {
            sensor_chip_complain(&chip->base,
                                 "an acceleration data rate that is reserved");
        }
        if (changed >> A_ODR_SHIFT) {
            lsm9ds0_chip_restart_clock(chip, CHIP_ACC);
        }
        if (changed & XM_BDU) {
            release_all(chip, CHIP_ACC);
            release_all(chip, CHIP_MAG);
        }
        check_mag(chip);
        break;
    case REG_CTRL2_XM:
        if (((value >> A_FS_SHIFT) & 0x07) > A_FS_LAST ||
            ((value >> A_ST_SHIFT) & 0x03) == 3) {
            sensor_chip_complain(&chip->base,
                                 "a range or self-test that is not allowed");
        }
        break;
    case REG_CTRL5_XM:
        if (changed & (0x07 << M_ODR_SHIFT)) {
            lsm9ds0_chip_restart_clock(chip, CHIP_MAG);
        }
        check_mag(chip);
        break;
    case REG_CTRL7_XM:
        if (changed & M_MODE) {
            lsm9ds0_chip_restart_clock(chip, CHIP_MAG);
        }
        check_mag(chip);
        break;
    default:
        break;
    }
}

void lsm9ds0_chip_write(void *self, uint8_t number, uint8_t value) {
    struct lsm9ds0_chip *chip = self;
    struct st_die *die = lsm9ds0_chip_die(chip, number);
    const uint8_t at = die->pointer;
    const uint8_t old = die->reg[at];
    const bool is_g = number == LSM9DS0_CHIP_G;
    const struct st_rule *rule =
        is_g ? st_find_rule(rules_g, sizeof rules_g / sizeof rules_g[0], at)
             : st_find_rule(rules_xm, sizeof rules_xm / sizeof rules_xm[0], at);
    if (st_write(&chip->base, die, rule, "reboot", value)) {
        if (is_g) {
            wrote_g(chip, at, old, die->reg[at]);
        } else {
            wrote_xm(chip, at, old, die->reg[at]);
        }
    }
    st_step(die);
}
