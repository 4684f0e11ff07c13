// SPDX-License-Identifier: MIT
// Set-up and self-test of the MPU-9250 and its AK8963: a table, of which each call does
// a row; documents: mpu9250_private.h. The chip's own I2C master sets up the AK8963, a
// register at a time.
#include <stddef.h>
#include <string.h>

#include "core/drivers/mpu9250_private.h"
#include "core/math/fixed.h"
#include "core/math/in_flash.h"
#include "core/wire/messages.h"

// Of the MPU-9250.
enum {
    REG_SELF_TEST_X_GYRO = 0x00,   // RM 0 to 2
    REG_SELF_TEST_X_ACCEL = 0x0D,  // RM 13 to 15
    REG_SMPLRT_DIV = 0x19,         // RM 25
    REG_CONFIG = 0x1A,             // RM 26
    REG_GYRO_CONFIG = 0x1B,        // RM 27
    REG_ACCEL_CONFIG = 0x1C,       // RM 28
    REG_ACCEL_CONFIG_2 = 0x1D,     // RM 29
    REG_I2C_MST_CTRL = 0x24,       // RM 36
    REG_I2C_SLV0_ADDR = 0x25,      // RM 37
    REG_I2C_SLV0_REG = 0x26,       // RM 38
    REG_I2C_SLV0_CTRL = 0x27,      // RM 39
    REG_I2C_SLV4_ADDR = 0x31,      // RM 49; then REG, DO, CTRL
    REG_I2C_SLV4_DI = 0x35,        // RM 53
    REG_I2C_MST_STATUS = 0x36,     // RM 54, cleared by reading
    REG_INT_PIN_CFG = 0x37,        // RM 55
    REG_INT_ENABLE = 0x38,         // RM 56
    REG_INT_STATUS = 0x3A,         // RM 58
    REG_USER_CTRL = 0x6A,          // RM 106
    REG_PWR_MGMT_1 = 0x6B,         // RM 107
    REG_PWR_MGMT_2 = 0x6C,         // RM 108
    REG_WHO_AM_I = 0x75,           // RM 117

    H_RESET = 0x80,       // PWR_MGMT_1
    CLKSEL_AUTO = 0x01,   // PWR_MGMT_1: the gyroscope's PLL once it runs
    RAW_DATA_RDY = 0x01,  // INT_STATUS, INT_ENABLE
    DLPF_2 = 0x02,        // gyroscope 92 Hz, accelerometer 99 Hz, both at 1 kHz
    FULL_SCALE_0 = 0x00,  // 250 deg/s, 2 g
    FULL_SCALE_3 = 0x18,  // 2000 deg/s, 16 g
    STIMULUS_ON = 0xE0,   // GYRO_CONFIG, ACCEL_CONFIG: all three axes
    I2C_MST_EN = 0x20,    // USER_CTRL
    MST_CTRL = 0x4D,      // WAIT_FOR_ES: INT comes after the AK8963's bytes; 400 kHz
    SLAVE_READ = 0x80,    // I2C_SLVx_ADDR
    SLAVE_ENABLE = 0x80,  // I2C_SLVx_CTRL
    SLV4_DONE = 0x40,     // I2C_MST_STATUS
    SLV4_NACK = 0x10,     // I2C_MST_STATUS
    // A pulse of 50 us, active high, push-pull: an edge a sample whether the one before
    // it was read or not, so that one lost burst can't end the stream.
    INT_PULSE = 0x00,

    MPU9250_WHO = 0x71,
    MPU9255_WHO = 0x73,
    MPU6500_WHO = 0x70,
};

// Of the AK8963.
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

    MODE_POWER_DOWN = 0x00,
    MODE_FUSE = 0x0F,
    MODE_SELF_TEST = 0x18,     // 16 bits
    MODE_CONTINUOUS_2 = 0x16,  // 100 Hz, 16 bits
    SRST = 0x01,
    SELF_FIELD_ON = 0x40,
    SELF_FIELD_OFF = 0x00,
};

