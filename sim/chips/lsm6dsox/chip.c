// SPDX-License-Identifier: MIT
// The model's life, its time, its pins and its place on the wire.
#include "chip.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MS UINT64_C(1000000)  // in nanoseconds
#define US UINT64_C(1000)

void lsm6dsox_chip_complain(struct lsm6dsox_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

// The wire

static void advance(void *chip, uint64_t now_ns) {
    lsm6dsox_chip_advance(chip, now_ns);
}

static uint8_t find_die(void *self, uint8_t address) {
    const struct lsm6dsox_chip *chip = self;
    const bool has_i2c =
        !chip->is_i3c_only && (chip->reg[REG_CTRL4_C] & I2C_DISABLE) == 0;
    // DS 5.1.1: 110101x, x being SA0.
    return has_i2c && address == (chip->config.sa0 ? 0x6B : 0x6A) ? DIE
                                                                  : I2C_SLAVE_NOBODY;
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    struct lsm6dsox_chip *chip = self;
    (void)die;
    if (byte >= REG_COUNT) {  // DS 9: addresses have 7 bits
        lsm6dsox_chip_complain(chip, "LSM6DSOX: a register's number of eight bits");
    }
    chip->pointer = byte & (REG_COUNT - 1);
}

static void write_byte(void *chip, uint8_t die, uint8_t byte) {
    (void)die;
    lsm6dsox_chip_write_register(chip, byte);
}

static uint8_t read_byte(void *chip, uint8_t die) {
    (void)die;
    return lsm6dsox_chip_read_register(chip);
}

static const struct i2c_slave_chip wire_ops = {
    .advance = advance,
    .find_die = find_die,
    .set_pointer = set_pointer,
    .write = write_byte,
    .read = read_byte,
};

struct i2c_slave *lsm6dsox_chip_wire(struct lsm6dsox_chip *chip) {
    return &chip->wire;
}

// Life

struct lsm6dsox_chip_config lsm6dsox_chip_defaults(void) {
    return (struct lsm6dsox_chip_config){
        .temperature_c = 25.0,
        .startup_ns = 10 * MS,      // AN5192, memory: boot; AN 4.1 has 15 ms
        .reset_ns = 50 * US,        // AN5192, memory; LX waits 50 ms
        .boot_ns = 10 * MS,         // as start-up
        .gyr_turn_on_ns = 70 * MS,  // AN table 14, the maximum; DS table 4 has 35
        .who_am_i = 0x6C,           // DS table 41; AD: LSM6DSOX_CHIP_ID
        // SO table 2: 20 to 80 deg/s at 250, 150 to 700 at 2000; 50 to 1700 mg.
        .gyr_self_test_dps = {50.0, 50.0, 100.0, 200.0, 400.0, 400.0},
        .acc_self_test_mg = {420.0, 390.0, 510.0},
    };
}

struct lsm6dsox_chip_config lsm6dsox_chip_ism330dhcx(void) {
    struct lsm6dsox_chip_config config = lsm6dsox_chip_defaults();
    config.who_am_i = 0x6B;  // AD: ISM330DHCX_CHIP_ID
    config.has_4000_dps = true;
    return config;
}

struct lsm6dsox_chip *lsm6dsox_chip_new(const struct lsm6dsox_chip_config *config) {
    struct lsm6dsox_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    chip->wire = (struct i2c_slave){.ops = &wire_ops, .chip = chip};
    chip->motion = chip_motion_from(config->motion, config->context);
    lsm6dsox_chip_power_cycle(chip, 0);
    return chip;
}

void lsm6dsox_chip_free(struct lsm6dsox_chip *chip) {
    free(chip);
}

void lsm6dsox_chip_reset(struct lsm6dsox_chip *chip) {
    // DS table 141: steps of 0.15 %.
    const double fine = rint(chip->config.rate_error_ppm / 1500.0);
    memset(chip->reg, 0, sizeof chip->reg);
    chip->reg[REG_PIN_CTRL] = 0x3F;
    chip->reg[REG_WHO_AM_I] = chip->config.who_am_i;
    chip->reg[REG_CTRL3_C] = IF_INC;
    chip->reg[REG_CTRL9_XL] = 0xE0;
    chip->reg[REG_INTERNAL_FREQ_FINE] =
        (uint8_t)(int8_t)fmin(fmax(fine, INT8_MIN), INT8_MAX);
    for (int i = 0; i < SOURCES; i++) {
        const uint64_t samples = chip->sensors[i].samples;
        chip->sensors[i] = (struct sensor){.tick_ns = NEVER, .samples = samples};
    }
    chip->pulse_end = NEVER;
}

void lsm6dsox_chip_power_cycle(struct lsm6dsox_chip *chip, uint64_t now_ns) {
    chip->wire.now_ns = now_ns;
    chip->wire.answers_ns = now_ns + chip->config.startup_ns;
    chip->wire.is_transfer = false;
    i2c_slave_release(&chip->wire);
    chip->pointer = 0;
    chip->is_i3c_only = false;
    chip->reset_end = NEVER;
    chip->boot_end = NEVER;
    memset(chip->sensors, 0, sizeof chip->sensors);
    chip->gyr_on_ns = now_ns;
    lsm6dsox_chip_reset(chip);
}

void lsm6dsox_chip_hold(struct lsm6dsox_chip *chip, const double gyr_rad_s[3],
                        const double acc_m_s2[3], const double mag_ut[3]) {
    chip_motion_hold(&chip->motion, gyr_rad_s, acc_m_s2, mag_ut);
}

void lsm6dsox_chip_set_temperature(struct lsm6dsox_chip *chip, double temperature_c) {
    lsm6dsox_chip_anchor(chip);
    chip->config.temperature_c = temperature_c;
    for (int i = 0; i < SOURCES; i++) {
        lsm6dsox_chip_set_next_tick(chip, (enum source)i);
    }
}

// Time

static uint64_t least(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

uint64_t lsm6dsox_chip_next_event(const struct lsm6dsox_chip *chip) {
    uint64_t next = least(chip->reset_end, chip->boot_end);
    next = least(next, chip->pulse_end);
    for (int i = 0; i < SOURCES; i++) {
        next = least(next, chip->sensors[i].tick_ns);
    }
    return next;
}

// DS table 50: BOOT and SW_RESET are cleared automatically. A boot loads the factory's
// trimming again; the user's registers stay (AN5192, memory).
static void end_waits(struct lsm6dsox_chip *chip) {
    const uint64_t now = chip->wire.now_ns;
    if (chip->reset_end == now) {
        chip->reset_end = NEVER;
        lsm6dsox_chip_reset(chip);
    }
    if (chip->boot_end == now) {
        chip->boot_end = NEVER;
        chip->reg[REG_CTRL3_C] &= (uint8_t)~BOOT;
        chip->gyr_on_ns = now;
        lsm6dsox_chip_set_rates(chip);
    }
    if (chip->pulse_end == now) {
        chip->pulse_end = NEVER;
    }
}

// What happens to the chip once.
static void suffer(struct lsm6dsox_chip *chip) {
    const struct chip_fault *fault =
        i2c_slave_next_fault(&chip->wire, CHIP_FAULT_REGISTER_FLIP);
    if (fault != NULL) {
        chip->reg[fault->reg & (REG_COUNT - 1)] = fault->value;
        lsm6dsox_chip_set_rates(chip);
    }
    if (i2c_slave_next_fault(&chip->wire, CHIP_FAULT_BROWN_OUT) != NULL) {
        lsm6dsox_chip_power_cycle(chip, chip->wire.now_ns);
    }
}

void lsm6dsox_chip_advance(struct lsm6dsox_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = lsm6dsox_chip_next_event(chip);
        if (next > now_ns || next == NEVER) {
            break;
        }
        chip->wire.now_ns = next;
        for (int i = 0; i < SOURCES; i++) {
            if (chip->sensors[i].tick_ns == next) {
                lsm6dsox_chip_take_sample(chip, (enum source)i);
            }
        }
        end_waits(chip);
        suffer(chip);
    }
    if (now_ns > chip->wire.now_ns) {
        chip->wire.now_ns = now_ns;
    }
    suffer(chip);
}

bool lsm6dsox_chip_pin_is_high(const struct lsm6dsox_chip *chip,
                               enum lsm6dsox_chip_pin pin) {
    const uint8_t *reg = chip->reg;
    const struct sensor *sensors = chip->sensors;
    const bool is_pulsed = (reg[REG_COUNTER_BDR_REG1] & DATAREADY_PULSED) != 0;
    const bool shows = !is_pulsed || chip->pulse_end != NEVER;
    const bool has_first = pin == LSM6DSOX_CHIP_INT1;
    // DS table 52: INT2_on_INT1 moves what INT2 would show.
    const bool has_second = ((reg[REG_CTRL4_C] & INT2_ON_INT1) != 0) == has_first;
    const uint8_t enabled = (uint8_t)((has_first ? reg[REG_INT1_CTRL] : 0) |
                                      (has_second ? reg[REG_INT2_CTRL] : 0));
    const bool tells_temp = has_second && (reg[REG_INT2_CTRL] & INT2_DRDY_TEMP) &&
                            sensors[TEMP].is_signalled;
    const bool tells_boot =
        has_first && (reg[REG_INT1_CTRL] & INT1_BOOT) && chip->boot_end != NEVER;
    const bool is_ready = ((enabled & INT_DRDY_XL) && sensors[ACC].is_signalled) ||
                          ((enabled & INT_DRDY_G) && sensors[GYR].is_signalled) ||
                          tells_temp;
    const bool is_active_low = (reg[REG_CTRL3_C] & H_LACTIVE) != 0;
    return ((is_ready && shows) || tells_boot) != is_active_low;
}

// For tests

uint8_t lsm6dsox_chip_peek(const struct lsm6dsox_chip *chip, uint8_t reg) {
    return chip->reg[reg & (REG_COUNT - 1)];
}

uint64_t lsm6dsox_chip_transactions(const struct lsm6dsox_chip *chip) {
    return chip->wire.transactions;
}

uint64_t lsm6dsox_chip_samples(const struct lsm6dsox_chip *chip,
                               enum chip_quantity quantity) {
    return quantity == CHIP_MAG ? 0 : chip->sensors[quantity].samples;
}

const char *lsm6dsox_chip_complaint(const struct lsm6dsox_chip *chip) {
    return chip->complaint;
}
