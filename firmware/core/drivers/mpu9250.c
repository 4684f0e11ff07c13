// SPDX-License-Identifier: MIT
// Set-up of the MPU-9250 and its AK8963, and bursts to samples.
//
// Documents: RM = RM-MPU-9250A-00 rev 1.6 (registers, by their decimal number), PS =
// PS-MPU-9250A-01 rev 1.0, AN = AN-MPU-9250A-03 rev 1.0 (self-test), AK = AK8963 data
// sheet MS1356-E-02.
#include "core/drivers/mpu9250.h"

#include <string.h>

#include "core/math/fixed.h"
#include "core/wire/messages.h"

enum {
    REG_SELF_TEST_X_GYRO = 0x00,   // RM 0 to 2
    REG_SELF_TEST_X_ACCEL = 0x0D,  // RM 13 to 15
    REG_SMPLRT_DIV = 0x19,         // RM 25; then CONFIG, GYRO_CONFIG, ACCEL_CONFIG,
                                   // ACCEL_CONFIG_2 (RM 26 to 29)
    REG_I2C_MST_CTRL = 0x24,       // RM 36
    REG_I2C_SLV0_ADDR = 0x25,      // RM 37; then REG, CTRL
    REG_I2C_SLV4_ADDR = 0x31,      // RM 49; then REG, DO, CTRL
    REG_I2C_SLV4_DI = 0x35,        // RM 53
    REG_I2C_MST_STATUS = 0x36,     // RM 54, cleared by reading
    REG_INT_PIN_CFG = 0x37,        // RM 55; then INT_ENABLE (RM 56)
    REG_INT_STATUS = 0x3A,         // RM 58
    REG_ACCEL_XOUT_H = 0x3B,       // RM 59 to 72: acc, temperature, gyr, big-endian;
                                   // then EXT_SENS_DATA (RM 73)
    REG_USER_CTRL = 0x6A,          // RM 106
    REG_PWR_MGMT_1 = 0x6B,         // RM 107; then PWR_MGMT_2 (RM 108)
    REG_WHO_AM_I = 0x75,           // RM 117

    H_RESET = 0x80,       // PWR_MGMT_1
    CLKSEL_AUTO = 0x01,   // PWR_MGMT_1: the gyroscope's PLL once it runs
    I2C_MST_EN = 0x20,    // USER_CTRL
    MST_CTRL = 0x4D,      // WAIT_FOR_ES: INT comes after the AK8963's bytes; 400 kHz
    SLAVE_READ = 0x80,    // I2C_SLVx_ADDR
    SLAVE_ENABLE = 0x80,  // I2C_SLVx_CTRL
    SLV4_DONE = 0x40,     // I2C_MST_STATUS
    SLV4_NACK = 0x10,     // I2C_MST_STATUS
    RAW_DATA_RDY = 0x01,  // INT_STATUS, INT_ENABLE
    SELF_TEST_ON = 0xE0,  // GYRO_CONFIG, ACCEL_CONFIG: all three axes
    FULL_SCALE_3 = 0x18,  // 2000 deg/s, 16 g
    DLPF_2 = 0x02,        // gyroscope 92 Hz, accelerometer 99 Hz, both at 1 kHz
    // A pulse of 50 us, active high, push-pull: an edge a sample whether the one before
    // it was read or not, so that one lost burst can't end the stream.
    INT_PULSE = 0x00,

    MPU9250_WHO = 0x71,
    MPU9255_WHO = 0x73,
    MPU6500_WHO = 0x70,

    INERTIAL_BYTES = 14,
    MAG_BYTES = 8,  // ST1, three axes little-endian, ST2
};

enum {
    AK8963_ADDRESS = 0x0C,  // AK 7.2
    AK8963_ID = 0x48,       // AK 8.3: WIA

    AK_WIA = 0x00,
    AK_ST1 = 0x02,
    AK_HXL = 0x03,
    AK_CNTL1 = 0x0A,
    AK_CNTL2 = 0x0B,
    AK_ASTC = 0x0C,
    AK_ASAX = 0x10,

    ST1_DRDY = 0x01,
    ST1_DOR = 0x02,
    ST2_HOFL = 0x08,
    ST2_BITM = 0x10,  // mirrors CNTL1: 16 bits

    MODE_POWER_DOWN = 0x00,
    MODE_FUSE = 0x0F,
    MODE_SELF_TEST = 0x18,     // 16 bits
    MODE_CONTINUOUS_2 = 0x16,  // 100 Hz, 16 bits
    SRST = 0x01,
    SELF_FIELD_ON = 0x40,

