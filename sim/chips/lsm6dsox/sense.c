// SPDX-License-Identifier: MIT
// What the sensors measure: their low-pass filters, the counts that motion, self-test,
// offset registers and temperature make.
#include "chip.h"

#include <math.h>
#include <stddef.h>

enum { CODES = ODR_LAST, FTYPES = 8 };

// The code of a rate, 0 for 12.5 Hz.
static int code_of(uint8_t reg) {
    const int code = reg >> ODR_SHIFT;
    return code >= 1 && code <= CODES ? code - 1 : 0;
}

static struct lowpass gyro_lowpass(const struct lsm6dsox_chip *chip) {
    // DS table 18.
    static const double lpf2_hz[CODES] = {4.2,   8.3,   16.6,   33.0,   66.8,
                                          135.9, 295.5, 1108.1, 1320.7, 1441.8};
    // DS table 60: of both together, by FTYPE.
    static const double overall_hz[FTYPES][CODES] = {
        {4.2, 8.3, 16.6, 33.0, 67.0, 136.6, 239.2, 304.2, 328.5, 335.5},
        {4.2, 8.3, 16.6, 33.0, 67.0, 130.5, 192.4, 220.7, 229.6, 232.0},
        {4.2, 8.3, 16.6, 33.0, 67.0, 120.3, 154.2, 166.6, 170.1, 171.1},
        {4.2, 8.3, 16.6, 33.0, 67.0, 137.1, 281.8, 453.2, 559.2, 609.0},
        {4.2, 8.3, 16.7, 33.0, 62.4, 86.7, 96.6, 99.6, 100.4, 100.6},
        {4.2, 8.3, 16.8, 31.0, 43.2, 48.0, 49.4, 49.8, 49.9, 49.9},
        {4.1, 7.8, 13.4, 19.0, 23.1, 24.6, 25.0, 25.1, 25.1, 25.1},
        {3.9, 6.7, 9.7, 11.5, 12.2, 12.4, 12.5, 12.5, 12.5, 12.5},
    };
    // QC: gyro_group_delay.
    static const double delay_ms[CODES] = {74.79, 38.89, 19.44, 9.72, 4.86,
                                           2.46,  1.26,  0.69,  0.42, 0.28};
    const uint8_t *reg = chip->die.reg;
    const int code = code_of(reg[REG_CTRL2_G]);
    // AN 3.8: LPF1 works in high performance alone.
    if (!(reg[REG_CTRL4_C] & LPF1_SEL_G) || (reg[REG_CTRL7_G] & G_HM_MODE)) {
        return (struct lowpass){lpf2_hz[code], delay_ms[code]};
    }
    const double(*row)[CODES] = &overall_hz[reg[REG_CTRL6_C] & FTYPE];
    // At 6.67 kHz the LSM6DSO data sheet has 6.69, 8.78 and 11.18 degrees at 20 Hz for
    // FTYPE 0 to 2 (its table 151): the 0.28 ms above and 218 / bandwidth ms.
    const double lpf1_ms = 218.0 / (*row)[CODES - 1];
    return (struct lowpass){(*row)[code], delay_ms[code] + lpf1_ms};
}

static struct lowpass accel_lowpass(const struct lsm6dsox_chip *chip) {
    // DS table 65, by HPCF_XL.
    static const double share[8] = {4, 10, 20, 45, 100, 200, 400, 800};
    // QC: accel_group_delay.
    static const double delay_ms[CODES] = {57.69, 28.89, 14.44, 7.22, 3.74,
                                           1.93,  1.03,  0.58,  0.36, 0.25};
    const uint8_t *reg = chip->die.reg;
    const double hz = 1e9 / lsm6dsox_chip_period_ns(chip, ACC);
    const int code = code_of(reg[REG_CTRL1_XL]);
    struct lowpass setting = {hz / 2.0, delay_ms[code]};
    if ((reg[REG_CTRL6_C] & XL_HM_MODE) && code < ODR_208_HZ) {
        // DS figure 17: LPF1 has 700 Hz in low power and normal mode. Its delay: that
        // of a Butterworth filter of second order, 0.225 / bandwidth.
        setting = (struct lowpass){700.0, 225.0 / 700.0};
    }
    if (reg[REG_CTRL1_XL] & LPF2_XL_EN) {
        setting.bandwidth_hz = hz / share[reg[REG_CTRL8_XL] >> HPCF_XL_SHIFT];
        setting.delay_ms += 225.0 / setting.bandwidth_hz;
    }
    return setting;
}

