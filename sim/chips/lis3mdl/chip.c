// SPDX-License-Identifier: MIT
// The model of the LIS3MDL: its sample clock, the counts that field, self-test and
// temperature make, its registers and its life. See ../lis3mdl.h for the
// documents that DS, AN, AD and LX stand for.
#include "../lis3mdl.h"

#include <math.h>
#include <string.h>

#include "../sensor/st.h"

enum { DIE = 1 };

// DS table 16.
enum {
    REG_WHO_AM_I = 0x0F,
    REG_CTRL1 = 0x20,
    REG_CTRL2 = 0x21,
    REG_CTRL3 = 0x22,
    REG_CTRL4 = 0x23,
    REG_CTRL5 = 0x24,
    REG_STATUS = 0x27,
    REG_OUT_X_L = 0x28,
    REG_OUT_Z_H = 0x2D,
    REG_TEMP_OUT_L = 0x2E,
    REG_TEMP_OUT_H = 0x2F,
    REG_INT_CFG = 0x30,
};

enum {
    // CTRL_REG1
    TEMP_EN = 1 << 7,
    OM_SHIFT = 5,
    OM_MASK = 0x03,
    DO_SHIFT = 2,
    DO_MASK = 0x07,
    ST = 1 << 0,
    // CTRL_REG2
    FS_SHIFT = 5,
    FS_MASK = 0x03,
    SOFT_RST = 1 << 2,
    // CTRL_REG3
    MD_MASK = 0x03,
    MD_CONTINUOUS = 0,
    MD_SINGLE = 1,
    MD_POWER_DOWN = 3,
    // CTRL_REG4, CTRL_REG5
    BDU = 1 << 6,
};

struct lis3mdl_chip {
    struct sensor_chip base;
    struct lis3mdl_chip_config config;
    struct st_die die;
    struct st_words words;
    uint64_t epoch_ns;  // sample number n falls at epoch + n periods
    uint64_t tick;      // number of the next sample
    uint64_t tick_ns;   // NEVER: off
    uint64_t samples;
};

// The clock

#define UT_PER_GAUSS 100.0

static double clock_factor(const struct lis3mdl_chip *chip) {
    return 1.0 + chip->config.rate_error_ppm * 1e-6;
}

static double period_ns(const struct lis3mdl_chip *chip) {
    // AD: 0.625 Hz at 0 to 80 at 7.
    const int code = (chip->die.reg[REG_CTRL1] >> DO_SHIFT) & DO_MASK;
    return 1e9 / (ldexp(0.625, code) * clock_factor(chip));
}

static bool is_on(const struct lis3mdl_chip *chip) {
    return (chip->die.reg[REG_CTRL3] & MD_MASK) == MD_CONTINUOUS &&
           chip->die.wait_end == NEVER;
}

static void set_next_tick(struct lis3mdl_chip *chip) {
    const double at = (double)chip->tick * period_ns(chip);
    chip->tick_ns = is_on(chip) ? chip->epoch_ns + (uint64_t)llround(at) : NEVER;
}

static void restart_clock(struct lis3mdl_chip *chip) {
    chip->epoch_ns = chip->base.wire.now_ns;
    chip->tick = 1;
    set_next_tick(chip);
}

// Counts

static void measure_field(struct lis3mdl_chip *chip) {
    // DS table 3.
    static const double counts_per_gauss[4] = {6842.0, 3421.0, 2281.0, 1711.0};
    const uint8_t *reg = chip->die.reg;
    const double scale =
        counts_per_gauss[(reg[REG_CTRL2] >> FS_SHIFT) & FS_MASK] / UT_PER_GAUSS;
    // DS table 20: by OM, the rate of FAST_ODR; a measurement takes as long.
    static const double fast_hz[4] = {1000.0, 560.0, 300.0, 155.0};
    const int mode = (reg[REG_CTRL1] >> OM_SHIFT) & OM_MASK;
    const double takes_ns = 1e9 / (fast_hz[mode] * clock_factor(chip));
    const int64_t now = (int64_t)chip->base.wire.now_ns;
    double field_ut[AXES];
    chip_motion_mean(&chip->base.motion, CHIP_MAG, now - (int64_t)llround(takes_ns),
                     now, field_ut);
    for (int axis = 0; axis < AXES; axis++) {
        const double more_ut =
            reg[REG_CTRL1] & ST ? chip->config.self_test_ut[axis] : 0.0;
        chip->words.latest[axis] =
            chip_motion_to_counts((field_ut[axis] + more_ut) * scale, INT16_MAX);
    }
}

