// SPDX-License-Identifier: MIT
// The model of the LSM6DSOX and its relatives: their clock, the counts that motion,
// self-test and temperature make, their outputs, registers and life. See ../lsm6dsox.h
// for the documents that DS, SO, AN, AD, LX and QC stand for.
#include "family.h"

#include <math.h>
#include <string.h>

enum { DIE = 1 };

// DS table 20.
enum {
    REG_PIN_CTRL = 0x02,
    REG_STATUS = 0x1E,
    REG_OUT_TEMP_L = 0x20,
    REG_OUTX_L_G = 0x22,
    REG_OUTX_L_A = 0x28,
    REG_OUTZ_H_A = 0x2D,
    // STATUS_REG
    XLDA = 1 << 0,
    GDA = 1 << 1,
    TDA = 1 << 2,
};

// The sampled quantities: the first two are those of enum chip_quantity.
enum source { GYR = CHIP_GYR, ACC = CHIP_ACC, TEMP, SOURCES };

struct sensor {
    uint32_t divider;  // of the clock's ticks; 0: off
    uint64_t tick;     // number of the clock's tick of the next sample
    uint64_t tick_ns;  // NEVER: off
    uint64_t samples;
    uint32_t settling;  // samples yet to come that are wrong
    struct st_words words;
    bool is_signalled;  // its data-ready signal, latched
};

struct lsm6dsox_chip {
    struct sensor_chip base;
    struct lsm6dsox_chip_config config;  // and the family
    struct st_die die;
    bool is_i3c_only;
    uint64_t clock_from_ns;  // of tick 0 of the clock
    double clock_hz;
    uint64_t gyr_on_ns;  // the gyroscope left power-down
    uint64_t pulse_end;  // of data-ready where it is pulsed; NEVER for none
    struct sensor sensors[SOURCES];
};

// The clock, which both sensors and the thermometer divide

enum {
    DIVIDER_MOST = 512,
    DIVIDER_TEMP = 128,  // DS table 5: 52 Hz
};

static const struct lsm6_family *family(const struct lsm6dsox_chip *chip) {
    return chip->config.family;
}

static double tick_ns(const struct lsm6dsox_chip *chip) {
    return 1e9 / (chip->clock_hz * (1.0 + chip->config.rate_error_ppm * 1e-6));
}

static double period_ns(const struct lsm6dsox_chip *chip, enum source source) {
    return chip->sensors[source].divider * tick_ns(chip);
}

static void set_next_tick(struct lsm6dsox_chip *chip, enum source source) {
    struct sensor *sensor = &chip->sensors[source];
    sensor->tick_ns = sensor->divider == 0
                          ? NEVER
                          : chip->clock_from_ns +
                                (uint64_t)llround((double)sensor->tick * tick_ns(chip));
}

static uint32_t wanted(const struct lsm6dsox_chip *chip, enum source source) {
    if (chip->die.wait_end != NEVER) {
        return 0;
    }
    if (source == TEMP) {
        const bool is_on =
            chip->sensors[ACC].divider != 0 || chip->sensors[GYR].divider != 0;
        return is_on ? DIVIDER_TEMP : 0;
    }
    const int code = lsm6_field(chip->die.reg, family(chip)->rate[source]);
    return code < family(chip)->first_rate
               ? 0U
               : (uint32_t)DIVIDER_MOST >> (code - family(chip)->first_rate);
}

// The number of its rate; 0 where it is off.
static int rate_number(const struct lsm6dsox_chip *chip, enum source source) {
    const int number = lsm6_field(chip->die.reg, family(chip)->rate[source]) -
                       family(chip)->first_rate;
    return number >= 0 && number < LSM6_RATES ? number : 0;
}