enum {
    TICK_US = 1024,  // a wait of n ticks lasts more than n - 1
    // PS 3.4.2: registers answer 100 ms after power at the latest; of H_RESET nothing
    // better is said. A tenth more, for clocks that differ.
    STARTUP_TICKS = 110,
    GYRO_START_TICKS = 50,  // PS 3.1: 35 ms typical
    SETTLE_TICKS = 21,      // AN 3: 20 ms after the stimulus, or a range, changes
    DATA_READY_TICKS = 50,  // ten samples
    TRANSFER_TICKS = 20,    // the chip's master starts one at the next sample
    // Of transfers that are refused or bring no data-ready, 1 ms or more each: a
    // measurement of the AK8963 takes 9 ms at most (AK 5).
    MAG_TRIES = 50,

    TEST_PERIOD_TICKS = 1,  // AN 3: read at 1 kHz
    TEST_SAMPLES = 200,     // AN 3

    // At 131 LSB a deg/s and 16384 LSB a g (AN 3.3): a sum of TEST_SAMPLES; and what
    // stands for the factory's value where there is none, so that the limits are 60
    // deg/s; 225 and 675 mg.
    GYRO_OFFSET_MAX = UINT32_C(20) * 131 * TEST_SAMPLES,
    GYR_RESPONSE = 120 * 131,
    ACC_RESPONSE = (UINT32_C(450) * 16384 + 500) / 1000,
    // How far a rate may stray from the first of a run: 2.5 deg/s, 17 times the rms of
    // such a difference by the chip's noise (PS 3.1: 0.1 deg/s rms).
    MOVING = 5 * 131 / 2,
};

// A row is a register of the MPU-9250 with the value to write, or one of these. A place
// is that of a byte in struct mpu9250.
struct row {
    uint8_t what;
    uint8_t value;
};

enum {
    WAIT,      // the value: ticks
    IDENTIFY,  // by the WHO_AM_I that was read
    // Where there is a verdict on the inertial sensors, goes on so many rows further.
    SKIP_IF_TESTED,
    TEST_RUN,     // TEST_SAMPLES, one a call
    TEST_OFFSET,  // of the gyroscope, after the run without the stimulus
    TEST_JUDGE,   // the place of an axis' sum; its code was read
    TEST_END,
    MASTER_IF_MAG,  // is on with an AK8963 only
    AWAIT_DATA,     // goes back a row until that has read data-ready; ticks at most
    DONE,

    // And a register of the AK8963: the value is written to one of its control
    // registers, the place gets another. None of these rows up to MAG_END is done
    // without an AK8963.
    MAG = 0x40,
    MAG_IDENTIFY = 0x60,  // by the WIA that was read
    MAG_AWAIT,            // goes back a row until that has read data-ready
    MAG_JUDGE,
    MAG_END,

    // And the register of the MPU-9250 to read, to the place.
    READ = 0x80,
};

#define NOINLINE __attribute__((noinline))
#define PLACE(member) ((uint8_t)offsetof(struct mpu9250, member))

_Static_assert(sizeof(struct mpu9250) <= UINT8_MAX, "a place is a byte");