static void low_passed(const struct lsm6dsox_chip *chip, enum source source,
                       struct lowpass lowpass, double mean[AXES]) {
    sensor_chip_low_passed(&chip->base, source == GYR ? CHIP_GYR : CHIP_ACC, lowpass,
                           lsm6dsox_chip_period_ns(chip, source), mean);
}

static void sense_gyro(struct lsm6dsox_chip *chip, double counts[AXES]) {
    // SO and DS: 250, 500, 1000, 2000, 125 deg/s; AD: 4000.
    static const double mdps_per_count[LSM6DSOX_CHIP_RANGES] = {8.75, 17.50, 35.0,
                                                                70.0, 4.375, 140.0};
    static const int slot[LSM6DSOX_CHIP_RANGES] = {1, 2, 3, 4, 0, 5};
    static const double sign[4] = {0, 1, 0, -1};  // DS table 55
    const uint8_t ctrl2 = chip->die.reg[REG_CTRL2_G];
    int range = (ctrl2 >> FS_SHIFT) & FS_MASK;
    if (chip->config.has_4000_dps && (ctrl2 & FS_4000)) {
        range = 5;
    } else if (ctrl2 & FS_125) {
        range = 4;
    }
    const uint8_t test = (chip->die.reg[REG_CTRL5_C] >> ST_G_SHIFT) & ST_MASK;
    const double response_dps =
        sign[test] * sensor_chip_response(&chip->base, CHIP_FAULT_GYR_SELF_TEST, DIE) *
        chip->config.gyr_self_test_dps[slot[range]];
    const bool is_good =
        chip->base.wire.now_ns - chip->gyr_on_ns >= chip->config.gyr_turn_on_ns;
    double mean[AXES];
    low_passed(chip, GYR, gyro_lowpass(chip), mean);
    for (int axis = 0; axis < AXES; axis++) {
        const double dps = mean[axis] / RAD_PER_DEG + response_dps;
        counts[axis] = is_good ? dps * 1000.0 / mdps_per_count[range] : 0.0;
    }
}

static void sense_accel(struct lsm6dsox_chip *chip, double counts[AXES]) {
    // AD: the code's order is 2, 16, 4, 8 g, as DS table 45 has 4, 32, 8, 16 g.
    static const double mg_per_count[4] = {0.061, 0.488, 0.122, 0.244};
    static const double sign[4] = {0, 1, -1, 0};  // DS table 56
    const uint8_t *reg = chip->die.reg;
    const double mg = mg_per_count[(reg[REG_CTRL1_XL] >> FS_SHIFT) & FS_MASK];
    const double test =
        sign[reg[REG_CTRL5_C] & ST_MASK] *
        sensor_chip_response(&chip->base, CHIP_FAULT_ACC_SELF_TEST, DIE);
    // DS table 58: 2^-10 or 2^-6 g; DS 9.53: subtracted.
    const double offset_mg = 1000.0 / ((reg[REG_CTRL6_C] & USR_OFF_W) ? 64.0 : 1024.0);
    const bool has_offset = (reg[REG_CTRL7_G] & USR_OFF_ON_OUT) != 0;
    double mean[AXES];
    low_passed(chip, ACC, accel_lowpass(chip), mean);
    for (int axis = 0; axis < AXES; axis++) {
        const int8_t user = (int8_t)reg[REG_X_OFS_USR + axis];
        counts[axis] = (mean[axis] * 1000.0 / STANDARD_GRAVITY +
                        test * chip->config.acc_self_test_mg[axis] -
                        (has_offset ? user * offset_mg : 0.0)) /
                       mg;
    }
}

void lsm6dsox_chip_sense(struct lsm6dsox_chip *chip, enum source source) {
    double counts[AXES] = {0.0, 0.0, 0.0};
    if (source == GYR) {
        sense_gyro(chip, counts);
    } else if (source == ACC) {
        sense_accel(chip, counts);
    } else {
        // DS table 5: 256 LSB/degC, 0 at 25 degC.
        counts[0] = (chip->base.config.temperature_c +
                     chip->config.temperature_error_c - 25.0) *
                    256.0;
    }
    const double scale = chip->sensors[source].settling > 0 ? 0.5 : 1.0;
    for (int axis = 0; axis < AXES; axis++) {
        chip->sensors[source].words.latest[axis] =
            chip_motion_to_counts(scale * counts[axis], INT16_MAX);
    }
}
