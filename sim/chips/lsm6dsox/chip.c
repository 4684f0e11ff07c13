// SPDX-License-Identifier: MIT
// The model of the LSM6DSOX: its clock, the counts that motion, self-test and
// temperature make, its outputs, its registers and its life. See ../lsm6dsox.h for the
// documents that DS, SO, AN, AD, LX and QC stand for.
#include "../lsm6dsox.h"

#include <math.h>
#include <string.h>

#include "../sensor/st.h"

enum { DIE = 1 };

// DS table 20.
enum {
    REG_COUNTER_BDR_REG1 = 0x0B,
    REG_INT1_CTRL = 0x0D,
    REG_INT2_CTRL = 0x0E,
    REG_WHO_AM_I = 0x0F,
    REG_CTRL1_XL = 0x10,
    REG_CTRL2_G = 0x11,
    REG_CTRL3_C = 0x12,
    REG_CTRL4_C = 0x13,
    REG_CTRL5_C = 0x14,
    REG_CTRL6_C = 0x15,
    REG_CTRL7_G = 0x16,
    REG_CTRL8_XL = 0x17,
    REG_CTRL9_XL = 0x18,
    REG_CTRL10_C = 0x19,
    REG_STATUS = 0x1E,
    REG_OUT_TEMP_L = 0x20,
    REG_OUTX_L_G = 0x22,
    REG_OUTX_L_A = 0x28,
    REG_OUTZ_H_A = 0x2D,
    REG_INTERNAL_FREQ_FINE = 0x63,
};

enum {
    DATAREADY_PULSED = 1 << 7,  // COUNTER_BDR_REG1
    // INT1_CTRL
    INT_DRDY_XL = 1 << 0,
    INT_DRDY_G = 1 << 1,
    // CTRL1_XL, CTRL2_G
    ODR_SHIFT = 4,
    ODR_OFF = 0,
    ODR_LAST = 10,
    FS_SHIFT = 2,
    FS_MASK = 0x03,
    FS_125 = 1 << 1,
    // CTRL3_C
    BDU = 1 << 6,
    IF_INC = 1 << 2,
    SW_RESET = 1 << 0,
    // CTRL5_C
    ST_G_SHIFT = 2,
    ST_MASK = 0x03,
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
    struct lsm6dsox_chip_config config;
    struct st_die die;
    bool is_i3c_only;
    uint64_t clock_from_ns;  // of tick 0 of the clock of 6667 Hz
    uint64_t gyr_on_ns;      // the gyroscope left power-down
    uint64_t pulse_end;      // of data-ready where it is pulsed; NEVER for none
    struct sensor sensors[SOURCES];
};

// The clock, which both sensors and the thermometer divide

// DS table 18: 6667 Hz and its halves, which AN5192 (memory) and QC (odr_coeff) divide
// from it: 12.5 Hz is 6667 / 512.
#define CLOCK_HZ 6667.0

enum {
    DIVIDER_12_5_HZ = 512,
    DIVIDER_52_HZ = 128,  // DS table 5: the thermometer's
};