// H_RESET has set all registers that are not written here to 0 (RM 3). The AK8963's
// transfers are a millisecond and more apart: it wants 100 us between two modes (AK
// 6.3).
static const IN_FLASH struct row rows[] = {
    {WAIT, STARTUP_TICKS},
    {REG_PWR_MGMT_1, H_RESET},
    {WAIT, STARTUP_TICKS},
    {READ + REG_WHO_AM_I, PLACE(identity.who_am_i[0])},
    {IDENTIFY, 0},
    {REG_PWR_MGMT_1, CLKSEL_AUTO},
    {REG_PWR_MGMT_2, 0},
    {REG_CONFIG, DLPF_2},
    {REG_ACCEL_CONFIG_2, DLPF_2},
    {WAIT, GYRO_START_TICKS},

    // How the inertial sensors answer to a stimulus, against what they did in the
    // factory (AN 3).
    {SKIP_IF_TESTED, 22},
    {REG_GYRO_CONFIG, FULL_SCALE_0},
    {REG_ACCEL_CONFIG, FULL_SCALE_0},
    {WAIT, SETTLE_TICKS},
    {TEST_RUN, 0},
    {TEST_OFFSET, 0},
    {REG_GYRO_CONFIG, STIMULUS_ON | FULL_SCALE_0},
    {REG_ACCEL_CONFIG, STIMULUS_ON | FULL_SCALE_0},
    {WAIT, SETTLE_TICKS},
    {TEST_RUN, 0},
    {READ + REG_SELF_TEST_X_ACCEL, PLACE(read)},
    {TEST_JUDGE, PLACE(test.axes[0])},
    {READ + REG_SELF_TEST_X_ACCEL + 1, PLACE(read)},
    {TEST_JUDGE, PLACE(test.axes[1])},
    {READ + REG_SELF_TEST_X_ACCEL + 2, PLACE(read)},
    {TEST_JUDGE, PLACE(test.axes[2])},
    {READ + REG_SELF_TEST_X_GYRO, PLACE(read)},
    {TEST_JUDGE, PLACE(test.axes[SELF_TEST_GYR])},
    {READ + REG_SELF_TEST_X_GYRO + 1, PLACE(read)},
    {TEST_JUDGE, PLACE(test.axes[SELF_TEST_GYR + 1])},
    {READ + REG_SELF_TEST_X_GYRO + 2, PLACE(read)},
    {TEST_JUDGE, PLACE(test.axes[SELF_TEST_GYR + 2])},
    {TEST_END, 0},
    {REG_GYRO_CONFIG, FULL_SCALE_3},
    {REG_ACCEL_CONFIG, FULL_SCALE_3},

    {REG_I2C_MST_CTRL, MST_CTRL},
    {REG_USER_CTRL, I2C_MST_EN},
    {MAG + AK_CNTL2, SRST},
    {MAG + AK_WIA, PLACE(identity.who_am_i[1])},
    {MAG_IDENTIFY, 0},
    {MAG + AK_CNTL1, MODE_FUSE},
    {MAG + AK_ASAX, PLACE(identity.mag_adjust[0])},
    {MAG + AK_ASAX + 1, PLACE(identity.mag_adjust[1])},
    {MAG + AK_ASAX + 2, PLACE(identity.mag_adjust[2])},
    {MAG + AK_CNTL1, MODE_POWER_DOWN},

    // AK 6.4.5.
    {MAG + AK_ASTC, SELF_FIELD_ON},
    {MAG + AK_CNTL1, MODE_SELF_TEST},
    {MAG + AK_ST1, PLACE(read)},
    {MAG_AWAIT, 0},
    {MAG + AK_HXL, PLACE(mag[0])},
    {MAG + AK_HXL + 1, PLACE(mag[1])},
    {MAG + AK_HXL + 2, PLACE(mag[2])},
    {MAG + AK_HXL + 3, PLACE(mag[3])},
    {MAG + AK_HXL + 4, PLACE(mag[4])},
    {MAG + AK_HXL + 5, PLACE(mag[5])},
    {MAG_JUDGE, 0},
    {MAG + AK_ASTC, SELF_FIELD_OFF},
    {MAG + AK_CNTL1, MODE_POWER_DOWN},

    {MASTER_IF_MAG, I2C_MST_EN},
    {REG_I2C_SLV0_ADDR, AK8963_ADDRESS | SLAVE_READ},
    {REG_I2C_SLV0_REG, AK_ST1},
    {REG_I2C_SLV0_CTRL, SLAVE_ENABLE | MPU9250_MAG_BYTES},
    {REG_SMPLRT_DIV, 1000 / MPU9250_RATE_HZ - 1},
    // This transfer follows the AK8963's read of a sample: measurements then end 2.6 ms
    // after samples, as far from the next read as can be. One that ends while a read
    // goes on is lost (AK 6.4.3.4), and does so for long where the clocks agree.
    {MAG + AK_CNTL1, MODE_CONTINUOUS_2},
    {REG_INT_PIN_CFG, INT_PULSE},
    {REG_INT_ENABLE, RAW_DATA_RDY},
    {WAIT, SETTLE_TICKS},
    {READ + REG_INT_STATUS, PLACE(read)},
    {AWAIT_DATA, SETTLE_TICKS + DATA_READY_TICKS},
    {DONE, 0},
};

