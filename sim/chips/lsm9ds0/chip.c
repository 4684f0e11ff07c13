// SPDX-License-Identifier: MIT
// The model's life, its time, its pins and its place on the wire.
#include "chip.h"

#include <string.h>

// The wire

static uint8_t find_die(void *self, uint8_t address) {
    const struct lsm9ds0_chip *chip = self;
    // DS 6.1: 110101x, x being SA0_G; 0011110 or 0011101 for SA0_XM low or high.
    if (address == (chip->config.sa0_g ? 0x6B : 0x6A)) {
        return LSM9DS0_CHIP_G;
    }
    return address == (chip->config.sa0_xm ? 0x1D : 0x1E) ? LSM9DS0_CHIP_XM
                                                          : I2C_SLAVE_NOBODY;
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    st_set_pointer(lsm9ds0_chip_die(self, die), byte);
}

// Life

// DS register map: the column of reset values; others are 0.
static void power_up(void *self) {
    struct lsm9ds0_chip *chip = self;
    memset(&chip->g, 0, sizeof chip->g);
    memset(&chip->xm, 0, sizeof chip->xm);
    chip->g.wait_end = NEVER;
    chip->g.reg[REG_WHO_AM_I] = chip->config.who_am_i_g;
    chip->g.reg[REG_CTRL1_G] = G_AXES;
    chip->g.reg[REG_FIFO_SRC] = FIFO_EMPTY;  // DS 4.3: bypass, it remains empty
    chip->xm.wait_end = NEVER;
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

// Time

static uint64_t next_event(const void *self) {
    const struct lsm9ds0_chip *chip = self;
    uint64_t next =
        chip->g.wait_end < chip->xm.wait_end ? chip->g.wait_end : chip->xm.wait_end;
    for (int i = 0; i < SENSORS; i++) {
        if (chip->sensors[i].tick_ns < next) {
            next = chip->sensors[i].tick_ns;
        }
    }
    return next;
}

// At the end of a reboot BOOT is 0 again; the user's registers stay.
static void end_boot(struct lsm9ds0_chip *chip) {
    if (chip->g.wait_end == chip->base.wire.now_ns) {
        chip->g.wait_end = NEVER;
        chip->g.reg[REG_CTRL5_G] &= (uint8_t)~BOOT;
        chip->gyr_on_ns = chip->base.wire.now_ns;
        lsm9ds0_chip_restart_clock(chip, CHIP_GYR);
    }
    if (chip->xm.wait_end == chip->base.wire.now_ns) {
        chip->xm.wait_end = NEVER;
        chip->xm.reg[REG_CTRL0_XM] &= (uint8_t)~BOOT;
        lsm9ds0_chip_restart_clock(chip, CHIP_ACC);
        lsm9ds0_chip_restart_clock(chip, CHIP_MAG);
    }
}

static void do_events(void *self) {
    struct lsm9ds0_chip *chip = self;
    for (int i = 0; i < SENSORS; i++) {
        if (chip->sensors[i].tick_ns == chip->base.wire.now_ns) {
            lsm9ds0_chip_take_sample(chip, (enum chip_quantity)i);
        }
    }
    end_boot(chip);
}

static void suffer(void *self, const struct chip_fault *fault) {
    struct lsm9ds0_chip *chip = self;
    const uint8_t at = fault->reg & (REG_COUNT - 1);
    if (fault->die != LSM9DS0_CHIP_XM) {
        chip->g.reg[at] = fault->value;
    }
    if (fault->die != LSM9DS0_CHIP_G) {
        chip->xm.reg[at] = fault->value;
    }
}

// One of enum lsm9ds0_chip_pin.
static bool pin_is_high(const void *self, unsigned pin) {
    const struct lsm9ds0_chip *chip = self;
    const uint8_t *xm = chip->xm.reg;
    if (pin == LSM9DS0_CHIP_DRDY_G) {
        // H_Lactive is of INT_G: this pin is active high.
        return (chip->g.reg[REG_CTRL3_G] & G_I2_DRDY) != 0 &&
               (chip->g.reg[REG_STATUS] & ST_DATA_ALL) != 0;
    }
    const bool is_first = pin == LSM9DS0_CHIP_INT1_XM;
    const uint8_t enabled = xm[is_first ? REG_CTRL3_XM : REG_CTRL4_XM];
    const bool has_acc = (enabled & (is_first ? P1_DRDYA : P2_DRDYA)) != 0 &&
                         (xm[REG_STATUS] & ST_DATA_ALL) != 0;
    const bool has_mag = (enabled & (is_first ? P1_DRDYM : P2_DRDYM)) != 0 &&
                         (xm[REG_STATUS_M] & ST_DATA_ALL) != 0;
    const bool is_active_high = (xm[REG_INT_CTRL_M] & XM_IEA) != 0;
    return (has_acc || has_mag) == is_active_high;
}

static uint8_t peek(const void *self, uint8_t die, uint8_t reg) {
    const struct lsm9ds0_chip *chip = self;
    return (die == LSM9DS0_CHIP_G ? &chip->g : &chip->xm)->reg[reg & (REG_COUNT - 1)];
}

static uint64_t samples(const void *self, enum chip_quantity quantity) {
    return ((const struct lsm9ds0_chip *)self)->sensors[quantity].samples;
}

static const struct sensor_model model = {
    .name = "LSM9DS0",
    .wire = {.find_die = find_die,
             .set_pointer = set_pointer,
             .write = lsm9ds0_chip_write,
             .read = lsm9ds0_chip_read},
    .power_up = power_up,
    .next_event = next_event,
    .do_events = do_events,
    .suffer = suffer,
    .pin_is_high = pin_is_high,
    .peek = peek,
    .samples = samples,
};

struct lsm9ds0_chip_config lsm9ds0_chip_defaults(void) {
    return (struct lsm9ds0_chip_config){
        .sensor = {.temperature_c = 25.0, .startup_ns = 10 * MS},
        .temperature_zero_c = 25.0,
        .gyr_turn_on_ns = 250 * MS,
        .who_am_i_g = 0xD4,
        .who_am_i_xm = 0x49,
        .int_ctrl_reg_m = 0xE8,
        .mag_sign = {1, 1, -1},
        .sa0_g = true,
        .sa0_xm = true,
        // DS table 3: 150 to 1000 deg/s; 60 to 1700 mg. ST 01: x up, y and z down.
        .gyr_self_test_dps = {530.0, -530.0, -530.0},
        .acc_self_test_mg = {310.0, 290.0, 520.0},
    };
}

struct sensor_chip *lsm9ds0_chip_new(const struct lsm9ds0_chip_config *config) {
    return sensor_chip_new(&model, sizeof(struct lsm9ds0_chip), config, sizeof *config);
}