// AN tables 13, 15.
static uint32_t to_discard(const struct lsm6dsox_chip *chip, enum source source) {
    static const uint16_t gyr[LSM6_RATES] = {2, 3, 3, 3, 3, 3, 3, 135, 270, 540};
    static const uint16_t acc[LSM6_RATES] = {0, 0, 1, 1, 1, 1, 1, 2, 3, 13};
    switch (source) {
    case GYR:
        return gyr[rate_number(chip, GYR)];
    case ACC:
        return acc[rate_number(chip, ACC)];
    default:
        return 0;
    }
}

static void start(struct lsm6dsox_chip *chip, enum source source, uint32_t divider) {
    struct sensor *sensor = &chip->sensors[source];
    bool others_run = false;
    for (int i = 0; i < SOURCES; i++) {
        others_run = others_run || (i != (int)source && chip->sensors[i].divider != 0);
    }
    if (!others_run) {
        chip->clock_from_ns = chip->base.wire.now_ns;
        // Another set of rates counts in high accuracy alone.
        const uint8_t *reg = chip->die.reg;
        const bool is_accurate = lsm6_field(reg, family(chip)->mode[source]) != 0;
        chip->clock_hz =
            family(chip)
                ->clock_hz[is_accurate ? lsm6_field(reg, family(chip)->rates) : 0];
    }
    sensor->divider = divider;
    // AN 3: both are on one grid. The first sample comes a period or more from now.
    const double since_ns = (double)(chip->base.wire.now_ns - chip->clock_from_ns);
    const double periods = ceil(since_ns / tick_ns(chip) / divider - 1e-6);
    sensor->tick = ((uint64_t)periods + 1) * divider;
    sensor->settling = to_discard(chip, source);
    set_next_tick(chip, source);
    const uint64_t on_ns = chip->gyr_on_ns + chip->config.gyr_turn_on_ns;
    if (source == GYR && on_ns > sensor->tick_ns) {
        // AN table 14: the turn-on time, and then the samples to discard.
        const double early_ns = (double)(on_ns - sensor->tick_ns);
        sensor->settling += (uint32_t)ceil(early_ns / period_ns(chip, GYR));
    }
}

// Turns each sensor on or off, or to another rate, as its registers say.
static void set_rates(struct lsm6dsox_chip *chip) {
    for (int i = 0; i < SOURCES; i++) {
        const enum source source = (enum source)i;
        const uint32_t divider = wanted(chip, source);
        if (divider != chip->sensors[i].divider) {
            if (divider == 0) {
                chip->sensors[i].divider = 0;
                set_next_tick(chip, source);
            } else {
                start(chip, source, divider);
            }
        }
    }
}

// Counts

static struct lowpass lowpass_of(const struct lsm6dsox_chip *chip, enum source source) {
    // DS table 18: LPF2. QC: gyro_group_delay.
    static const struct lowpass gyr[LSM6_RATES] = {
        {4.2, 74.79},  {8.3, 38.89},  {16.6, 19.44},  {33.0, 9.72},   {66.8, 4.86},
        {135.9, 2.46}, {295.5, 1.26}, {1108.1, 0.69}, {1320.7, 0.42}, {1441.8, 0.28}};
    // QC: accel_group_delay.
    static const double acc_delay_ms[LSM6_RATES] = {57.69, 28.89, 14.44, 7.22, 3.74,
                                                    1.93,  1.03,  0.58,  0.36, 0.25};
    const int rate = rate_number(chip, source);
    if (source == ACC) {  // DS figure 17: LPF1 has half the rate.
        return (struct lowpass){1e9 / period_ns(chip, ACC) / 2.0,
                                acc_delay_ms[rate] * LSM6DSOX_HZ / chip->clock_hz};
    }
    return (struct lowpass){gyr[rate].bandwidth_hz * chip->clock_hz / LSM6DSOX_HZ,
                            gyr[rate].delay_ms * LSM6DSOX_HZ / chip->clock_hz};
}

