// SPDX-License-Identifier: MIT
// The steps of set-up, and bursts to samples; documents: mpu9250_private.h.
#include "core/drivers/mpu9250_private.h"

#include <string.h>

#include "core/math/fixed.h"
#include "core/wire/messages.h"

enum {
    REG_SMPLRT_DIV = 0x19,   // RM 25; then CONFIG, GYRO_CONFIG, ACCEL_CONFIG,
                             // ACCEL_CONFIG_2 (RM 26 to 29)
    REG_INT_PIN_CFG = 0x37,  // RM 55; then INT_ENABLE (RM 56)
    REG_INT_STATUS = 0x3A,   // RM 58
    REG_PWR_MGMT_1 = 0x6B,   // RM 107; then PWR_MGMT_2 (RM 108)
    REG_WHO_AM_I = 0x75,     // RM 117

    H_RESET = 0x80,       // PWR_MGMT_1
    CLKSEL_AUTO = 0x01,   // PWR_MGMT_1: the gyroscope's PLL once it runs
    RAW_DATA_RDY = 0x01,  // INT_STATUS, INT_ENABLE
    DLPF_2 = 0x02,        // gyroscope 92 Hz, accelerometer 99 Hz, both at 1 kHz
    // A pulse of 50 us, active high, push-pull: an edge a sample whether the one before
    // it was read or not, so that one lost burst can't end the stream.
    INT_PULSE = 0x00,

    MPU9250_WHO = 0x71,
    MPU9255_WHO = 0x73,
    MPU6500_WHO = 0x70,
};

enum {
    TICK_US = 1024,  // a wait of n ticks lasts more than n - 1
    // PS 3.4.2: registers answer 100 ms after power at the latest; of H_RESET nothing
    // better is said. A tenth more, for clocks that differ.
    STARTUP_TICKS = 110,
    GYRO_START_TICKS = 50,  // PS 3.1: 35 ms typical
    DATA_READY_TICKS = 50,  // ten samples
};

enum {
    REG_SELF_TEST_X_GYRO = 0x00,   // RM 0 to 2
    REG_SELF_TEST_X_ACCEL = 0x0D,  // RM 13 to 15

    STIMULUS_ON = 0xE0,  // GYRO_CONFIG, ACCEL_CONFIG: all three axes

    TEST_PERIOD_TICKS = 1,  // AN 3: read at 1 kHz
    TEST_SAMPLES = 200,     // AN 3

    // In sums of TEST_SAMPLES, at 131 LSB a deg/s and 16384 LSB a g (AN 3.3).
    GYRO_OFFSET_MAX = UINT32_C(20) * 131 * TEST_SAMPLES,
    GYRO_RESPONSE_MIN = UINT32_C(60) * 131 * TEST_SAMPLES,
    ACC_RESPONSE_MIN = UINT32_C(225) * 16384 / 1000 * TEST_SAMPLES,
    ACC_RESPONSE_MAX = UINT32_C(675) * 16384 / 1000 * TEST_SAMPLES,
    // How far a rate may stray from the first of a run: 2.5 deg/s, 17 times the rms of
    // such a difference by the chip's noise (PS 3.1: 0.1 deg/s rms).
    MOVING = 5 * 131 / 2,
};

bool mpu9250_read(const struct bus_device *bus, uint8_t reg, uint8_t *data,
                  uint8_t length) {
    return bus->read(bus->port, MPU9250_ADDRESS, reg, data, length) == BUS_OK;
}

bool mpu9250_write(const struct bus_device *bus, uint8_t reg, const uint8_t *data,
                   uint8_t length) {
    return bus->write(bus->port, MPU9250_ADDRESS, reg, data, length) == BUS_OK;
}

bool mpu9250_write_one(const struct bus_device *bus, uint8_t reg, uint8_t value) {
    return mpu9250_write(bus, reg, &value, 1);
}