// AN 6: 8 LSB/degC, 0 at 25 degC.
static void measure_temperature(struct lis3mdl_chip *chip) {
    const double warm_c = chip->base.config.temperature_c - 25.0;
    st_put(&chip->die.reg[REG_TEMP_OUT_L],
           chip_motion_to_counts(warm_c * 8.0, INT16_MAX));
}

static struct st_output output_of(struct lis3mdl_chip *chip) {
    return (struct st_output){
        .out = &chip->die.reg[REG_OUT_X_L],
        .status = &chip->die.reg[REG_STATUS],
        .enabled = 0x07,
        .has_bdu = (chip->die.reg[REG_CTRL5] & BDU) != 0,
    };
}

static void take_sample(struct lis3mdl_chip *chip) {
    const struct st_output output = output_of(chip);
    chip->tick++;
    set_next_tick(chip);
    if (sensor_chip_is_silent(&chip->base, CHIP_MAG, DIE)) {
        return;
    }
    chip->samples++;
    if (!sensor_chip_suffers(&chip->base, CHIP_FAULT_FROZEN, DIE)) {
        measure_field(chip);
        if (chip->die.reg[REG_CTRL1] & TEMP_EN) {
            measure_temperature(chip);
        }
    }
    st_put_sample(&chip->words, &output);
}

// Registers

// DS 7; those that any firmware here uses.
static const struct st_rule rules[] = {
    {REG_CTRL1, 0x00, 0x02},  // FAST_ODR
    {REG_CTRL2, 0x93, 0x08},  // REBOOT
    {REG_CTRL3, 0xD8, 0x24},  // low power, SPI
    {REG_CTRL4, 0xF1, 0x02},  // big-endian
    {REG_CTRL5, 0x3F, 0x80},  // FAST_READ
};

static uint8_t read_byte(void *self, uint8_t die) {
    struct lis3mdl_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    uint8_t value = chip->die.reg[at];
    if (at == REG_WHO_AM_I) {
        value = sensor_chip_identity(&chip->base, die, value);
    } else if (at >= REG_OUT_X_L && at <= REG_OUT_Z_H) {
        const struct st_output output = output_of(chip);
        st_release(&chip->words, &output, at - REG_OUT_X_L);
    }
    st_step(&chip->die);
    return value;
}

static void wrote(struct lis3mdl_chip *chip, uint8_t at, uint8_t old) {
    const uint8_t value = chip->die.reg[at];
    const uint8_t changed = old ^ value;
    switch (at) {
    case REG_CTRL1:
        if (changed & (uint8_t) ~(TEMP_EN | ST)) {
            restart_clock(chip);
        }
        break;
    case REG_CTRL2:
        if (value & SOFT_RST) {
            chip->die.wait_end = chip->base.wire.now_ns + chip->config.soft_reset_ns;
            restart_clock(chip);
        }
        break;
    case REG_CTRL3:
        if ((value & MD_MASK) == MD_SINGLE) {
            sensor_chip_complain(&chip->base,
                                 "a single measurement, which is not modelled");
        }
        if (changed) {
            restart_clock(chip);
        }
        break;
    case REG_CTRL5:
        if (changed & BDU) {
            const struct st_output output = output_of(chip);
            st_release_all(&chip->words, &output);
        }
        break;
    default:
        break;
    }
}

static void write_byte(void *self, uint8_t die, uint8_t value) {
    struct lis3mdl_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    const uint8_t old = chip->die.reg[at];
    const struct st_rule *rule =
        st_find_rule(rules, sizeof rules / sizeof rules[0], at);
    (void)die;
    if (st_write(&chip->base, &chip->die, rule, "reset", value)) {
        wrote(chip, at, old);
    }
    st_step(&chip->die);
}