static void sense_inertial(struct lsm6dsox_chip *chip, enum source source,
                           double counts[AXES]) {
    const bool is_gyr = source == GYR;
    const uint8_t *reg = chip->die.reg;
    const int range = lsm6_field(reg, family(chip)->range[source]);
    const double part =
        sensor_chip_response(
            &chip->base, is_gyr ? CHIP_FAULT_GYR_SELF_TEST : CHIP_FAULT_ACC_SELF_TEST,
            DIE) *
        family(chip)->sign[source][lsm6_field(reg, family(chip)->test[source])] *
        (is_gyr ? family(chip)->gyr_response[range] * 1000.0 : 1.0);
    const double *answers =
        is_gyr ? chip->config.gyr_self_test_dps : chip->config.acc_self_test_mg;
    const double unit = (is_gyr ? RAD_PER_DEG : STANDARD_GRAVITY) / 1000.0;
    const bool is_good = !is_gyr || chip->base.wire.now_ns - chip->gyr_on_ns >=
                                        chip->config.gyr_turn_on_ns;
    double mean[AXES];
    sensor_chip_low_passed(&chip->base, (enum chip_quantity)source,
                           lowpass_of(chip, source), period_ns(chip, source), mean);
    for (int axis = 0; axis < AXES; axis++) {
        const double value = mean[axis] / unit + part * answers[axis];
        counts[axis] = is_good ? value / family(chip)->per_count[source][range] : 0.0;
    }
}

// Measures: `latest` of the sensor.
static void sense(struct lsm6dsox_chip *chip, enum source source) {
    double counts[AXES] = {0.0, 0.0, 0.0};
    if (source != TEMP) {
        sense_inertial(chip, source, counts);
    } else {
        // DS table 5: 256 LSB/degC, 0 at 25 degC.
        counts[0] = (chip->base.config.temperature_c - 25.0) * 256.0;
    }
    const double scale = chip->sensors[source].settling > 0 ? 0.5 : 1.0;
    for (int axis = 0; axis < AXES; axis++) {
        chip->sensors[source].words.latest[axis] =
            chip_motion_to_counts(scale * counts[axis], INT16_MAX);
    }
}

// Outputs: a sample that arrives, a byte that is read, BDU between them

static const struct place {
    uint8_t reg, flag, words;
} places[SOURCES] = {
    [GYR] = {REG_OUTX_L_G, GDA, AXES},
    [ACC] = {REG_OUTX_L_A, XLDA, AXES},
    [TEMP] = {REG_OUT_TEMP_L, TDA, 1},
};

// The host sees the latest value of a word.
static void show(struct lsm6dsox_chip *chip, enum source source, int word) {
    st_put(&chip->die.reg[places[source].reg + 2 * word],
           chip->sensors[source].words.latest[word]);
}

static void take_sample(struct lsm6dsox_chip *chip, enum source source) {
    struct sensor *sensor = &chip->sensors[source];
    sensor->tick += sensor->divider;
    set_next_tick(chip, source);
    if (sensor_chip_is_silent(&chip->base, (enum chip_quantity)source, DIE)) {
        return;
    }
    sensor->samples++;
    if (!sensor_chip_suffers(&chip->base, CHIP_FAULT_FROZEN, DIE)) {
        sense(chip, source);
    }
    for (int word = 0; word < places[source].words; word++) {
        if (st_word_shows(&sensor->words, word)) {
            show(chip, source, word);
        }
    }
    chip->die.reg[REG_STATUS] |= places[source].flag;
    sensor->is_signalled = true;
    if (lsm6_field(chip->die.reg, family(chip)->pulsed) != 0) {
        chip->pulse_end = chip->base.wire.now_ns + family(chip)->pulse_ns;
    }
    if (sensor->settling > 0) {
        sensor->settling--;
    }
}