    AK_COUNTS_MAX = 32760,  // AK 8.3: measurement data, 4912 uT
};

enum {
    TICK_US = 1024,  // a wait of n ticks lasts more than n - 1
    // PS 3.4.2: registers answer 100 ms after power at the latest; of H_RESET nothing
    // better is said. A tenth more, for clocks that differ.
    STARTUP_TICKS = 110,
    GYRO_START_TICKS = 50,  // PS 3.1: 35 ms typical
    SETTLE_TICKS = 21,      // AN 3: 20 ms after the stimulus, or a range, changes
    TEST_PERIOD_TICKS = 1,  // AN 3: read at 1 kHz
    TEST_SAMPLES = 200,     // AN 3
    TRANSFER_TICKS = 20,    // the chip's master starts one at the next sample
    // Of a transfer that is refused or brings no data-ready, 1 ms or more each: a
    // measurement of the AK8963 takes 9 ms at most (AK 5).
    TRANSFER_TRIES = 50,
    DATA_READY_TICKS = 50,  // ten samples

    // In sums of TEST_SAMPLES, at 131 LSB a deg/s and 16384 LSB a g (AN 3.3).
    GYRO_OFFSET_MAX = UINT32_C(20) * 131 * TEST_SAMPLES,
    GYRO_RESPONSE_MIN = UINT32_C(60) * 131 * TEST_SAMPLES,
    ACC_RESPONSE_MIN = UINT32_C(225) * 16384 / 1000 * TEST_SAMPLES,
    ACC_RESPONSE_MAX = UINT32_C(675) * 16384 / 1000 * TEST_SAMPLES,
    // How far a rate may stray from the first of a run: 2.5 deg/s, 17 times the rms of
    // such a difference by the chip's noise (PS 3.1: 0.1 deg/s rms).
    MOVING = 5 * 131 / 2,
};

enum step {
    POWER_UP,
    RESET,
    IDENTIFY,
    TEST_BEGIN,
    TEST_OFF,
    TEST_TURN,
    TEST_ON,
    TEST_END,
    MAG_BEGIN,
    MAG_TRANSFERS,
    RUN,
    READY,
    DONE,
};

// The AK8963's set-up, a transfer each, a millisecond and more apart: it wants 100 us
// between two modes (AK 6.3).
enum transfer {
    MAG_RESET,
    MAG_IDENTIFY,
    MAG_FUSE,
    MAG_ADJUST,  // three bytes
    MAG_FUSE_END = MAG_ADJUST + 3,
    MAG_FIELD_ON,
    MAG_TEST,
    MAG_TEST_READY,
    MAG_TEST_DATA,  // six bytes
    MAG_FIELD_OFF = MAG_TEST_DATA + 6,
    MAG_TEST_END,
    MAG_CONTINUOUS,
    MAG_DONE,
};

static bool read_registers(const struct bus_device *bus, uint8_t reg, uint8_t *data,
                           uint8_t length) {
    return bus->read(bus->port, MPU9250_ADDRESS, reg, data, length) == BUS_OK;
}

static bool write_registers(const struct bus_device *bus, uint8_t reg,
                            const uint8_t *data, uint8_t length) {
    return bus->write(bus->port, MPU9250_ADDRESS, reg, data, length) == BUS_OK;
}

static bool write_register(const struct bus_device *bus, uint8_t reg, uint8_t value) {
    return write_registers(bus, reg, &value, 1);
}

// Rate divider and both ranges, with the filters that all uses share.
static bool configure(const struct bus_device *bus, uint8_t divider, uint8_t ranges) {
    const uint8_t values[] = {divider, DLPF_2, ranges, ranges, DLPF_2};
    return write_registers(bus, REG_SMPLRT_DIV, values, sizeof values);
}

_Static_assert(SELF_TEST_ACC_FAILED == SELF_TEST_ACC_PASSED * 16 &&
                   SELF_TEST_GYR_FAILED == SELF_TEST_GYR_PASSED * 16 &&
                   SELF_TEST_MAG_FAILED == SELF_TEST_MAG_PASSED * 16,
               "a sensor's flags are four bits apart");

static void add_verdict(struct mpu9250 *chip, uint8_t passed, bool passes) {
    const uint8_t flag = passes ? passed : (uint8_t)(passed * 16);
    chip->identity.self_test = (uint8_t)(chip->identity.self_test | flag);
}