NOINLINE static enum sensor_result read(const IN_FLASH struct bus_device *bus,
                                        uint8_t reg, uint8_t *data, uint8_t length) {
    return (enum sensor_result)bus->read(bus->port, MPU9250_ADDRESS, reg, data, length);
}

NOINLINE static enum sensor_result write(const IN_FLASH struct bus_device *bus,
                                         uint8_t reg, const uint8_t *data,
                                         uint8_t length) {
    return (enum sensor_result)bus->write(bus->port, MPU9250_ADDRESS, reg, data,
                                          length);
}

static bool is_within(const struct mpu9250 *chip, uint16_t now, uint8_t ticks) {
    return (uint16_t)(now - chip->since) < ticks;
}

// The burst ends with the AK8963's block where there is one.
static void set_has_mag(struct mpu9250 *chip, bool has_mag) {
    chip->bursts[0].length =
        has_mag ? MPU9250_INERTIAL_BYTES + MPU9250_MAG_BYTES : MPU9250_INERTIAL_BYTES;
}

static void *at(struct mpu9250 *chip, uint8_t place) {
    return (uint8_t *)chip + place;
}

// The functions of rows: SENSOR_OK where the row is done, SENSOR_BUSY where it goes on.

static enum sensor_result identify(struct mpu9250 *chip) {
    switch (chip->identity.who_am_i[0]) {
    case MPU6500_WHO:
        chip->identity.kind = SENSOR_MPU6500;
        set_has_mag(chip, false);
        return SENSOR_OK;
    case MPU9250_WHO:
    case MPU9255_WHO:
        return SENSOR_OK;
    default:
        return SENSOR_WRONG_CHIP;
    }
}

static enum sensor_result
test_run(struct mpu9250 *chip, const IN_FLASH struct bus_device *bus, uint16_t now) {
    uint8_t bytes[MPU9250_INERTIAL_BYTES];
    const enum sensor_result result =
        read(bus, MPU9250_REG_ACCEL_XOUT_H, bytes, sizeof bytes);
    if (result != SENSOR_OK) {
        return result;
    }
    const uint8_t *place = bytes;
    for (uint8_t axis = 0; axis < SELF_TEST_AXES; ++axis) {
        if (axis == SELF_TEST_GYR) {
            place += 2;  // the temperature
        }
        self_test_add(&chip->test, axis, mpu9250_word(place), chip->count == 0, MOVING);
        place += 2;
    }
    ++chip->count;
    if (chip->count < TEST_SAMPLES) {
        chip->since = now;
        chip->wait = TEST_PERIOD_TICKS;
        return SENSOR_BUSY;
    }
    chip->count = 0;
    return SENSOR_OK;
}

// What an axis answered in the factory, counts: 2620 * 1.01^(code - 1), AN 3.2, for
// codes 1 to 255. In 2^-16 counts it is at most 2149859918; each step loses less than
// one of them.
static uint16_t factory_trim(uint8_t code) {
    uint32_t trim = UINT32_C(2620) * 65536;
    for (; code > 1; --code) {
        trim += fixed_umul_q32(trim, 42949673);  // 2^32 / 100
    }
    return fixed_high_half(trim + 32768);
}

