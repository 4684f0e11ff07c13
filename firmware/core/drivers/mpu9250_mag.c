// SPDX-License-Identifier: MIT
// The AK8963, the magnetometer in the MPU-9250's package: the chip's own I2C master
// sets it up, a register at a time, and then reads it with each sample.
#include <string.h>

#include "core/drivers/mpu9250_private.h"
#include "core/math/fixed.h"
#include "core/wire/messages.h"

// Of the MPU-9250.
enum {
    REG_I2C_MST_CTRL = 0x24,    // RM 36
    REG_I2C_SLV0_ADDR = 0x25,   // RM 37; then REG, CTRL
    REG_I2C_SLV4_ADDR = 0x31,   // RM 49; then REG, DO, CTRL
    REG_I2C_SLV4_DI = 0x35,     // RM 53
    REG_I2C_MST_STATUS = 0x36,  // RM 54, cleared by reading
    REG_USER_CTRL = 0x6A,       // RM 106

    I2C_MST_EN = 0x20,    // USER_CTRL
    MST_CTRL = 0x4D,      // WAIT_FOR_ES: INT comes after the AK8963's bytes; 400 kHz
    SLAVE_READ = 0x80,    // I2C_SLVx_ADDR
    SLAVE_ENABLE = 0x80,  // I2C_SLVx_CTRL
    SLV4_DONE = 0x40,     // I2C_MST_STATUS
    SLV4_NACK = 0x10,     // I2C_MST_STATUS
    FULL_SCALE_3 = 0x18,  // 2000 deg/s, 16 g

    TRANSFER_TICKS = 20,  // the chip's master starts one at the next sample
    // Of a transfer that is refused or brings no data-ready, 1 ms or more each: a
    // measurement of the AK8963 takes 9 ms at most (AK 5).
    TRANSFER_TRIES = 50,
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

static int16_t little_endian(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[1] * 256u + bytes[0]);
}

// H * ((ASA - 128) * 0.5 / 128 + 1), AK 8.3; |counts| <= 32768 and ASA <= 255 keep the
// result within 49152.
static int32_t adjusted(int16_t counts, uint8_t adjust) {
    return fixed_scale_down(counts * (INT32_C(128) + adjust), 8);
}

// The rate, ranges and reads that samples are taken with.
static bool configure_run(const struct mpu9250 *chip, const struct bus_device *bus) {
    const uint8_t slave[] = {AK8963_ADDRESS | SLAVE_READ, AK_ST1,
                             SLAVE_ENABLE | MPU9250_MAG_BYTES};
    return (chip->has_mag ? mpu9250_write(bus, REG_I2C_SLV0_ADDR, slave, sizeof slave)
                          : mpu9250_write_one(bus, REG_USER_CTRL, 0)) &&
           mpu9250_configure(bus, 1000 / MPU9250_RATE_HZ - 1, FULL_SCALE_3);
}

// Without an AK8963 that answers the probe has six axes; identity says so.
static enum sensor_result mag_is_absent(struct mpu9250 *chip,
                                        const struct bus_device *bus, uint16_t now) {
    chip->has_mag = false;
    chip->identity.who_am_i[1] = 0;
    memset(chip->identity.mag_adjust, 0, sizeof chip->identity.mag_adjust);
    chip->step = MPU9250_MAG_TRANSFERS;
    return configure_run(chip, bus) ? mpu9250_go_on(chip, now, 0) : SENSOR_BUS_FAILED;
}

enum sensor_result mpu9250_mag_begin(struct mpu9250 *chip, const struct bus_device *bus,
                                     uint16_t now) {
    memset(&chip->mag, 0, sizeof chip->mag);
    if (!mpu9250_configure(bus, 0, 0)) {
        return SENSOR_BUS_FAILED;
    }
    if (chip->identity.kind == SENSOR_MPU6500) {
        return mag_is_absent(chip, bus, now);
    }
    if (!mpu9250_write_one(bus, REG_I2C_MST_CTRL, MST_CTRL) ||
        !mpu9250_write_one(bus, REG_USER_CTRL, I2C_MST_EN)) {
        return SENSOR_BUS_FAILED;
    }
    return mpu9250_go_on(chip, now, 0);
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
            self_test_note(&chip->identity, SELF_TEST_MAG_PASSED, false);
            return MAG_FIELD_OFF;
        }
    } else if (transfer < MAG_FUSE_END) {
        chip->identity.mag_adjust[transfer - MAG_ADJUST] = value;
    } else if (transfer >= MAG_TEST_DATA) {
        chip->mag.bytes[transfer - MAG_TEST_DATA] = value;
        if (transfer == MAG_FIELD_OFF - 1) {
            self_test_note(&chip->identity, SELF_TEST_MAG_PASSED,
                           mag_test_passes(chip));
        }
    }
    return (uint8_t)(transfer + 1);
}

// SLV4 is the slave that transfers once and says when that is done.
enum sensor_result mpu9250_mag_transfer(struct mpu9250 *chip,
                                        const struct bus_device *bus, uint16_t now) {
    int16_t write = -1;
    const uint8_t reg = transfer_register(chip->transfer, &write);
    if (!chip->is_asked) {
        const uint8_t request[] = {write < 0 ? AK8963_ADDRESS | SLAVE_READ
                                             : AK8963_ADDRESS,
                                   reg, (uint8_t)write, SLAVE_ENABLE};
        if (!mpu9250_write(bus, REG_I2C_SLV4_ADDR, request, sizeof request)) {
            return SENSOR_BUS_FAILED;
        }
        chip->is_asked = true;
        chip->since = now;
        return SENSOR_BUSY;
    }
    uint8_t status;
    if (!mpu9250_read(bus, REG_I2C_MST_STATUS, &status, 1)) {
        return SENSOR_BUS_FAILED;
    }
    if ((status & SLV4_NACK) != 0) {
        chip->is_asked = false;
        ++chip->count;
        return chip->count < TRANSFER_TRIES ? SENSOR_BUSY
                                            : mag_is_absent(chip, bus, now);
    }
    if ((status & SLV4_DONE) == 0) {
        return mpu9250_is_within(chip, now, TRANSFER_TICKS) ? SENSOR_BUSY
                                                            : SENSOR_STUCK;
    }
    chip->is_asked = false;
    uint8_t next = (uint8_t)(chip->transfer + 1);
    if (write < 0) {
        // A read of its own: in one with the status it could precede the transfer.
        uint8_t value;
        if (!mpu9250_read(bus, REG_I2C_SLV4_DI, &value, 1)) {
            return SENSOR_BUS_FAILED;
        }
        next = transfer_result(chip, value);
    }
    if (next > MAG_IDENTIFY && !chip->has_mag) {
        return mag_is_absent(chip, bus, now);
    }
    if (next == MAG_DONE) {
        return mpu9250_go_on(chip, now, 0);
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

void mpu9250_mag_parse(struct mpu9250 *chip, const uint8_t *block, struct sample *out) {
    const uint8_t st1 = block[0];
    const uint8_t *data = block + 1;
    const uint8_t st2 = block[MPU9250_MAG_BYTES - 1];
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
    out->mag = (struct counts){.x = field[1], .y = field[0], .z = (int16_t)-field[2]};
}
