// SPDX-License-Identifier: MIT
// Samples of gyroscope and accelerometer: the sample clock, the low-pass filters, the
// counts that motion, offsets and self-test make, data-ready.
#include "chip.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define GYRO_START_NS (35 * MS)   // PS 3.1: start-up from sleep, typical
#define ACCEL_START_NS (20 * MS)  // PS 3.2: from sleep
#define INT_PULSE_NS (50 * US)    // PS 3.4.2: tINT
#define BIT_NS 2500               // one bit at 400 kHz

// RM 4.4, 4.6: 32 kHz, 8 kHz, or 1 kHz divided.
static double sample_period_ns(const struct mpu9250_chip *chip) {
    const uint8_t fchoice_b = chip->reg[REG_GYRO_CONFIG] & GYRO_FCHOICE_B;
    const uint8_t dlpf = chip->reg[REG_CONFIG] & DLPF;
    double hz = 0.0;
    if (fchoice_b != 0) {
        hz = 32000.0;
    } else if (dlpf == 0 || dlpf == 7) {
        hz = 8000.0;
    } else {
        hz = 1000.0 / (1.0 + chip->reg[REG_SMPLRT_DIV]);
    }
    return 1e9 / (hz * (1.0 + chip->config.rate_error_ppm * 1e-6));
}

void mpu9250_chip_set_next_tick(struct mpu9250_chip *chip) {
    const uint8_t power = chip->reg[REG_PWR_MGMT_1];
    if (chip->is_asleep || (power & PWR_CLKSEL) == CLKSEL_STOPPED) {
        chip->tick_ns = NEVER;
        return;
    }
    const double at = (double)chip->tick * sample_period_ns(chip);
    chip->tick_ns = chip->epoch_ns + (uint64_t)llround(at);
}

void mpu9250_chip_restart_clock(struct mpu9250_chip *chip) {
    chip->epoch_ns = chip->base.wire.now_ns;
    chip->tick = 1;
    mpu9250_chip_set_next_tick(chip);
}

// RM 4.6: the gyroscope's, by FCHOICE_B and DLPF_CFG.
static struct lowpass gyro_lowpass(const struct mpu9250_chip *chip) {
    static const struct lowpass dlpf[8] = {{250, 0.97}, {184, 2.9},  {92, 3.9},
                                           {41, 5.9},   {20, 9.9},   {10, 17.85},
                                           {5, 33.48},  {3600, 0.17}};
    const uint8_t fchoice_b = chip->reg[REG_GYRO_CONFIG] & GYRO_FCHOICE_B;
    if (fchoice_b & 1) {
        return (struct lowpass){8800, 0.064};  // FCHOICE x0
    }
    if (fchoice_b == 2) {
        return (struct lowpass){3600, 0.11};  // FCHOICE 01
    }
    return dlpf[chip->reg[REG_CONFIG] & DLPF];
}

// RM 4.8, rev 1.6: the accelerometer's, by ACCEL_FCHOICE_B and A_DLPF_CFG.
static struct lowpass accel_lowpass(const struct mpu9250_chip *chip) {
    static const struct lowpass dlpf[8] = {{218.1, 1.88}, {218.1, 1.88}, {99, 2.88},
                                           {44.8, 4.88},  {21.2, 8.87},  {10.2, 16.83},
                                           {5.05, 32.48}, {420, 1.38}};
    const uint8_t config = chip->reg[REG_ACCEL_CONFIG_2];
    return config & ACCEL_FCHOICE_B ? (struct lowpass){1046, 0.503}
                                    : dlpf[config & DLPF];
}

static void put_big_endian(uint8_t *at, int16_t value) {
    at[0] = (uint8_t)((uint16_t)value >> 8);
    at[1] = (uint8_t)((uint16_t)value & 0xFF);
}

// ST 3.2: factory trim in counts at the smallest range.
static double self_test_counts(uint8_t code) {
    return code == 0 ? 0.0 : 2620.0 * pow(1.01, code - 1.0);
}