static int16_t big_endian(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[0] * 256u + bytes[1]);
}

static int16_t little_endian(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[1] * 256u + bytes[0]);
}

// H * ((ASA - 128) * 0.5 / 128 + 1), AK 8.3; |counts| <= 32768 and ASA <= 255 keep the
// result within 49152.
static int32_t adjusted(int16_t counts, uint8_t adjust) {
    return fixed_scale_down(counts * (INT32_C(128) + adjust), 8);
}

// On to the next step, after a wait.
static enum sensor_result go_on(struct mpu9250 *chip, uint16_t now, uint8_t wait) {
    ++chip->step;
    chip->count = 0;
    chip->since = now;
    chip->wait = wait;
    return SENSOR_BUSY;
}

static bool is_within(const struct mpu9250 *chip, uint16_t now, uint8_t wait) {
    return (uint16_t)(now - chip->since) < wait;
}

static enum sensor_result identify(struct mpu9250 *chip, const struct bus_device *bus,
                                   uint16_t now) {
    struct sensor_identity *identity = &chip->identity;
    if (!read_registers(bus, REG_WHO_AM_I, &identity->who_am_i[0], 1)) {
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
    if (!write_registers(bus, REG_PWR_MGMT_1, awake, sizeof awake)) {
        return SENSOR_BUS_FAILED;
    }
    return go_on(chip, now, GYRO_START_TICKS);
}

// Begins a run of TEST_SAMPLES with the stimulus on or off.
static enum sensor_result test_run(struct mpu9250 *chip, const struct bus_device *bus,
                                   uint16_t now, uint8_t stimulus) {
    if (!configure(bus, 0, stimulus)) {
        return SENSOR_BUS_FAILED;
    }
    return go_on(chip, now, SETTLE_TICKS);
}

// Adds one sample of a run; TEST_SAMPLES * 32768 fit by far.
static enum sensor_result test_sample(struct mpu9250 *chip,
                                      const struct bus_device *bus, uint16_t now) {
    uint8_t bytes[INERTIAL_BYTES];
    if (!read_registers(bus, REG_ACCEL_XOUT_H, bytes, sizeof bytes)) {
        return SENSOR_BUS_FAILED;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int16_t gyr = big_endian(bytes + 8 + 2 * axis);
        chip->test.response[axis] += big_endian(bytes + 2 * axis);
        chip->test.response[axis + 3] += gyr;
        if (chip->count == 0) {
            chip->test.gyr_first[axis] = gyr;
        }
        if (fixed_magnitude((int32_t)gyr - chip->test.gyr_first[axis]) > MOVING) {
            chip->test.is_moving = true;
        }
    }
    chip->since = now;
    chip->wait = TEST_PERIOD_TICKS;
    ++chip->count;
    return chip->count < TEST_SAMPLES ? SENSOR_BUSY : go_on(chip, now, 0);
}

// Between the runs: the one without stimulus counts against the other.
static enum sensor_result test_turn(struct mpu9250 *chip, const struct bus_device *bus,
                                    uint16_t now) {
    for (uint8_t i = 0; i < 6; ++i) {
        int32_t *response = &chip->test.response[i];
        if (i >= 3 && fixed_magnitude(*response) > GYRO_OFFSET_MAX) {
            chip->test.is_offset = true;
        }
        *response = -*response;
    }
    return test_run(chip, bus, now, SELF_TEST_ON);
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

// The verdict on the inertial dies; a failure while moving is none.
static enum sensor_result test_end(struct mpu9250 *chip, const struct bus_device *bus,
                                   uint16_t now) {
    uint8_t codes[6];
    if (!read_registers(bus, REG_SELF_TEST_X_ACCEL, codes, 3) ||
        !read_registers(bus, REG_SELF_TEST_X_GYRO, codes + 3, 3)) {
        return SENSOR_BUS_FAILED;
    }
    bool acc_passes = true;
    bool gyr_passes = !chip->test.is_offset;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        acc_passes &= axis_passes(chip->test.response[axis], codes[axis], false);
        gyr_passes &= axis_passes(chip->test.response[axis + 3], codes[axis + 3], true);
    }
    if (acc_passes || !chip->test.is_moving) {
        add_verdict(chip, SELF_TEST_ACC_PASSED, acc_passes);
    }
    if (gyr_passes || !chip->test.is_moving) {
        add_verdict(chip, SELF_TEST_GYR_PASSED, gyr_passes);
    }
    return go_on(chip, now, 0);
}

// The rate, ranges and reads that samples are taken with.
static bool configure_run(const struct mpu9250 *chip, const struct bus_device *bus) {
    const uint8_t slave[] = {AK8963_ADDRESS | SLAVE_READ, AK_ST1,
                             SLAVE_ENABLE | MAG_BYTES};
    return (chip->has_mag ? write_registers(bus, REG_I2C_SLV0_ADDR, slave, sizeof slave)
                          : write_register(bus, REG_USER_CTRL, 0)) &&
           configure(bus, 1000 / MPU9250_RATE_HZ - 1, FULL_SCALE_3);
}

// Without an AK8963 that answers the probe has six axes; identity says so.
static enum sensor_result mag_is_absent(struct mpu9250 *chip,
                                        const struct bus_device *bus, uint16_t now) {
    chip->has_mag = false;
    chip->identity.who_am_i[1] = 0;
    memset(chip->identity.mag_adjust, 0, sizeof chip->identity.mag_adjust);
    chip->step = MAG_TRANSFERS;
    return configure_run(chip, bus) ? go_on(chip, now, 0) : SENSOR_BUS_FAILED;
}

static enum sensor_result mag_begin(struct mpu9250 *chip, const struct bus_device *bus,
                                    uint16_t now) {
    memset(&chip->mag, 0, sizeof chip->mag);
    if (!configure(bus, 0, 0)) {
        return SENSOR_BUS_FAILED;
    }
    if (chip->identity.kind == SENSOR_MPU6500) {
        return mag_is_absent(chip, bus, now);
    }
    if (!write_register(bus, REG_I2C_MST_CTRL, MST_CTRL) ||
        !write_register(bus, REG_USER_CTRL, I2C_MST_EN)) {
        return SENSOR_BUS_FAILED;
    }
    return go_on(chip, now, 0);
}

// The register of a transfer; `value` is what to write, or stays where it is a read.
static uint8_t transfer_register(uint8_t transfer, int16_t *value) {
    switch (transfer) {
    case MAG_RESET:
        *value = SRST;
        return AK_CNTL2;
    case MAG_IDENTIFY:
        return AK_WIA;
    case MAG_FUSE:
        *value = MODE_FUSE;
        return AK_CNTL1;
    case MAG_FIELD_ON:
        *value = SELF_FIELD_ON;
        return AK_ASTC;
    case MAG_TEST:
        *value = MODE_SELF_TEST;
        return AK_CNTL1;
    case MAG_TEST_READY:
        return AK_ST1;
    case MAG_FIELD_OFF:
        *value = 0;
        return AK_ASTC;
    case MAG_FUSE_END:
    case MAG_TEST_END:
        *value = MODE_POWER_DOWN;
        return AK_CNTL1;
    case MAG_CONTINUOUS:
        *value = MODE_CONTINUOUS_2;
        return AK_CNTL1;
    default:
        return transfer < MAG_FUSE_END ? (uint8_t)(AK_ASAX + transfer - MAG_ADJUST)
                                       : (uint8_t)(AK_HXL + transfer - MAG_TEST_DATA);
    }
}

// AK 6.4.5, with 16 bits: the field of the built-in coil, sensitivity adjusted.
static bool mag_test_passes(const struct mpu9250 *chip) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t field = adjusted(little_endian(chip->mag.bytes + 2 * axis),
                                       chip->identity.mag_adjust[axis]);
        // x and y within +-200 counts, z between -3200 and -800.
        if (axis < 2 ? fixed_magnitude(field) > 200
                     : fixed_magnitude(field + 2000) > 1200) {
            return false;
        }
    }
    return true;
}