// AN 3.3: an axis against its factory value or, where it has none, against fixed
// limits.
static void test_judge(struct mpu9250 *chip, uint8_t place) {
    struct self_test *test = &chip->test;
    const struct self_test_axis *axis = at(chip, place);
    const uint8_t code = chip->read;
    uint8_t flag = SELF_TEST_ACC_PASSED;
    uint16_t trim = ACC_RESPONSE;
    if (place >= PLACE(test.axes[SELF_TEST_GYR])) {
        flag = SELF_TEST_GYR_PASSED;
        trim = GYR_RESPONSE;
    }
    int32_t sum = axis->sum;
    if (code == 0) {
        sum = (int32_t)fixed_magnitude(sum);
    } else {
        trim = factory_trim(code);
    }
    // In half counts: from the trim to three times as much.
    const int32_t above = sum / (int32_t)(TEST_SAMPLES / 2) - (int32_t)trim;
    if (above < 0 || (flag == SELF_TEST_ACC_PASSED && above > (int32_t)trim * 2)) {
        test->failed |= flag;
    }
}

// Without an AK8963 that answers the probe has six axes; identity says so.
static void mag_is_absent(struct mpu9250 *chip) {
    set_has_mag(chip, false);
    chip->identity.who_am_i[1] = 0;
    chip->identity.mag_adjust[0] = 0;
    chip->identity.mag_adjust[1] = 0;
    chip->identity.mag_adjust[2] = 0;
}