bool mpu9250_configure(const struct bus_device *bus, uint8_t divider, uint8_t ranges) {
    const uint8_t values[] = {divider, DLPF_2, ranges, ranges, DLPF_2};
    return mpu9250_write(bus, REG_SMPLRT_DIV, values, sizeof values);
}

static int16_t big_endian(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[0] * 256u + bytes[1]);
}

enum sensor_result mpu9250_go_on(struct mpu9250 *chip, uint16_t now, uint8_t wait) {
    ++chip->step;
    chip->count = 0;
    chip->since = now;
    chip->wait = wait;
    return SENSOR_BUSY;
}

bool mpu9250_is_within(const struct mpu9250 *chip, uint16_t now, uint8_t wait) {
    return (uint16_t)(now - chip->since) < wait;
}

static enum sensor_result identify(struct mpu9250 *chip, const struct bus_device *bus,
                                   uint16_t now) {
    struct sensor_identity *identity = &chip->identity;
    if (!mpu9250_read(bus, REG_WHO_AM_I, &identity->who_am_i[0], 1)) {
        return SENSOR_BUS_FAILED;
    }
    switch (identity->who_am_i[0]) {
    case MPU9250_WHO:
    case MPU9255_WHO:
        identity->kind = SENSOR_MPU9250;
        break;
    case MPU6500_WHO:
        identity->kind = SENSOR_MPU6500;
        break;
    default:
        return SENSOR_WRONG_CHIP;
    }
    identity->rate_hz = MPU9250_RATE_HZ;
    identity->gyr_delay_us = MPU9250_GYR_DELAY_US;
    identity->gyr_lsb_nrad_s = 1065264;  // 2000 deg/s / 32768
    identity->acc_lsb_nm_s2 = 4788403;   // 16 * 9.80665 m/s2 / 32768
    identity->mag_lsb_pt = 150000;       // AK 5: 0.15 uT
    const uint8_t awake[] = {CLKSEL_AUTO, 0};
    if (!mpu9250_write(bus, REG_PWR_MGMT_1, awake, sizeof awake)) {
        return SENSOR_BUS_FAILED;
    }
    return mpu9250_go_on(chip, now, GYRO_START_TICKS);
}

// The self-test of accelerometer and gyroscope: how they answer to a stimulus, against
// what they did in the factory (AN 3).

// Begins a run of TEST_SAMPLES with the stimulus on or off.
static enum sensor_result test_run(struct mpu9250 *chip, const struct bus_device *bus,
                                   uint16_t now, uint8_t stimulus) {
    if (!mpu9250_configure(bus, 0, stimulus)) {
        return SENSOR_BUS_FAILED;
    }
    return mpu9250_go_on(chip, now, MPU9250_SETTLE_TICKS);
}

static enum sensor_result test_begin(struct mpu9250 *chip, const struct bus_device *bus,
                                     uint16_t now) {
    if (chip->identity.self_test != 0) {
        chip->step = MPU9250_MAG_BEGIN;
        return SENSOR_BUSY;
    }
    return test_run(chip, bus, now, 0);
}

static enum sensor_result test_sample(struct mpu9250 *chip,
                                      const struct bus_device *bus, uint16_t now) {
    uint8_t bytes[MPU9250_INERTIAL_BYTES];
    if (!mpu9250_read(bus, MPU9250_REG_ACCEL_XOUT_H, bytes, sizeof bytes)) {
        return SENSOR_BUS_FAILED;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        self_test_add(&chip->test.sums, axis, big_endian(bytes + 2 * axis),
                      big_endian(bytes + MPU9250_GYR_PLACE + 2 * axis),
                      chip->count == 0, MOVING);
    }
    chip->since = now;
    chip->wait = TEST_PERIOD_TICKS;
    ++chip->count;
    return chip->count < TEST_SAMPLES ? SENSOR_BUSY : mpu9250_go_on(chip, now, 0);
}