// Takes in what a read transfer brought; returns the transfer to do next.
static uint8_t transfer_result(struct mpu9250 *chip, uint8_t value) {
    const uint8_t transfer = chip->transfer;
    if (transfer == MAG_IDENTIFY) {
        chip->has_mag = value == AK8963_ID;
        chip->identity.who_am_i[1] = value;
    } else if (transfer == MAG_TEST_READY) {
        if ((value & ST1_DRDY) == 0) {
            ++chip->count;
            if (chip->count < TRANSFER_TRIES) {
                return MAG_TEST_READY;
            }
            add_verdict(chip, SELF_TEST_MAG_PASSED, false);
            return MAG_FIELD_OFF;
        }
    } else if (transfer < MAG_FUSE_END) {
        chip->identity.mag_adjust[transfer - MAG_ADJUST] = value;
    } else if (transfer >= MAG_TEST_DATA) {
        chip->mag.bytes[transfer - MAG_TEST_DATA] = value;
        if (transfer == MAG_FIELD_OFF - 1) {
            add_verdict(chip, SELF_TEST_MAG_PASSED, mag_test_passes(chip));
        }
    }
    return (uint8_t)(transfer + 1);
}

// One transfer by the chip's own I2C master, in two or more calls: asked for, then
// looked after. SLV4 is the slave that transfers once and says when that is done.
static enum sensor_result mag_transfer(struct mpu9250 *chip,
                                       const struct bus_device *bus, uint16_t now) {
    int16_t write = -1;
    const uint8_t reg = transfer_register(chip->transfer, &write);
    if (!chip->is_asked) {
        const uint8_t request[] = {write < 0 ? AK8963_ADDRESS | SLAVE_READ
                                             : AK8963_ADDRESS,
                                   reg, (uint8_t)write, SLAVE_ENABLE};
        if (!write_registers(bus, REG_I2C_SLV4_ADDR, request, sizeof request)) {
            return SENSOR_BUS_FAILED;
        }
        chip->is_asked = true;
        chip->since = now;
        return SENSOR_BUSY;
    }
    uint8_t status;
    if (!read_registers(bus, REG_I2C_MST_STATUS, &status, 1)) {
        return SENSOR_BUS_FAILED;
    }
    if ((status & SLV4_NACK) != 0) {
        chip->is_asked = false;
        ++chip->count;
        return chip->count < TRANSFER_TRIES ? SENSOR_BUSY
                                            : mag_is_absent(chip, bus, now);
    }
    if ((status & SLV4_DONE) == 0) {
        return is_within(chip, now, TRANSFER_TICKS) ? SENSOR_BUSY : SENSOR_STUCK;
    }
    chip->is_asked = false;
    uint8_t next = (uint8_t)(chip->transfer + 1);
    if (write < 0) {
        // A read of its own: in one with the status it could precede the transfer.
        uint8_t value;
        if (!read_registers(bus, REG_I2C_SLV4_DI, &value, 1)) {
            return SENSOR_BUS_FAILED;
        }
        next = transfer_result(chip, value);
    }
    if (next > MAG_IDENTIFY && !chip->has_mag) {
        return mag_is_absent(chip, bus, now);
    }
    if (next == MAG_DONE) {
        return go_on(chip, now, 0);
    }
    // The last transfer follows the AK8963's read of a sample: measurements then end
    // 2.6 ms after samples, as far from the next read as can be. One that ends while a
    // read goes on is lost (AK 6.4.3.4), and does so for long where the clocks agree.
    if (next == MAG_CONTINUOUS && !configure_run(chip, bus)) {
        return SENSOR_BUS_FAILED;
    }
    if (next != chip->transfer) {
        chip->transfer = next;
        chip->count = 0;
    }
    return SENSOR_BUSY;
}