// One transfer, in two or more calls: asked for, then looked after. SLV4 is the slave
// that transfers once and says when that is done.
static enum sensor_result mag_transfer(struct mpu9250 *chip,
                                       const IN_FLASH struct bus_device *bus,
                                       uint16_t now, uint8_t what, uint8_t value) {
    const uint8_t reg = (uint8_t)(what - MAG);
    const bool is_read = reg < AK_CNTL1 || reg > AK_ASTC;
    enum sensor_result result;
    if (!chip->is_asked) {
        const uint8_t request[] = {
            (uint8_t)(is_read ? AK8963_ADDRESS | SLAVE_READ : AK8963_ADDRESS), reg,
            value, SLAVE_ENABLE};
        chip->is_asked = true;
        chip->since = now;
        result = write(bus, REG_I2C_SLV4_ADDR, request, sizeof request);
        return result == SENSOR_OK ? SENSOR_BUSY : result;
    }
    uint8_t status;
    result = read(bus, REG_I2C_MST_STATUS, &status, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if ((status & SLV4_NACK) != 0) {
        chip->is_asked = false;
        ++chip->count;
        if (chip->count >= MAG_TRIES) {
            mag_is_absent(chip);
        }
        return SENSOR_BUSY;
    }
    if ((status & SLV4_DONE) == 0) {
        return is_within(chip, now, TRANSFER_TICKS) ? SENSOR_BUSY : SENSOR_STUCK;
    }
    chip->is_asked = false;
    // A read of its own: in one with the status it could precede the transfer.
    return is_read ? read(bus, REG_I2C_SLV4_DI, at(chip, value), 1) : SENSOR_OK;
}

static bool is_between(int16_t value, int16_t low, int16_t high) {
    return value >= low && value <= high;
}

// AK 6.4.5, with 16 bits: the field of the built-in coil, sensitivity adjusted; where
// it was never measured it is 0.
static uint8_t mag_verdict(const struct mpu9250 *chip) {
    int16_t field[3];
    (void)mpu9250_read_field(chip, field);
    return is_between(field[0], -200, 200) && is_between(field[1], -200, 200) &&
                   is_between(field[2], -3200, -800)
               ? SELF_TEST_MAG_PASSED
               : SELF_TEST_MAG_FAILED;
}

static enum sensor_result do_mag_row(struct mpu9250 *chip,
                                     const IN_FLASH struct bus_device *bus,
                                     uint16_t now, uint8_t what, uint8_t value) {
    if (!mpu9250_has_mag(chip)) {
        return SENSOR_OK;
    }
    if (what < MAG_IDENTIFY) {
        return mag_transfer(chip, bus, now, what, value);
    }
    if (what == MAG_JUDGE) {
        chip->identity.self_test |= mag_verdict(chip);
    } else if (what == MAG_IDENTIFY) {
        if (chip->identity.who_am_i[1] != AK8963_ID) {
            mag_is_absent(chip);
        }
    } else if ((chip->read & AK8963_ST1_DRDY) == 0 && ++chip->count < MAG_TRIES) {
        chip->step = (uint8_t)(chip->step - 2);
    }
    return SENSOR_OK;
}

static enum sensor_result do_row(struct mpu9250 *chip,
                                 const IN_FLASH struct bus_device *bus, uint16_t now,
                                 uint8_t what, uint8_t value) {
    if (what >= READ) {
        return read(bus, (uint8_t)(what - READ), at(chip, value), 1);
    }
    if (what >= MAG && what < MAG_END) {
        return do_mag_row(chip, bus, now, what, value);
    }
    switch (what) {
    case WAIT:
        chip->since = now;
        chip->wait = value;
        return SENSOR_OK;
    case IDENTIFY:
        return identify(chip);
    case SKIP_IF_TESTED:
        if (chip->identity.self_test != 0) {
            chip->step = (uint8_t)(chip->step + value);
        }
        return SENSOR_OK;
    case TEST_RUN:
        return test_run(chip, bus, now);
    case TEST_OFFSET:
        self_test_offset(&chip->test, GYRO_OFFSET_MAX);
        return SENSOR_OK;
    case TEST_JUDGE:
        test_judge(chip, value);
        return SENSOR_OK;
    case TEST_END:
        self_test_end(&chip->test, &chip->identity);
        return SENSOR_OK;
    case AWAIT_DATA:
        if ((chip->read & RAW_DATA_RDY) != 0) {
            return SENSOR_OK;
        }
        chip->step = (uint8_t)(chip->step - 2);
        return is_within(chip, now, value) ? SENSOR_OK : SENSOR_STUCK;
    case MASTER_IF_MAG:
        what = REG_USER_CTRL;
        if (!mpu9250_has_mag(chip)) {
            value = 0;
        }
        break;
    default:
        break;
    }
    return write(bus, what, &value, 1);
}

void mpu9250_begin(void *state) {
    struct mpu9250 *chip = state;
    const uint8_t verdict = chip->identity.self_test &
                            (uint8_t) ~(SELF_TEST_MAG_PASSED | SELF_TEST_MAG_FAILED);
    memset(chip, 0, sizeof *chip);
    chip->identity = mpu9250_known;
    chip->identity.self_test = verdict;
    set_has_mag(chip, true);
    chip->bursts[0].address = MPU9250_ADDRESS;
    chip->bursts[0].reg = MPU9250_REG_ACCEL_XOUT_H;
}

enum sensor_result mpu9250_setup(void *state, const IN_FLASH struct bus_device *bus,
                                 uint32_t now_us) {
    struct mpu9250 *chip = state;
    const struct row row = rows[chip->step];
    if (row.what == DONE) {
        return SENSOR_OK;
    }
    // Ticks wrap after 67 s, at the wrap of now_us too: waits are far shorter.
    const uint16_t now = (uint16_t)(now_us / TICK_US);
    if (is_within(chip, now, chip->wait)) {
        return SENSOR_BUSY;
    }
    chip->wait = 0;
    const enum sensor_result result = do_row(chip, bus, now, row.what, row.value);
    if (result != SENSOR_OK) {
        return result;
    }
    ++chip->step;
    return SENSOR_BUSY;
}