// An output byte has been read.
static void release(struct lsm6dsox_chip *chip, uint8_t reg) {
    enum source source = TEMP;
    if (reg >= REG_OUTX_L_A) {
        source = ACC;
    } else if (reg >= REG_OUTX_L_G) {
        source = GYR;
    }
    struct sensor *sensor = &chip->sensors[source];
    const int number = reg - places[source].reg;
    if (number & 1) {
        // AN 4.3: reset as the higher part of one of the channels is read.
        chip->die.reg[REG_STATUS] &= (uint8_t)~places[source].flag;
        sensor->is_signalled = false;
    }
    if ((chip->die.reg[REG_CTRL3] & BDU) && st_word_waited(&sensor->words, number)) {
        show(chip, source, number / 2);
        chip->die.reg[REG_STATUS] |= places[source].flag;
        sensor->is_signalled = true;
    }
}

// BDU changed: nothing is held back, newer values show.
static void release_all(struct lsm6dsox_chip *chip) {
    for (int i = 0; i < SOURCES; i++) {
        struct sensor *sensor = &chip->sensors[i];
        for (int word = 0; word < places[i].words; word++) {
            if (sensor->words.waiting & (1 << word)) {
                show(chip, (enum source)i, word);
            }
        }
        sensor->words.half_read = 0;
        sensor->words.waiting = 0;
    }
}

// The pin, INT1

static bool pin_is_high(const void *self, unsigned pin) {
    const struct lsm6dsox_chip *chip = self;
    const uint8_t *reg = chip->die.reg;
    const bool is_pulsed = lsm6_field(reg, family(chip)->pulsed) != 0;
    const uint8_t enabled = reg[REG_INT1_CTRL];
    const bool is_ready =
        ((enabled & INT_DRDY_XL) && chip->sensors[ACC].is_signalled) ||
        ((enabled & INT_DRDY_G) && chip->sensors[GYR].is_signalled);
    (void)pin;
    return is_ready && (!is_pulsed || chip->pulse_end != NEVER);
}

// Registers

// DS table 50: IF_INC.
static void step(struct lsm6dsox_chip *chip) {
    chip->die.moves_on = (chip->die.reg[REG_CTRL3] & IF_INC) != 0;
    st_step(&chip->die);
}

static uint8_t read_byte(void *self, uint8_t die) {
    struct lsm6dsox_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    uint8_t value = chip->die.reg[at];
    if (at == REG_WHO_AM_I) {
        value = sensor_chip_identity(&chip->base, die, value);
    } else if (at >= REG_OUT_TEMP_L && at <= REG_OUTZ_H_A) {
        release(chip, at);
    }
    step(chip);
    return value;
}

static void begin_reset(struct lsm6dsox_chip *chip) {
    chip->is_i3c_only = pin_is_high(chip, 0);
    if (chip->is_i3c_only) {
        sensor_chip_complain(&chip->base, "a reset while INT1 is high");
    }
    chip->die.wait_end = chip->base.wire.now_ns + chip->config.reset_ns;
}

// What the documents forbid; null: nothing.
static const char *wrong(const struct lsm6dsox_chip *chip, uint8_t at, uint8_t old) {
    const struct lsm6_family *own = family(chip);
    const uint8_t *reg = chip->die.reg;
    int mode[2];
    int code[2];
    for (int i = GYR; i <= ACC; i++) {
        code[i] = lsm6_field(reg, own->rate[i]);
        mode[i] = lsm6_field(reg, own->mode[i]);
        if (code[i] >= own->first_rate + LSM6_RATES ||
            (code[i] > 0 && code[i] < own->first_rate)) {
            // DS tables 44, 48; others are of low power.
            return "a data rate that is not allowed";
        }
        if (own->per_count[i][lsm6_field(reg, own->range[i])] == 0.0) {
            return "a range that does not exist";
        }
        if (isnan(own->sign[i][lsm6_field(reg, own->test[i])])) {  // DS tables 55, 56
            return "a self-test that is not allowed";
        }
        if (own->stays_in_operation && code[i] > 0 && reg[at] != old &&
            (at == own->range[i].reg || at == own->rates.reg)) {
            return "a sensor is changed while it runs";
        }
    }
    return code[GYR] > 0 && code[ACC] > 0 && mode[GYR] != mode[ACC]
               ? "sensors that run in two modes"
               : NULL;
}