static enum sensor_result run(struct mpu9250 *chip, const struct bus_device *bus,
                              uint16_t now) {
    const uint8_t interrupt[] = {INT_PULSE, RAW_DATA_RDY};
    return write_registers(bus, REG_INT_PIN_CFG, interrupt, sizeof interrupt)
               ? go_on(chip, now, SETTLE_TICKS)
               : SENSOR_BUS_FAILED;
}

static enum sensor_result ready(struct mpu9250 *chip, const struct bus_device *bus,
                                uint16_t now) {
    uint8_t status;
    if (!read_registers(bus, REG_INT_STATUS, &status, 1)) {
        return SENSOR_BUS_FAILED;
    }
    if ((status & RAW_DATA_RDY) != 0) {
        (void)go_on(chip, now, 0);
        return SENSOR_OK;
    }
    return is_within(chip, now, SETTLE_TICKS + DATA_READY_TICKS) ? SENSOR_BUSY
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
    if (is_within(chip, now, chip->wait)) {
        return SENSOR_BUSY;
    }
    switch ((enum step)chip->step) {
    case POWER_UP:
        return go_on(chip, now, STARTUP_TICKS);
    case RESET:
        return write_register(bus, REG_PWR_MGMT_1, H_RESET)
                   ? go_on(chip, now, STARTUP_TICKS)
                   : SENSOR_BUS_FAILED;
    case IDENTIFY:
        return identify(chip, bus, now);
    case TEST_BEGIN:
        if (chip->identity.self_test != 0) {
            chip->step = MAG_BEGIN;
            return SENSOR_BUSY;
        }
        return test_run(chip, bus, now, 0);
    case TEST_TURN:
        return test_turn(chip, bus, now);
    case TEST_OFF:
    case TEST_ON:
        return test_sample(chip, bus, now);
    case TEST_END:
        return test_end(chip, bus, now);
    case MAG_BEGIN:
        return mag_begin(chip, bus, now);
    case MAG_TRANSFERS:
        return mag_transfer(chip, bus, now);
    case RUN:
        return run(chip, bus, now);
    case READY:
        return ready(chip, bus, now);
    case DONE:
        break;
    }
    return SENSOR_OK;
}