static double tick_ns(const struct lsm6dsox_chip *chip) {
    return 1e9 / (CLOCK_HZ * (1.0 + chip->config.rate_error_ppm * 1e-6));
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

static uint8_t rate_code(const struct lsm6dsox_chip *chip, enum source source) {
    return chip->die.reg[source == GYR ? REG_CTRL2_G : REG_CTRL1_XL] >> ODR_SHIFT;
}

static uint32_t wanted(const struct lsm6dsox_chip *chip, enum source source) {
    if (chip->die.wait_end != NEVER) {
        return 0;
    }
    if (source == TEMP) {
        const bool is_on =
            chip->sensors[ACC].divider != 0 || chip->sensors[GYR].divider != 0;
        return is_on ? DIVIDER_52_HZ : 0;
    }
    const uint8_t code = rate_code(chip, source);
    return code == ODR_OFF || code > ODR_LAST ? 0U
                                              : (uint32_t)DIVIDER_12_5_HZ >> (code - 1);
}

// AN tables 13, 15.
static uint32_t to_discard(const struct lsm6dsox_chip *chip, enum source source) {
    static const uint16_t gyr[ODR_LAST] = {2, 3, 3, 3, 3, 3, 3, 135, 270, 540};
    static const uint16_t acc[ODR_LAST] = {0, 0, 1, 1, 1, 1, 1, 2, 3, 13};
    switch (source) {
    case GYR:
        return gyr[rate_code(chip, GYR) - 1];
    case ACC:
        return acc[rate_code(chip, ACC) - 1];
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

// The code of a rate, 0 for 12.5 Hz.
static int code_of(const struct lsm6dsox_chip *chip, enum source source) {
    const int code = rate_code(chip, source);
    return code >= 1 && code <= ODR_LAST ? code - 1 : 0;
}

static void sense_gyro(struct lsm6dsox_chip *chip, double counts[AXES]) {
    // DS table 18: LPF2. QC: gyro_group_delay.
    static const struct lowpass lowpass[ODR_LAST] = {
        {4.2, 74.79},  {8.3, 38.89},  {16.6, 19.44},  {33.0, 9.72},   {66.8, 4.86},
        {135.9, 2.46}, {295.5, 1.26}, {1108.1, 0.69}, {1320.7, 0.42}, {1441.8, 0.28}};
    // By FS_G and for FS_125: SO and DS: 250, 500, 1000, 2000, 125 deg/s.
    static const double mdps_per_count[] = {8.75, 17.50, 35.0, 70.0, 4.375};
    // SO table 2: 20 to 80 deg/s at 250, 150 to 700 at 2000.
    static const double response_part[] = {0.125, 0.25, 0.5, 1.0, 0.125};
    static const double sign[4] = {0, 1, 0, -1};  // DS table 55
    const uint8_t ctrl2 = chip->die.reg[REG_CTRL2_G];
    const int range = ctrl2 & FS_125 ? 4 : (ctrl2 >> FS_SHIFT) & FS_MASK;
    const uint8_t test = (chip->die.reg[REG_CTRL5_C] >> ST_G_SHIFT) & ST_MASK;
    const double part =
        sign[test] * sensor_chip_response(&chip->base, CHIP_FAULT_GYR_SELF_TEST, DIE) *
        response_part[range];
    const bool is_good =
        chip->base.wire.now_ns - chip->gyr_on_ns >= chip->config.gyr_turn_on_ns;
    double mean[AXES];
    sensor_chip_low_passed(&chip->base, CHIP_GYR, lowpass[code_of(chip, GYR)],
                           period_ns(chip, GYR), mean);
    for (int axis = 0; axis < AXES; axis++) {
        const double dps =
            mean[axis] / RAD_PER_DEG + part * chip->config.gyr_self_test_dps[axis];
        counts[axis] = is_good ? dps * 1000.0 / mdps_per_count[range] : 0.0;
    }
}

static void sense_accel(struct lsm6dsox_chip *chip, double counts[AXES]) {
    // QC: accel_group_delay.
    static const double delay_ms[ODR_LAST] = {57.69, 28.89, 14.44, 7.22, 3.74,
                                              1.93,  1.03,  0.58,  0.36, 0.25};
    // AD: the code's order is 2, 16, 4, 8 g, as DS table 45 has 4, 32, 8, 16 g.
    static const double mg_per_count[4] = {0.061, 0.488, 0.122, 0.244};
    static const double sign[4] = {0, 1, -1, 0};  // DS table 56
    const uint8_t *reg = chip->die.reg;
    const double mg = mg_per_count[(reg[REG_CTRL1_XL] >> FS_SHIFT) & FS_MASK];
    const double test =
        sign[reg[REG_CTRL5_C] & ST_MASK] *
        sensor_chip_response(&chip->base, CHIP_FAULT_ACC_SELF_TEST, DIE);
    const double period = period_ns(chip, ACC);
    // DS figure 17: LPF1 has half the rate.
    const struct lowpass lowpass = {1e9 / period / 2.0, delay_ms[code_of(chip, ACC)]};
    double mean[AXES];
    sensor_chip_low_passed(&chip->base, CHIP_ACC, lowpass, period, mean);
    for (int axis = 0; axis < AXES; axis++) {
        counts[axis] = (mean[axis] * 1000.0 / STANDARD_GRAVITY +
                        test * chip->config.acc_self_test_mg[axis]) /
                       mg;
    }
}

// Measures: `latest` of the sensor.
static void sense(struct lsm6dsox_chip *chip, enum source source) {
    double counts[AXES] = {0.0, 0.0, 0.0};
    if (source == GYR) {
        sense_gyro(chip, counts);
    } else if (source == ACC) {
        sense_accel(chip, counts);
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

#define PULSE_NS UINT64_C(75000)  // DS table 34

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
    if (chip->die.reg[REG_COUNTER_BDR_REG1] & DATAREADY_PULSED) {
        chip->pulse_end = chip->base.wire.now_ns + PULSE_NS;
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
    if ((chip->die.reg[REG_CTRL3_C] & BDU) && st_word_waited(&sensor->words, number)) {
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
    const bool is_pulsed = (reg[REG_COUNTER_BDR_REG1] & DATAREADY_PULSED) != 0;
    const uint8_t enabled = reg[REG_INT1_CTRL];
    const bool is_ready =
        ((enabled & INT_DRDY_XL) && chip->sensors[ACC].is_signalled) ||
        ((enabled & INT_DRDY_G) && chip->sensors[GYR].is_signalled);
    (void)pin;
    return is_ready && (!is_pulsed || chip->pulse_end != NEVER);
}

// Registers

// DS 9; those that any firmware here uses, and their neighbours.
static const struct st_rule rules[] = {
    {REG_COUNTER_BDR_REG1, 0x18, 0x67},
    {REG_INT1_CTRL, 0x00, 0xFC},
    {REG_INT2_CTRL, 0x80, 0x7F},
    {REG_CTRL1_XL, 0x01, 0x02},
    {REG_CTRL2_G, 0x01, 0x00},
    {REG_CTRL3_C, 0x02, 0xA8},  // BOOT, H_LACTIVE, SPI
    {REG_CTRL4_C, 0x91, 0x6E},
    {REG_CTRL5_C, 0x00, 0xF0},   // ultra-low power, circular bursts
    {REG_CTRL6_C, 0x00, 0xF8},   // DEN, low power, offsets
    {REG_CTRL7_G, 0x08, 0xC7},   // low power, high-pass, OIS, offsets
    {REG_CTRL8_XL, 0x00, 0x1E},  // high-pass, fast settling, the other ranges
    {REG_CTRL9_XL, 0x01, 0x1C},  // DEN
    {REG_CTRL10_C, 0xDF, 0x20},  // timestamps
};

// DS table 50: IF_INC.
static void step(struct lsm6dsox_chip *chip) {
    chip->die.moves_on = (chip->die.reg[REG_CTRL3_C] & IF_INC) != 0;
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

static void check(struct lsm6dsox_chip *chip) {
    const uint8_t *reg = chip->die.reg;
    if (rate_code(chip, ACC) > ODR_LAST || rate_code(chip, GYR) > ODR_LAST) {
        // DS tables 44, 48; of the accelerometer 11 is 1.6 Hz in low power.
        sensor_chip_complain(&chip->base, "a data rate that is not allowed");
    }
    if (((reg[REG_CTRL5_C] >> ST_G_SHIFT) & ST_MASK) == 2 ||
        (reg[REG_CTRL5_C] & ST_MASK) == 3) {  // DS tables 55, 56
        sensor_chip_complain(&chip->base, "a self-test that is not allowed");
    }
}

static void wrote(struct lsm6dsox_chip *chip, uint8_t at, uint8_t old) {
    const uint8_t value = chip->die.reg[at];
    check(chip);
    if (at == REG_CTRL2_G && (old >> ODR_SHIFT) == ODR_OFF) {
        chip->gyr_on_ns = chip->base.wire.now_ns;
    }
    if (at == REG_CTRL3_C && ((old ^ value) & BDU)) {
        release_all(chip);
    }
    if (at == REG_CTRL3_C && (value & SW_RESET)) {
        begin_reset(chip);
    }
    set_rates(chip);
}

static void write_byte(void *self, uint8_t die, uint8_t value) {
    struct lsm6dsox_chip *chip = self;
    const uint8_t at = chip->die.pointer;
    const uint8_t old = chip->die.reg[at];
    const struct st_rule *rule =
        st_find_rule(rules, sizeof rules / sizeof rules[0], at);
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

// The registers as after power-up (DS table 20).
static void reset(struct lsm6dsox_chip *chip) {
    // DS table 141: steps of 0.15 %.
    const double fine = rint(chip->config.rate_error_ppm / 1500.0);
    memset(chip->die.reg, 0, sizeof chip->die.reg);
    chip->die.reg[0x02] = 0x3F;  // PIN_CTRL
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
    .name = "LSM6DSOX",
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

struct lsm6dsox_chip_config lsm6dsox_chip_defaults(void) {
    return (struct lsm6dsox_chip_config){
        // AN5192, memory: boot; AN 4.1 has 15 ms.
        .sensor = {.temperature_c = 25.0, .startup_ns = 10 * MS},
        .reset_ns = 50 * US,        // AN5192, memory; LX waits 50 ms
        .gyr_turn_on_ns = 70 * MS,  // AN table 14, the maximum; DS table 4 has 35
        .who_am_i = 0x6C,           // DS table 41; AD: LSM6DSOX_CHIP_ID
        .gyr_self_test_dps = {400.0, 400.0, 400.0},
        .acc_self_test_mg = {420.0, 390.0, 510.0},  // SO: 50 to 1700
    };
}

struct sensor_chip *lsm6dsox_chip_new(const struct lsm6dsox_chip_config *config) {
    return sensor_chip_new(&model, sizeof(struct lsm6dsox_chip), config,
                           sizeof *config);
}