static enum sensor_result test_turn(struct mpu9250 *chip, const struct bus_device *bus,
                                    uint16_t now) {
    self_test_turn(&chip->test.sums);
    for (uint8_t i = 3; i < 6; ++i) {
        if (fixed_magnitude(chip->test.sums.response[i]) > GYRO_OFFSET_MAX) {
            chip->test.is_offset = true;
        }
    }
    return test_run(chip, bus, now, STIMULUS_ON);
}

// 2620 * 1.01^(code - 1), AN 3.2, for codes 1 to 255, to the nearest.
static uint16_t factory_trim(uint8_t code) {
    uint32_t trim = UINT32_C(2149859918);    // 2620 * 1.01^254 * 2^16
    uint32_t factor = UINT32_C(4252442867);  // 2^32 / 1.01, then its squares
    for (uint8_t missing = (uint8_t)(255 - code); missing != 0; missing /= 2) {
        if (missing % 2 != 0) {
            trim = fixed_umul_q32(trim, factor);
        }
        factor = fixed_umul_q32(factor, factor);
    }
    return (uint16_t)((trim + 32768) / 65536);
}

// AN 3.3: an axis against its factory value or, where it has none, against fixed
// limits. The trim is at most 32804, so that 300 of it fit.
static bool axis_passes(int32_t response, uint8_t code, bool is_gyr) {
    if (code == 0) {
        const uint32_t size = fixed_magnitude(response);
        return is_gyr ? size >= GYRO_RESPONSE_MIN
                      : size >= ACC_RESPONSE_MIN && size <= ACC_RESPONSE_MAX;
    }
    const int32_t half = (int32_t)factory_trim(code) * (TEST_SAMPLES / 2);
    return response > half && (is_gyr || response < 3 * half);
}

static enum sensor_result test_end(struct mpu9250 *chip, const struct bus_device *bus,
                                   uint16_t now) {
    const int32_t *response = chip->test.sums.response;
    uint8_t codes[6];
    if (!mpu9250_read(bus, REG_SELF_TEST_X_ACCEL, codes, 3) ||
        !mpu9250_read(bus, REG_SELF_TEST_X_GYRO, codes + 3, 3)) {
        return SENSOR_BUS_FAILED;
    }
    bool acc_passes = true;
    bool gyr_passes = !chip->test.is_offset;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        acc_passes &= axis_passes(response[axis], codes[axis], false);
        gyr_passes &= axis_passes(response[axis + 3], codes[axis + 3], true);
    }
    self_test_end(&chip->test.sums, &chip->identity, acc_passes, gyr_passes);
    return mpu9250_go_on(chip, now, 0);
}

static enum sensor_result run(struct mpu9250 *chip, const struct bus_device *bus,
                              uint16_t now) {
    const uint8_t interrupt[] = {INT_PULSE, RAW_DATA_RDY};
    return mpu9250_write(bus, REG_INT_PIN_CFG, interrupt, sizeof interrupt)
               ? mpu9250_go_on(chip, now, MPU9250_SETTLE_TICKS)
               : SENSOR_BUS_FAILED;
}

static enum sensor_result ready(struct mpu9250 *chip, const struct bus_device *bus,
                                uint16_t now) {
    uint8_t status;
    if (!mpu9250_read(bus, REG_INT_STATUS, &status, 1)) {
        return SENSOR_BUS_FAILED;
    }
    if ((status & RAW_DATA_RDY) != 0) {
        (void)mpu9250_go_on(chip, now, 0);
        return SENSOR_OK;
    }
    return mpu9250_is_within(chip, now, MPU9250_SETTLE_TICKS + DATA_READY_TICKS)
               ? SENSOR_BUSY
               : SENSOR_STUCK;
}

void mpu9250_begin(void *state) {
    struct mpu9250 *chip = state;
    const uint8_t verdict = chip->identity.self_test &
                            (uint8_t) ~(SELF_TEST_MAG_PASSED | SELF_TEST_MAG_FAILED);
    memset(chip, 0, sizeof *chip);
    chip->identity.self_test = verdict;
}