static void wrote(struct lsm6dsox_chip *chip, uint8_t at, uint8_t old) {
    const uint8_t value = chip->die.reg[at];
    const char *complaint = wrong(chip, at, old);
    if (complaint != NULL) {
        sensor_chip_complain(&chip->base, complaint);
    }
    if (at == REG_CTRL2 && chip->sensors[GYR].divider == 0) {
        chip->gyr_on_ns = chip->base.wire.now_ns;
    }
    if (at == REG_CTRL3 && ((old ^ value) & BDU)) {
        release_all(chip);
    }
    if (at == REG_CTRL3 && (value & SW_RESET)) {
        begin_reset(chip);
    }
    set_rates(chip);
}

static void write_byte(void *self, uint8_t die, uint8_t value) {
    struct lsm6dsox_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    const uint8_t old = chip->die.reg[at];
    const struct st_rule *rule =
        st_find_rule(family(chip)->rules, family(chip)->rules_count, at);
    (void)die;
    // DS 10: what is no register may damage it permanently.
    if (st_write(&chip->base, &chip->die, rule, "reset", value)) {
        wrote(chip, at, old);
    }
    step(chip);
}

// The wire

static uint8_t find_die(void *self, uint8_t address) {
    const struct lsm6dsox_chip *chip = self;
    // DS 5.1.1: 110101x, x being SA0.
    return !chip->is_i3c_only && address == (chip->config.sa0 ? 0x6B : 0x6A)
               ? DIE
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

// The registers as after power-up.
static void reset(struct lsm6dsox_chip *chip) {
    memset(chip->die.reg, 0, sizeof chip->die.reg);
    chip->die.reg[REG_WHO_AM_I] = chip->config.who_am_i;
    chip->die.reg[REG_CTRL3] = IF_INC;
    chip->die.reg[REG_PIN_CTRL] = family(chip)->pin_ctrl;
    chip->die.reg[REG_CTRL9] = family(chip)->ctrl9;
    const double fine = rint(chip->config.rate_error_ppm / family(chip)->fine_ppm);
    chip->die.reg[family(chip)->fine] =
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
    chip->die.wait_end = NEVER;
    memset(chip->sensors, 0, sizeof chip->sensors);
    chip->gyr_on_ns = chip->base.wire.now_ns;
    reset(chip);
}

// Time

static uint64_t next_event(const void *self) {
    const struct lsm6dsox_chip *chip = self;
    uint64_t next =
        chip->die.wait_end < chip->pulse_end ? chip->die.wait_end : chip->pulse_end;
    for (int i = 0; i < SOURCES; i++) {
        next = chip->sensors[i].tick_ns < next ? chip->sensors[i].tick_ns : next;
    }
    return next;
}

static void do_events(void *self) {
    struct lsm6dsox_chip *chip = self;
    const uint64_t now = chip->base.wire.now_ns;
    for (int i = 0; i < SOURCES; i++) {
        if (chip->sensors[i].tick_ns == now) {
            take_sample(chip, (enum source)i);
        }
    }
    if (chip->die.wait_end == now) {  // DS table 50: SW_RESET is cleared automatically
        chip->die.wait_end = NEVER;
        reset(chip);
    }
    if (chip->pulse_end == now) {
        chip->pulse_end = NEVER;
    }
}

static void suffer(void *self, const struct chip_fault *fault) {
    struct lsm6dsox_chip *chip = self;
    chip->die.reg[fault->reg & (REG_COUNT - 1)] = fault->value;
    set_rates(chip);
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
    .name = "LSM6DS",
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

struct sensor_chip *lsm6dsox_chip_new(const struct lsm6dsox_chip_config *config) {
    return sensor_chip_new(&model, sizeof(struct lsm6dsox_chip), config,
                           sizeof *config);
}
