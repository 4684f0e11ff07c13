// SPDX-License-Identifier: MIT
// The three sensors: their rates and sample clocks, their low-pass filters, the counts
// that motion, self-test and temperature make.
#include "chip.h"

#include <math.h>
#include <stddef.h>

// Samples a second by the die's own clock; 0 where the sensor is off.
static double rate_hz(const struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    static const double gyro[4] = {95, 190, 380, 760};  // DS table 21
    const uint8_t ctrl1_g = chip->g.reg[REG_CTRL1_G];
    const int aodr = chip->xm.reg[REG_CTRL1_XM] >> A_ODR_SHIFT;
    const uint8_t ctrl7 = chip->xm.reg[REG_CTRL7_XM];
    const int modr = (chip->xm.reg[REG_CTRL5_XM] >> M_ODR_SHIFT) & 0x07;
    switch (quantity) {
    case CHIP_GYR:
        // DS table 22: PD 0 is power-down, PD 1 with no axis is sleep.
        return (ctrl1_g & G_PD) && (ctrl1_g & G_AXES) ? gyro[ctrl1_g >> G_DR_SHIFT]
                                                      : 0.0;
    case CHIP_ACC:
        // DS CTRL_REG1_XM: 3.125 Hz at 1, doubling up to 1600 Hz at 10.
        return aodr == 0 || aodr > A_ODR_LAST ? 0.0 : ldexp(3.125, aodr - 1);
    default:
        if ((ctrl7 & M_MODE) != M_CONTINUOUS) {
            return 0.0;
        }
        // DS CTRL_REG5_XM: 3.125 Hz at 0, doubling up to 100 Hz at 5.
        return modr > M_ODR_100_HZ ? 0.0 : ldexp(3.125, modr);
    }
}

static double period_ns(const struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    const double error_ppm = quantity == CHIP_GYR ? chip->config.g_rate_error_ppm
                                                  : chip->config.xm_rate_error_ppm;
    return 1e9 / (rate_hz(chip, quantity) * (1.0 + error_ppm * 1e-6));
}

void lsm9ds0_chip_set_next_tick(struct lsm9ds0_chip *chip,
                                enum chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    const bool is_booting =
        lsm9ds0_chip_die(chip, lsm9ds0_chip_die_of(quantity))->wait_end != NEVER;
    if (is_booting || rate_hz(chip, quantity) == 0.0) {
        sensor->tick_ns = NEVER;
        return;
    }
    const double at = (double)sensor->tick * period_ns(chip, quantity);
    sensor->tick_ns = sensor->epoch_ns + (uint64_t)llround(at);
}

void lsm9ds0_chip_restart_clock(struct lsm9ds0_chip *chip,
                                enum chip_quantity quantity) {
    chip->sensors[quantity].epoch_ns = chip->base.wire.now_ns;
    chip->sensors[quantity].tick = 1;
    lsm9ds0_chip_set_next_tick(chip, quantity);
}

// A moving average that ends now.
static void low_passed(struct lsm9ds0_chip *chip, enum chip_quantity quantity,
                       double bandwidth_hz, double mean[AXES]) {
    if (chip->base.motion.source.is_recorded) {
        sensor_chip_recorded(&chip->base, quantity, period_ns(chip, quantity), mean);
        return;
    }
    const int64_t now = (int64_t)chip->base.wire.now_ns;
    const int64_t width = (int64_t)llround(0.443e9 / bandwidth_hz);
    chip_motion_mean(&chip->base.motion, quantity, now - width, now, mean);
}

static void sense_gyro(struct lsm9ds0_chip *chip, double counts[AXES]) {
    // DS table 21: cut-off in Hz by DR and BW.
    static const double bandwidth_hz[4][4] = {
        {12.5, 25, 25, 25}, {12.5, 25, 50, 70}, {20, 25, 50, 100}, {30, 35, 50, 100}};
    static const double mdps_per_count[4] = {8.75, 17.50, 70, 70};  // DS table 3: G_So
    // DS table 3: 20 to 250, 70 to 400 and 150 to 1000 deg/s.
    static const double response_part[4] = {0.25, 0.375, 1.0, 1.0};
    static const double self_test_sign[4] = {0, 1, 0, -1};
    const uint8_t ctrl1 = chip->g.reg[REG_CTRL1_G];
    const uint8_t ctrl4 = chip->g.reg[REG_CTRL4_G];
    const int range = (ctrl4 >> G_FS_SHIFT) & 0x03;
    const double part =
        self_test_sign[(ctrl4 >> G_ST_SHIFT) & 0x03] * response_part[range] *
        sensor_chip_response(&chip->base, CHIP_FAULT_GYR_SELF_TEST, LSM9DS0_CHIP_G);
    const bool is_good =
        chip->base.wire.now_ns - chip->gyr_on_ns >= chip->config.gyr_turn_on_ns;
    double mean[AXES];
    low_passed(chip, CHIP_GYR,
               bandwidth_hz[ctrl1 >> G_DR_SHIFT][(ctrl1 >> G_BW_SHIFT) & 0x03], mean);
    for (int axis = 0; axis < AXES; axis++) {
        const double dps =
            mean[axis] / RAD_PER_DEG + part * chip->config.gyr_self_test_dps[axis];
        counts[axis] = is_good ? dps * 1000.0 / mdps_per_count[range] : 0.0;
    }
}