enum sensor_result mpu9250_setup(void *state, const struct bus_device *bus,
                                 uint32_t now_us) {
    struct mpu9250 *chip = state;
    // Ticks wrap after 67 s, at the wrap of now_us too: waits are far shorter.
    const uint16_t now = (uint16_t)(now_us / TICK_US);
    if (mpu9250_is_within(chip, now, chip->wait)) {
        return SENSOR_BUSY;
    }
    switch ((enum mpu9250_step)chip->step) {
    case MPU9250_POWER_UP:
        return mpu9250_go_on(chip, now, STARTUP_TICKS);
    case MPU9250_RESET:
        return mpu9250_write_one(bus, REG_PWR_MGMT_1, H_RESET)
                   ? mpu9250_go_on(chip, now, STARTUP_TICKS)
                   : SENSOR_BUS_FAILED;
    case MPU9250_IDENTIFY:
        return identify(chip, bus, now);
    case MPU9250_TEST_BEGIN:
        return test_begin(chip, bus, now);
    case MPU9250_TEST_TURN:
        return test_turn(chip, bus, now);
    case MPU9250_TEST_OFF:
    case MPU9250_TEST_ON:
        return test_sample(chip, bus, now);
    case MPU9250_TEST_END:
        return test_end(chip, bus, now);
    case MPU9250_MAG_BEGIN:
        return mpu9250_mag_begin(chip, bus, now);
    case MPU9250_MAG_TRANSFERS:
        return mpu9250_mag_transfer(chip, bus, now);
    case MPU9250_RUN:
        return run(chip, bus, now);
    case MPU9250_READY:
        return ready(chip, bus, now);
    case MPU9250_DONE:
        break;
    }
    return SENSOR_OK;
}

// Three axes; true where one is at the end of its range.
static bool take_axes(const uint8_t *bytes, struct counts *out) {
    bool is_clipped = false;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int16_t value = big_endian(bytes + 2 * axis);
        is_clipped |= value == INT16_MAX || value <= -INT16_MAX;
        out->axis[axis] = value;
    }
    return is_clipped;
}

// What a bus reads that nobody drives or that is held: no reading.
static bool is_no_reading(const uint8_t *bytes) {
    for (uint8_t i = 1; i < MPU9250_INERTIAL_BYTES; ++i) {
        if (bytes[i] != bytes[0]) {
            return false;
        }
    }
    return bytes[0] == 0x00 || bytes[0] == 0xFF;
}

bool mpu9250_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                   struct sample *out) {
    struct mpu9250 *chip = state;
    if (is_no_reading(bytes)) {
        return false;
    }
    out->time_us = time_us;
    out->acc_clipped = take_axes(bytes, &out->acc);
    out->gyr_clipped = take_axes(bytes + MPU9250_GYR_PLACE, &out->gyr);
    // RM 65: TEMP_OUT / 333.87 + 21 degC; 19629 is 100 / 333.87 * 2^16.
    out->temperature_cdeg =
        (int16_t)(fixed_scale_down(big_endian(bytes + 6) * INT32_C(19629), 16) + 2100);
    out->mag = (struct counts){0};
    out->has_mag = false;
    out->mag_overflow = false;
    if (chip->has_mag) {
        mpu9250_mag_parse(chip, bytes + MPU9250_INERTIAL_BYTES, out);
    }
    return true;
}

const struct sensor_identity *mpu9250_identity(const void *state) {
    const struct mpu9250 *chip = state;
    return &chip->identity;
}

uint8_t mpu9250_bursts(const void *state, struct bus_burst *out) {
    const struct mpu9250 *chip = state;
    out[0].address = MPU9250_ADDRESS;
    out[0].reg = MPU9250_REG_ACCEL_XOUT_H;
    out[0].length = chip->has_mag ? MPU9250_INERTIAL_BYTES + MPU9250_MAG_BYTES
                                  : MPU9250_INERTIAL_BYTES;
    return 1;
}