// Three axes; true where one is at the end of its range.
static bool take_axes(const uint8_t *bytes, struct counts *out) {
    bool is_clipped = false;
    int16_t values[3];
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int16_t value = big_endian(bytes + 2 * axis);
        is_clipped |= value == INT16_MAX || value <= -INT16_MAX;
        values[axis] = value;
    }
    *out = (struct counts){values[0], values[1], values[2]};
    return is_clipped;
}

// What a bus reads that nobody drives or that is held: no reading of 14 bytes.
static bool is_no_reading(const uint8_t *bytes) {
    for (uint8_t i = 1; i < INERTIAL_BYTES; ++i) {
        if (bytes[i] != bytes[0]) {
            return false;
        }
    }
    return bytes[0] == 0x00 || bytes[0] == 0xFF;
}

// The AK8963's block of 8 bytes, where it is one that was not there before.
static void parse_mag(struct mpu9250 *chip, const uint8_t *block, struct sample *out) {
    const uint8_t st1 = block[0];
    const uint8_t *data = block + 1;
    const uint8_t st2 = block[MAG_BYTES - 1];
    const bool was_ready = chip->mag.was_ready;
    chip->mag.was_ready = (st1 & ST1_DRDY) != 0;
    if ((st1 & (uint8_t)~ST1_DOR) != ST1_DRDY ||
        (st2 & (uint8_t)~ST2_HOFL) != ST2_BITM) {
        return;
    }
    // Measurements are 10 ms apart, samples 5: ready twice running with the same data
    // is a block that the chip's master did not renew.
    if (was_ready && memcmp(chip->mag.bytes, data, sizeof chip->mag.bytes) == 0) {
        return;
    }
    memcpy(chip->mag.bytes, data, sizeof chip->mag.bytes);
    int16_t field[3];
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int16_t raw = little_endian(data + 2 * axis);
        if (raw > AK_COUNTS_MAX || raw < -AK_COUNTS_MAX) {
            return;
        }
        const int32_t value = adjusted(raw, chip->identity.mag_adjust[axis]);
        field[axis] = (int16_t)fixed_clamp(value, INT16_MAX);
        if (field[axis] != value) {
            out->mag_overflow = true;
        }
    }
    if ((st2 & ST2_HOFL) != 0) {
        out->mag_overflow = true;
    }
    out->has_mag = !out->mag_overflow;
    // PS 9.1: the AK8963's x is the others' y, its y their x, its z points the other
    // way.
    out->mag = (struct counts){field[1], field[0], (int16_t)-field[2]};
}

bool mpu9250_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                   struct sample *out) {
    struct mpu9250 *chip = state;
    if (is_no_reading(bytes)) {
        return false;
    }
    out->time_us = time_us;
    out->acc_clipped = take_axes(bytes, &out->acc);
    out->gyr_clipped = take_axes(bytes + 8, &out->gyr);
    // RM 65: TEMP_OUT / 333.87 + 21 degC; 19629 is 100 / 333.87 * 2^16.
    out->temperature_cdeg =
        (int16_t)(fixed_scale_down(big_endian(bytes + 6) * INT32_C(19629), 16) + 2100);
    out->mag = (struct counts){0, 0, 0};
    out->has_mag = false;
    out->mag_overflow = false;
    if (chip->has_mag) {
        parse_mag(chip, bytes + INERTIAL_BYTES, out);
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
    out[0].reg = REG_ACCEL_XOUT_H;
    out[0].length = chip->has_mag ? INERTIAL_BYTES + MAG_BYTES : INERTIAL_BYTES;
    return 1;
}