// The wire

static uint8_t find_die(void *self, uint8_t address) {
    const struct lis3mdl_chip *chip = self;
    // DS 5.1: 00111x0, x being SA1.
    return address == (chip->config.sa1 ? 0x1E : 0x1C) &&
                   !sensor_chip_suffers(&chip->base, CHIP_FAULT_NO_MAG, DIE)
               ? DIE
               : I2C_SLAVE_NOBODY;
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    struct lis3mdl_chip *chip = self;
    (void)die;
    st_set_pointer(&chip->die, byte);  // DS 5.1.1
}

// Life

// DS table 16: the column of reset values; others are 0.
static void reset(struct lis3mdl_chip *chip) {
    memset(chip->die.reg, 0, sizeof chip->die.reg);
    chip->die.reg[REG_WHO_AM_I] = chip->config.who_am_i;
    chip->die.reg[REG_CTRL1] = 0x10;
    chip->die.reg[REG_CTRL3] = MD_POWER_DOWN;
    chip->die.reg[REG_INT_CFG] = 0xE8;  // DS table 16, memory
    chip->words.half_read = 0;
    chip->words.waiting = 0;
    chip->die.wait_end = NEVER;
    restart_clock(chip);
}

static void power_up(void *self) {
    struct lis3mdl_chip *chip = self;
    chip->die.pointer = 0;
    chip->die.moves_on = false;
    chip->samples = 0;
    memset(chip->words.latest, 0, sizeof chip->words.latest);
    reset(chip);
}

static uint64_t next_event(const void *self) {
    const struct lis3mdl_chip *chip = self;
    return chip->tick_ns < chip->die.wait_end ? chip->tick_ns : chip->die.wait_end;
}

static void do_events(void *self) {
    struct lis3mdl_chip *chip = self;
    if (chip->tick_ns == chip->base.wire.now_ns) {
        take_sample(chip);
    } else {
        reset(chip);
    }
}

static void suffer(void *self, const struct chip_fault *fault) {
    struct lis3mdl_chip *chip = self;
    chip->die.reg[fault->reg & (REG_COUNT - 1)] = fault->value;
    restart_clock(chip);
}

// DRDY.
static bool pin_is_high(const void *self, unsigned pin) {
    const struct lis3mdl_chip *chip = self;
    (void)pin;
    return (chip->die.reg[REG_STATUS] & ST_DATA_ALL) != 0;
}

static uint8_t peek(const void *self, uint8_t die, uint8_t reg) {
    const struct lis3mdl_chip *chip = self;
    (void)die;
    return chip->die.reg[reg & (REG_COUNT - 1)];
}

static uint64_t samples(const void *self, enum chip_quantity quantity) {
    return quantity == CHIP_MAG ? ((const struct lis3mdl_chip *)self)->samples : 0;
}

static const struct sensor_model model = {
    .name = "LIS3MDL",
    .wire = {.find_die = find_die,
             .set_pointer = set_pointer,
             .write = write_byte,
             .read = read_byte},
    .power_up = power_up,
    .next_event = next_event,
    .do_events = do_events,
    .suffer = suffer,
    .pin_is_high = pin_is_high,
    .peek = peek,
    .samples = samples,
};

struct lis3mdl_chip_config lis3mdl_chip_defaults(void) {
    return (struct lis3mdl_chip_config){
        // No document says how long it starts up; AD waits as long after a reset.
        .sensor = {.temperature_c = 25.0, .startup_ns = 10 * MS},
        .soft_reset_ns = 100 * US,  // no document says
        .who_am_i = 0x3D,           // LX, AD
        // AN: 1 to 3 gauss in X and Y, 0.1 to 1 in Z.
        .self_test_ut = {200.0, 200.0, 50.0},
    };
}

struct sensor_chip *lis3mdl_chip_new(const struct lis3mdl_chip_config *config) {
    return sensor_chip_new(&model, sizeof(struct lis3mdl_chip), config, sizeof *config);
}