static void sense_accel(struct lsm9ds0_chip *chip, double counts[AXES]) {
    static const double bandwidth_hz[4] = {773, 194, 362, 50};  // DS CTRL_REG2_XM
    // DS table 3: LA_So; the last does not follow from its range.
    static const double mg_per_count[A_FS_LAST + 1] = {0.061, 0.122, 0.183, 0.244,
                                                       0.732};
    static const double self_test_sign[4] = {0, 1, -1, 0};
    const uint8_t ctrl2 = chip->xm.reg[REG_CTRL2_XM];
    const int afs = (ctrl2 >> A_FS_SHIFT) & 0x07;
    const double mg = mg_per_count[afs > A_FS_LAST ? A_FS_LAST : afs];
    const double scale =
        self_test_sign[(ctrl2 >> A_ST_SHIFT) & 0x03] *
        sensor_chip_response(&chip->base, CHIP_FAULT_ACC_SELF_TEST, LSM9DS0_CHIP_XM);
    double mean[AXES];
    low_passed(chip, CHIP_ACC, bandwidth_hz[ctrl2 >> A_BW_SHIFT], mean);
    for (int axis = 0; axis < AXES; axis++) {
        counts[axis] = (mean[axis] * 1000.0 / STANDARD_GRAVITY +
                        scale * chip->config.acc_self_test_mg[axis]) /
                       mg;
    }
}

static void sense_mag(struct lsm9ds0_chip *chip, double counts[AXES]) {
    static const double mgauss_per_count[4] = {0.08, 0.16, 0.32, 0.48};  // DS table 3
    const int range = (chip->xm.reg[REG_CTRL6_XM] >> M_FS_SHIFT) & 0x03;
    const int64_t now = (int64_t)chip->base.wire.now_ns;
    double field_ut[AXES];
    chip_motion_mean(&chip->base.motion, CHIP_MAG, now, now, field_ut);
    for (int axis = 0; axis < AXES; axis++) {
        // 1 uT is 10 mgauss.
        counts[axis] = chip->config.mag_sign[axis] * field_ut[axis] * 10.0 /
                       mgauss_per_count[range];
    }
}

static void put_temperature(struct lsm9ds0_chip *chip) {
    // DS table 4: 8 LSB/degC; 12 bits, right-justified.
    const double counts =
        rint((chip->base.config.temperature_c - chip->config.temperature_zero_c) * 8.0);
    const int16_t value = (int16_t)fmin(fmax(counts, -2048.0), 2047.0);
    st_put(&chip->xm.reg[REG_OUT_TEMP_L_XM], value);
}

static void sense(struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    double counts[AXES];
    if (quantity == CHIP_GYR) {
        sense_gyro(chip, counts);
    } else if (quantity == CHIP_ACC) {
        sense_accel(chip, counts);
    } else {
        sense_mag(chip, counts);
        if (chip->xm.reg[REG_CTRL5_XM] & TEMP_EN) {
            put_temperature(chip);
        }
    }
    for (int axis = 0; axis < AXES; axis++) {
        chip->sensors[quantity].words.latest[axis] =
            chip_motion_to_counts(counts[axis], INT16_MAX);
    }
}

void lsm9ds0_chip_take_sample(struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    const uint8_t die = lsm9ds0_chip_die_of(quantity);
    sensor->tick++;
    lsm9ds0_chip_set_next_tick(chip, quantity);
    if (sensor_chip_is_silent(&chip->base, quantity, die) ||
        (quantity == CHIP_MAG &&
         sensor_chip_suffers(&chip->base, CHIP_FAULT_NO_MAG, die))) {
        return;
    }
    sensor->samples++;
    if (!sensor_chip_suffers(&chip->base, CHIP_FAULT_FROZEN, die)) {
        sense(chip, quantity);
    }
    const struct st_output output = lsm9ds0_chip_output(chip, quantity);
    st_put_sample(&sensor->words, &output);
}
