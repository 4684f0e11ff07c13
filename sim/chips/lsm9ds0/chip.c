// SPDX-License-Identifier: MIT
// The model's life, its time, its pins and its place on the wire.
#include "chip.h"

#include <stdlib.h>
#include <string.h>

#define MS UINT64_C(1000000)  // in nanoseconds

void lsm9ds0_chip_complain(struct lsm9ds0_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

struct die *lsm9ds0_chip_die_of(struct lsm9ds0_chip *chip,
                                enum chip_quantity quantity) {
    return quantity == CHIP_GYR ? &chip->g : &chip->xm;
}

// The wire

static void advance(void *chip, uint64_t now_ns) {
    lsm9ds0_chip_advance(chip, now_ns);
}

static uint8_t find_die(void *self, uint8_t address) {
    const struct lsm9ds0_chip *chip = self;
    // DS 6.1: 110101x, x being SA0_G; 0011110 or 0011101 for SA0_XM low or high.
    if (address == (chip->config.sa0_g ? 0x6B : 0x6A)) {
        return LSM9DS0_CHIP_G;
    }
    return address == (chip->config.sa0_xm ? 0x1D : 0x1E) ? LSM9DS0_CHIP_XM
                                                          : I2C_SLAVE_NOBODY;
}

static struct die *die_of_number(struct lsm9ds0_chip *chip, uint8_t number) {
    return number == LSM9DS0_CHIP_G ? &chip->g : &chip->xm;
}

static void set_pointer(void *chip, uint8_t number, uint8_t byte) {
    struct die *die = die_of_number(chip, number);
    die->pointer = byte & (REG_COUNT - 1);
    die->moves_on = (byte & 0x80) != 0;
}

static void write_byte(void *chip, uint8_t number, uint8_t byte) {
    lsm9ds0_chip_write_register(chip, die_of_number(chip, number), byte);
}

static uint8_t read_byte(void *chip, uint8_t number) {
    return lsm9ds0_chip_read_register(chip, die_of_number(chip, number));
}

static const struct i2c_slave_chip wire_ops = {
    .advance = advance,
    .find_die = find_die,
    .set_pointer = set_pointer,
    .write = write_byte,
    .read = read_byte,
};

struct i2c_slave *lsm9ds0_chip_wire(struct lsm9ds0_chip *chip) {
    return &chip->wire;
}

// Life

struct lsm9ds0_chip_config lsm9ds0_chip_defaults(void) {
    return (struct lsm9ds0_chip_config){
        .temperature_c = 25.0,
        .temperature_zero_c = 25.0,
        .startup_ns = 10 * MS,
        .gyr_turn_on_ns = 250 * MS,
        .who_am_i_g = 0xD4,
        .who_am_i_xm = 0x49,
        .int_ctrl_reg_m = 0xE8,
        .mag_sign = {1, 1, -1},
        .sa0_g = true,
        .sa0_xm = true,
        // DS table 3: 20 to 250, 70 to 400 and 150 to 1000 deg/s; 60 to 1700 mg.
        .gyr_self_test_dps = {130.0, 200.0, 530.0},
        .acc_self_test_mg = {310.0, 290.0, 520.0},
    };
}

struct lsm9ds0_chip *lsm9ds0_chip_new(const struct lsm9ds0_chip_config *config) {
    struct lsm9ds0_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    chip->wire = (struct i2c_slave){.ops = &wire_ops, .chip = chip};
    chip->motion = chip_motion_from(config->motion, config->context);
    lsm9ds0_chip_power_cycle(chip, 0);
    return chip;
}

void lsm9ds0_chip_free(struct lsm9ds0_chip *chip) {
    free(chip);
}

// DS register map: the column of reset values; others are 0.
void lsm9ds0_chip_power_cycle(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    chip->wire.now_ns = now_ns;
    chip->wire.answers_ns = now_ns + chip->config.startup_ns;
    chip->wire.is_transfer = false;
    i2c_slave_release(&chip->wire);
    memset(&chip->g, 0, sizeof chip->g);
    memset(&chip->xm, 0, sizeof chip->xm);
    chip->g.number = LSM9DS0_CHIP_G;
    chip->g.boot_end = NEVER;
    chip->g.reg[REG_WHO_AM_I] = chip->config.who_am_i_g;
    chip->g.reg[REG_CTRL1_G] = G_AXES;
    chip->g.reg[REG_FIFO_SRC] = FIFO_EMPTY;  // DS 4.3: bypass, it remains empty
    chip->xm.number = LSM9DS0_CHIP_XM;
    chip->xm.boot_end = NEVER;
    chip->xm.reg[REG_WHO_AM_I] = chip->config.who_am_i_xm;
    chip->xm.reg[REG_INT_CTRL_M] = chip->config.int_ctrl_reg_m;
    chip->xm.reg[REG_CTRL1_XM] = A_AXES;
    chip->xm.reg[REG_CTRL5_XM] = 0x18;
    chip->xm.reg[REG_CTRL6_XM] = 0x20;
    chip->xm.reg[REG_CTRL7_XM] = M_POWER_DOWN;
    chip->xm.reg[REG_FIFO_SRC] = FIFO_EMPTY;
    memset(chip->sensors, 0, sizeof chip->sensors);
    for (int i = 0; i < SENSORS; i++) {
        lsm9ds0_chip_restart_clock(chip, (enum chip_quantity)i);
    }
}

void lsm9ds0_chip_hold(struct lsm9ds0_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]) {
    chip_motion_hold(&chip->motion, gyr_rad_s, acc_m_s2, mag_ut);
}