static void sample_gyro(struct mpu9250_chip *chip) {
    const uint8_t config = chip->reg[REG_GYRO_CONFIG];
    const int range = (config >> RANGE_SHIFT) & 3;
    // RM 4.3: 2^16 counts over 500 deg/s at FS_SEL 0.
    const double counts_per_rad_s = 65536.0 / 500.0 / RAD_PER_DEG / (1 << range);
    double mean[3];
    sensor_chip_low_passed(&chip->base, CHIP_GYR, gyro_lowpass(chip),
                           sample_period_ns(chip), mean);
    const double response =
        sensor_chip_response(&chip->base, CHIP_FAULT_GYR_SELF_TEST, 0);
    for (int axis = 0; axis < 3; axis++) {
        double counts = mean[axis] * counts_per_rad_s;
        if (config & (SELF_TEST_X >> axis)) {
            const uint8_t code = chip->config.gyr_self_test[axis];
            counts += response * self_test_counts(code) / (1 << range);
        }
        const bool is_off = (chip->reg[REG_PWR_MGMT_2] & (4 >> axis)) != 0 ||
                            (chip->reg[REG_PWR_MGMT_1] & PWR_GYRO_STANDBY) != 0 ||
                            chip->base.wire.now_ns - chip->awake_ns < GYRO_START_NS;
        put_big_endian(&chip->inner[REG_GYRO_XOUT_H + 2 * axis],
                       chip_motion_to_counts(is_off ? 0.0 : counts, 32767.0));
    }
}

static void sample_accel(struct mpu9250_chip *chip) {
    const uint8_t config = chip->reg[REG_ACCEL_CONFIG];
    const int range = (config >> RANGE_SHIFT) & 3;
    const double counts_per_m_s2 = 16384.0 / STANDARD_GRAVITY / (1 << range);  // PS 3.2
    double mean[3];
    sensor_chip_low_passed(&chip->base, CHIP_ACC, accel_lowpass(chip),
                           sample_period_ns(chip), mean);
    const double response =
        sensor_chip_response(&chip->base, CHIP_FAULT_ACC_SELF_TEST, 0);
    for (int axis = 0; axis < 3; axis++) {
        double counts = mean[axis] * counts_per_m_s2;
        if (config & (SELF_TEST_X >> axis)) {
            const uint8_t code = chip->config.acc_self_test[axis];
            counts += response * self_test_counts(code) / (1 << range);
        }
        const bool is_off = (chip->reg[REG_PWR_MGMT_2] & (0x20 >> axis)) != 0 ||
                            chip->base.wire.now_ns - chip->awake_ns < ACCEL_START_NS;
        put_big_endian(&chip->inner[REG_ACCEL_XOUT_H + 2 * axis],
                       chip_motion_to_counts(is_off ? 0.0 : counts, 32767.0));
    }
}

void mpu9250_chip_show(struct mpu9250_chip *chip) {
    if (!chip->base.wire.is_transfer) {
        memcpy(&chip->reg[REG_ACCEL_XOUT_H], &chip->inner[REG_ACCEL_XOUT_H],
               REG_EXT_SENS_DATA_23 - REG_ACCEL_XOUT_H + 1);
    }
}

void mpu9250_chip_signal_data_ready(struct mpu9250_chip *chip) {
    chip->reg[REG_INT_STATUS] |= INT_RAW_RDY;
    if (chip->reg[REG_INT_ENABLE] & INT_RAW_RDY) {
        chip->int_level = true;
        const bool is_latched = (chip->reg[REG_INT_PIN_CFG] & INT_LATCH) != 0;
        chip->int_end_ns = is_latched ? NEVER : chip->base.wire.now_ns + INT_PULSE_NS;
    }
}

void mpu9250_chip_take_sample(struct mpu9250_chip *chip) {
    chip->tick++;
    mpu9250_chip_set_next_tick(chip);
    if (sensor_chip_suffers(&chip->base, CHIP_FAULT_NO_DATA_READY, 0)) {
        return;
    }
    chip->samples++;
    if (!sensor_chip_suffers(&chip->base, CHIP_FAULT_FROZEN, 0)) {
        sample_gyro(chip);
        sample_accel(chip);
        // RM 4.23, PS 3.4.2: 333.87 LSB/degC, 0 at 21 degC.
        put_big_endian(&chip->inner[REG_TEMP_OUT_H],
                       chip_motion_to_counts(
                           (chip->base.config.temperature_c - 21.0) * 333.87, 32767));
    }
    mpu9250_chip_show(chip);
    // A round of the I2C master that is still under way continues; this sample has
    // none.
    const bool runs_aux = (chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) != 0;
    if (runs_aux && chip->aux.byte_ns == NEVER) {
        chip->waits_for_aux =
            (chip->reg[REG_I2C_MST_CTRL] & MST_WAIT_FOR_ES) != 0;  // RM 4.12
        if (!chip->waits_for_aux) {
            mpu9250_chip_signal_data_ready(chip);
        }
        mpu9250_chip_begin_aux(chip);
        return;
    }
    mpu9250_chip_signal_data_ready(chip);
}
