// SPDX-License-Identifier: MIT
// The model's life, its time, its pins and its place on the wire.
#include "chip.h"

#include <math.h>
#include <string.h>

// The wire

static uint8_t find_die(void *self, uint8_t address) {
    const struct lsm6dsox_chip *chip = self;
    const bool has_i2c =
        !chip->is_i3c_only && (chip->die.reg[REG_CTRL4_C] & I2C_DISABLE) == 0;
    // DS 5.1.1: 110101x, x being SA0.
    return has_i2c && address == (chip->config.sa0 ? 0x6B : 0x6A) ? DIE
                                                                  : I2C_SLAVE_NOBODY;
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    struct lsm6dsox_chip *chip = self;
    (void)die;
    if (byte >= REG_COUNT) {  // DS 9: addresses have 7 bits
        sensor_chip_complain(&chip->base, "a register's number of eight bits");
    }
    st_set_pointer(&chip->die, byte);
}

// Life

// The registers as after power-up (DS table 20).
static void reset(struct lsm6dsox_chip *chip) {
    // DS table 141: steps of 0.15 %.
    const double fine = rint(chip->config.rate_error_ppm / 1500.0);
    memset(chip->die.reg, 0, sizeof chip->die.reg);
    chip->die.reg[REG_PIN_CTRL] = 0x3F;
    chip->die.reg[REG_WHO_AM_I] = chip->config.who_am_i;
    chip->die.reg[REG_CTRL3_C] = IF_INC;
    chip->die.reg[REG_CTRL9_XL] = 0xE0;
    chip->die.reg[REG_INTERNAL_FREQ_FINE] =
        (uint8_t)(int8_t)fmin(fmax(fine, INT8_MIN), INT8_MAX);
    for (int i = 0; i < SOURCES; i++) {
        const uint64_t samples = chip->sensors[i].samples;
        chip->sensors[i] = (struct sensor){.tick_ns = NEVER, .samples = samples};
    }
    chip->pulse_end = NEVER;
}

static void power_up(void *self) {
    struct lsm6dsox_chip *chip = self;
    chip->die.pointer = 0;
    chip->is_i3c_only = false;
    chip->reset_end = NEVER;
    chip->die.wait_end = NEVER;
    memset(chip->sensors, 0, sizeof chip->sensors);
    chip->gyr_on_ns = chip->base.wire.now_ns;
    reset(chip);
}

// The clock changes its speed with the temperature.
static void warm(void *self, bool is_done) {
    struct lsm6dsox_chip *chip = self;
    if (!is_done) {
        lsm6dsox_chip_anchor(chip);
        return;
    }
    for (int i = 0; i < SOURCES; i++) {
        lsm6dsox_chip_set_next_tick(chip, (enum source)i);
    }
}

// Time

static uint64_t least(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

static uint64_t next_event(const void *self) {
    const struct lsm6dsox_chip *chip = self;
    uint64_t next = least(chip->reset_end, chip->die.wait_end);
    next = least(next, chip->pulse_end);
    for (int i = 0; i < SOURCES; i++) {
        next = least(next, chip->sensors[i].tick_ns);
    }
    return next;
}

// DS table 50: BOOT and SW_RESET are cleared automatically. A boot loads the factory's
// trimming again; the user's registers stay (AN5192, memory).
static void end_waits(struct lsm6dsox_chip *chip) {
    const uint64_t now = chip->base.wire.now_ns;
    if (chip->reset_end == now) {
        chip->reset_end = NEVER;
        reset(chip);
    }
    if (chip->die.wait_end == now) {
        chip->die.wait_end = NEVER;
        chip->die.reg[REG_CTRL3_C] &= (uint8_t)~BOOT;
        chip->gyr_on_ns = now;
        lsm6dsox_chip_set_rates(chip);
    }
    if (chip->pulse_end == now) {
        chip->pulse_end = NEVER;
    }
}

static void do_events(void *self) {
    struct lsm6dsox_chip *chip = self;
    for (int i = 0; i < SOURCES; i++) {
        if (chip->sensors[i].tick_ns == chip->base.wire.now_ns) {
            lsm6dsox_chip_take_sample(chip, (enum source)i);
        }
    }
    end_waits(chip);
}

static void suffer(void *self, const struct chip_fault *fault) {
    struct lsm6dsox_chip *chip = self;
    chip->die.reg[fault->reg & (REG_COUNT - 1)] = fault->value;
    lsm6dsox_chip_set_rates(chip);
}

bool lsm6dsox_chip_pin_is_high(const void *self, unsigned pin) {
    const struct lsm6dsox_chip *chip = self;
    const uint8_t *reg = chip->die.reg;
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
        has_first && (reg[REG_INT1_CTRL] & INT1_BOOT) && chip->die.wait_end != NEVER;
    const bool is_ready = ((enabled & INT_DRDY_XL) && sensors[ACC].is_signalled) ||
                          ((enabled & INT_DRDY_G) && sensors[GYR].is_signalled) ||
                          tells_temp;
    const bool is_active_low = (reg[REG_CTRL3_C] & H_LACTIVE) != 0;
    return ((is_ready && shows) || tells_boot) != is_active_low;
}

static uint8_t peek(const void *self, uint8_t die, uint8_t reg) {
    const struct lsm6dsox_chip *chip = self;
    (void)die;
    return chip->die.reg[reg & (REG_COUNT - 1)];
}

static uint64_t samples(const void *self, enum chip_quantity quantity) {
    const struct lsm6dsox_chip *chip = self;
    return quantity == CHIP_MAG ? 0 : chip->sensors[quantity].samples;
}

static const struct sensor_model model = {
    .name = "LSM6DSOX",
    .wire = {.find_die = find_die,
             .set_pointer = set_pointer,
             .write = lsm6dsox_chip_write,
             .read = lsm6dsox_chip_read},
    .power_up = power_up,
    .next_event = next_event,
    .do_events = do_events,
    .suffer = suffer,
    .warm = warm,
    .pin_is_high = lsm6dsox_chip_pin_is_high,
    .peek = peek,
    .samples = samples,
};

struct lsm6dsox_chip_config lsm6dsox_chip_defaults(void) {
    return (struct lsm6dsox_chip_config){
        // AN5192, memory: boot; AN 4.1 has 15 ms.
        .sensor = {.temperature_c = 25.0, .startup_ns = 10 * MS},
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

struct sensor_chip *lsm6dsox_chip_new(const struct lsm6dsox_chip_config *config) {
    struct lsm6dsox_chip *chip = sensor_chip_new(&model, sizeof *chip, &config->sensor);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    sensor_chip_power_cycle(&chip->base, 0);
    return &chip->base;
}