void lsm9ds0_chip_set_temperature(struct lsm9ds0_chip *chip, double temperature_c) {
    chip->config.temperature_c = temperature_c;
}

// Time

uint64_t lsm9ds0_chip_next_event(const struct lsm9ds0_chip *chip) {
    uint64_t next =
        chip->g.boot_end < chip->xm.boot_end ? chip->g.boot_end : chip->xm.boot_end;
    for (int i = 0; i < SENSORS; i++) {
        if (chip->sensors[i].tick_ns < next) {
            next = chip->sensors[i].tick_ns;
        }
    }
    return next;
}

// At the end of a reboot BOOT is 0 again; the user's registers stay.
static void end_boot(struct lsm9ds0_chip *chip) {
    if (chip->g.boot_end == chip->wire.now_ns) {
        chip->g.boot_end = NEVER;
        chip->g.reg[REG_CTRL5_G] &= (uint8_t)~BOOT;
        chip->gyr_on_ns = chip->wire.now_ns;
        lsm9ds0_chip_restart_clock(chip, CHIP_GYR);
    }
    if (chip->xm.boot_end == chip->wire.now_ns) {
        chip->xm.boot_end = NEVER;
        chip->xm.reg[REG_CTRL0_XM] &= (uint8_t)~BOOT;
        lsm9ds0_chip_restart_clock(chip, CHIP_ACC);
        lsm9ds0_chip_restart_clock(chip, CHIP_MAG);
    }
}

// What happens to the chip once.
static void suffer(struct lsm9ds0_chip *chip) {
    const struct chip_fault *fault =
        i2c_slave_next_fault(&chip->wire, CHIP_FAULT_REGISTER_FLIP);
    if (fault != NULL) {
        const uint8_t at = fault->reg & (REG_COUNT - 1);
        if (fault->die != LSM9DS0_CHIP_XM) {
            chip->g.reg[at] = fault->value;
        }
        if (fault->die != LSM9DS0_CHIP_G) {
            chip->xm.reg[at] = fault->value;
        }
    }
    if (i2c_slave_next_fault(&chip->wire, CHIP_FAULT_BROWN_OUT) != NULL) {
        lsm9ds0_chip_power_cycle(chip, chip->wire.now_ns);
    }
}

void lsm9ds0_chip_advance(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = lsm9ds0_chip_next_event(chip);
        if (next > now_ns || next == NEVER) {
            break;
        }
        chip->wire.now_ns = next;
        for (int i = 0; i < SENSORS; i++) {
            if (chip->sensors[i].tick_ns == next) {
                lsm9ds0_chip_take_sample(chip, (enum chip_quantity)i);
            }
        }
        end_boot(chip);
        suffer(chip);
    }
    if (now_ns > chip->wire.now_ns) {
        chip->wire.now_ns = now_ns;
    }
    suffer(chip);
}

bool lsm9ds0_chip_pin_is_high(const struct lsm9ds0_chip *chip,
                              enum lsm9ds0_chip_pin pin) {
    const uint8_t *xm = chip->xm.reg;
    if (pin == LSM9DS0_CHIP_DRDY_G) {
        // H_Lactive is of INT_G: this pin is active high.
        return (chip->g.reg[REG_CTRL3_G] & G_I2_DRDY) != 0 &&
               (chip->g.reg[REG_STATUS] & DATA_ALL) != 0;
    }
    const bool is_first = pin == LSM9DS0_CHIP_INT1_XM;
    const uint8_t enabled = xm[is_first ? REG_CTRL3_XM : REG_CTRL4_XM];
    const bool has_acc = (enabled & (is_first ? P1_DRDYA : P2_DRDYA)) != 0 &&
                         (xm[REG_STATUS] & DATA_ALL) != 0;
    const bool has_mag = (enabled & (is_first ? P1_DRDYM : P2_DRDYM)) != 0 &&
                         (xm[REG_STATUS_M] & DATA_ALL) != 0;
    const bool is_active_high = (xm[REG_INT_CTRL_M] & XM_IEA) != 0;
    return (has_acc || has_mag) == is_active_high;
}

// For tests

uint8_t lsm9ds0_chip_peek_g(const struct lsm9ds0_chip *chip, uint8_t reg) {
    return chip->g.reg[reg & (REG_COUNT - 1)];
}

uint8_t lsm9ds0_chip_peek_xm(const struct lsm9ds0_chip *chip, uint8_t reg) {
    return chip->xm.reg[reg & (REG_COUNT - 1)];
}

uint64_t lsm9ds0_chip_transactions(const struct lsm9ds0_chip *chip) {
    return chip->wire.transactions;
}

uint64_t lsm9ds0_chip_samples(const struct lsm9ds0_chip *chip,
                              enum chip_quantity quantity) {
    return chip->sensors[quantity].samples;
}

const char *lsm9ds0_chip_complaint(const struct lsm9ds0_chip *chip) {
    return chip->complaint;
}
