// SPDX-License-Identifier: MIT
// Set-up and self-test of the MPU-9250 and its AK8963: a table, of which each call does
// a row; documents: mpu9250_private.h. The AK8963 is set up through the chip's bypass,
// and read in operation by the chip's own I2C master.
#include <stddef.h>
#include <string.h>

#include "core/drivers/mag_watch.h"
#include "core/drivers/mpu9250_private.h"
#include "core/drivers/mpu9250_registers.h"
#include "core/drivers/ports_of.h"
#include "core/math/fixed.h"
#include "core/math/in_flash.h"

enum {
    TICK_US = 1024,  // a wait of n ticks lasts more than n - 1
    // PS 3.4.2: registers answer 100 ms after power at the latest; of H_RESET nothing
    // better is said. A tenth more, for clocks that differ.
    STARTUP_TICKS = 110,
    MASTER_STOP_TICKS = 4,  // the longest transfer of the chip's master, six times
    MASTER_TICKS = 3,  // it starts a transfer of 0.1 ms at the next sample, in 1 ms
    GYRO_START_TICKS = 50,  // PS 3.1: 35 ms typical
    TEST_TICKS = 100,       // a low-pass of 10 Hz settles to 0.3 % (RM 4.6: 18 ms)
    FORCE_TICKS = 4,        // between two looks at the force
    FORCE_TRIES = 250,      // a second: a shaken probe passes 1 g by then
    SETTLE_TICKS = 21,      // AN 3: 20 ms after a range changes
    DATA_READY_TICKS = 50,  // ten samples
    MAG_TICKS = 2,          // AK 6.3: 100 us between two modes
    MAG_TEST_TICKS = 11,    // AK 5: a measurement takes 9 ms at most
    // Of transfers that the AK8963 refuses, MAG_TICKS each: it may after its reset.
    MAG_TRIES = 50,
    MAG_READ = 3,  // bytes: more than its name goes to places that are written later
};

// A resting force, in counts at 2 g, and the square of the least and the most that is
// taken for gravity: 0.75 and 1.25 g, as 2^-16ths.
#define FORCE_SQUARE(g) ((uint32_t)ROUNDED(SQUARE((g)*16384) / 65536))
#define FORCE_SQUARE_MIN FORCE_SQUARE(0.75)
#define FORCE_SQUARE_MAX FORCE_SQUARE(1.25)

// A row is a register of the MPU-9250 with the value to write, or one of these. A place
// is that of a byte in struct mpu9250.
struct row {
    uint8_t what;
    uint8_t value;
};

enum {
    WAIT,      // the value: ticks
    IDENTIFY,  // by the WHO_AM_I that was read
    // Skips so many rows where the inertial sensors have been tested.
    SKIP_IF_TESTED,
    TEST_READ,    // six axes to the place
    AWAIT_FORCE,  // goes back a row until that has read about 1 g
    TEST_END,
    MASTER_IF_MAG,  // is on with an AK8963 only
    MAG_ALIVE,      // by the master's status that was read
    AWAIT_DATA,     // goes back a row until that has read data-ready; ticks at most
    VERIFY,         // reads back the rows that are kept
    DONE,

    // And a register of the AK8963: the value is written to one of its control
    // registers, the place gets another and the two after it. None of these rows up to
    // MAG_END is done without an AK8963.
    MAG = 0x40,
    MAG_BYPASS = 0x60,  // puts it on the host's bus
    MAG_IDENTIFY,       // by the WIA that was read
    MAG_END,

    // And the register of the MPU-9250 to read, to the place.
    READ = 0x80,
};

#define NOINLINE __attribute__((noinline))
#define PLACE(member) ((uint8_t)offsetof(struct mpu9250, member))

_Static_assert(sizeof(struct mpu9250) <= UINT8_MAX, "a place is a byte");

// In the order in which they are done. H_RESET has set all registers that are not
// written here to 0 (RM 3).
struct table {
    struct row start[58];
    struct row kept[13];  // the configuration in operation, which is read back
    struct row end[11];
};

static const IN_FLASH struct table table = {
    // start
    {
        {WAIT, STARTUP_TICKS},
        {READ + REG_I2C_SLV0_CTRL, PLACE(was_running)},
        // Nothing is written before: a clock may be at this address.
        {READ + REG_WHO_AM_I, PLACE(identity.who_am_i[0])},
        {READ + REG_PWR_MGMT_1, PLACE(read)},
        {READ + REG_PWR_MGMT_2, PLACE(count)},
        {IDENTIFY, 0},
        // The processor may have been reset while the chip's master read: cut
        // off by H_RESET, the AK8963 would wait for the rest of its byte and
        // hold its bus (RM 106, I2C_MST_RST).
        {REG_USER_CTRL, 0},
        {WAIT, MASTER_STOP_TICKS},
        {REG_PWR_MGMT_1, H_RESET},
        {WAIT, STARTUP_TICKS},
        {REG_PWR_MGMT_1, CLKSEL_AUTO},
        {WAIT, GYRO_START_TICKS},

        // How the inertial sensors answer to a stimulus (AN 3). A low-pass of
        // 10 Hz stands for the mean over 200 samples; without the stimulus
        // again, because a difference is motion.
        {SKIP_IF_TESTED, 22},
        {REG_CONFIG, DLPF_5},
        {REG_ACCEL_CONFIG_2, DLPF_5},
        {REG_GYRO_CONFIG, FULL_SCALE_0},
        {REG_ACCEL_CONFIG, FULL_SCALE_0},
        {WAIT, TEST_TICKS},
        {TEST_READ, PLACE(test.before)},
        {AWAIT_FORCE, FORCE_TICKS},
        {REG_GYRO_CONFIG, STIMULUS_ON | FULL_SCALE_0},
        {REG_ACCEL_CONFIG, STIMULUS_ON | FULL_SCALE_0},
        {WAIT, TEST_TICKS},
        {TEST_READ, PLACE(test.stimulated)},
        {REG_GYRO_CONFIG, FULL_SCALE_0},
        {REG_ACCEL_CONFIG, FULL_SCALE_0},
        {WAIT, TEST_TICKS},
        {TEST_READ, PLACE(test.after)},
        {READ + REG_SELF_TEST_X_ACCEL, PLACE(test.factory[0])},
        {READ + REG_SELF_TEST_X_ACCEL + 1, PLACE(test.factory[1])},
        {READ + REG_SELF_TEST_X_ACCEL + 2, PLACE(test.factory[2])},
        {READ + REG_SELF_TEST_X_GYRO, PLACE(test.factory[3])},
        {READ + REG_SELF_TEST_X_GYRO + 1, PLACE(test.factory[4])},
        {READ + REG_SELF_TEST_X_GYRO + 2, PLACE(test.factory[5])},
        {TEST_END, 0},

        // Through the bypass a line that is held holds the host's bus, too: the chip's
        // own master is sent ahead.
        {REG_I2C_SLV4_ADDR, AK8963_ADDRESS | SLAVE_READ},
        {REG_I2C_SLV4_CTRL, SLAVE_ENABLE},
        {REG_USER_CTRL, I2C_MST_EN},
        {WAIT, MASTER_TICKS},
        {READ + REG_I2C_MST_STATUS, PLACE(read)},
        {MAG_ALIVE, SLV4_DONE | SLV4_NACK},
        {REG_USER_CTRL, 0},

        {MAG_BYPASS, BYPASS_EN},
        {MAG + AK_WIA, PLACE(identity.who_am_i[1])},
        {MAG_IDENTIFY, 0},
        {MAG + AK_CNTL2, SRST},
        {WAIT, MAG_TICKS},
        {MAG + AK_CNTL1, MODE_FUSE},
        {MAG + AK_ASAX, PLACE(identity.mag_adjust)},
        {MAG + AK_CNTL1, MODE_POWER_DOWN},
        {WAIT, MAG_TICKS},

        // AK 6.4.5.
        {MAG + AK_ASTC, SELF_FIELD_ON},
        {MAG + AK_CNTL1, MODE_SELF_TEST},
        {WAIT, MAG_TEST_TICKS},
        {MAG + AK_HXL, PLACE(test.mag_response)},
        {MAG + AK_HXL + MAG_READ, PLACE(test.mag_response) + MAG_READ},
        {MAG + AK_ASTC, SELF_FIELD_OFF},
        {MAG + AK_CNTL1, MODE_POWER_DOWN},
    },
    // kept
    {
        {REG_INT_PIN_CFG, INT_PULSE},  // ends the bypass
        {REG_PWR_MGMT_1, CLKSEL_AUTO},
        {REG_PWR_MGMT_2, 0},
        {REG_CONFIG, DLPF_2},
        {REG_ACCEL_CONFIG_2, DLPF_2},
        {REG_GYRO_CONFIG, FULL_SCALE_3},
        {REG_ACCEL_CONFIG, FULL_SCALE_3},
        {REG_I2C_MST_CTRL, MST_CTRL},
        {REG_I2C_SLV0_ADDR, AK8963_ADDRESS | SLAVE_READ},
        {REG_I2C_SLV0_REG, AK_ST1},
        {REG_I2C_SLV0_CTRL, SLAVE_ENABLE | MPU9250_MAG_BYTES},
        {REG_SMPLRT_DIV, 1000 / MPU9250_RATE_HZ - 1},
        {REG_INT_ENABLE, RAW_DATA_RDY},
    },
    // end
    {
        {VERIFY, 0},
        {MASTER_IF_MAG, I2C_MST_EN},
        // The master's single transfer, by slave 4, follows its read of a
        // sample: measurements then end 2.6 ms after samples, as far from the
        // next read as can be. One that ends during a read is lost
        // (AK 6.4.3.4), and does so for long where the clocks agree.
        {REG_I2C_SLV4_ADDR, AK8963_ADDRESS},
        {REG_I2C_SLV4_REG, AK_CNTL1},
        {REG_I2C_SLV4_DO, MODE_CONTINUOUS_2},
        {REG_I2C_SLV4_CTRL, SLAVE_ENABLE},
        {READ + REG_INT_STATUS, PLACE(read)},  // clears it
        {WAIT, SETTLE_TICKS},
        {READ + REG_INT_STATUS, PLACE(read)},
        {AWAIT_DATA, SETTLE_TICKS + DATA_READY_TICKS},
        {DONE, 0},
    },
};

enum { KEPT_ROWS = sizeof table.kept / sizeof table.kept[0] };

NOINLINE static enum sensor_result read(const IN_FLASH struct bus_device *bus,
                                        uint8_t address, uint8_t reg, uint8_t *data,
                                        uint8_t length) {
    return (enum sensor_result)BUS_PORT(bus)->read(BUS_PORT(bus)->port, address, reg,
                                                   data, length);
}

NOINLINE static enum sensor_result write(const IN_FLASH struct bus_device *bus,
                                         uint8_t address, uint8_t reg, uint8_t value) {
    return (enum sensor_result)BUS_PORT(bus)->write(BUS_PORT(bus)->port, address, reg,
                                                    &value, 1);
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

static void wait_for(struct mpu9250 *chip, uint16_t now, uint8_t ticks) {
    chip->since = now;
    chip->wait = ticks;
}

// The functions of rows: SENSOR_OK where the row is done, SENSOR_BUSY where it
// continues.

// By the names of InvenSense's family. A relative of another name has the power
// registers as a reset leaves them, and as this driver does (RM 107, 108).
static enum sensor_result identify(struct mpu9250 *chip) {
    const uint8_t who = chip->identity.who_am_i[0];
    const bool is_relative = chip->read == CLKSEL_AUTO && chip->count == 0 &&
                             who != WHO_HELD && who != WHO_NOBODY;
    chip->count = 0;
    return is_relative || (who >= WHO_MPU6500 && who <= WHO_MPU6515)
               ? SENSOR_OK
               : SENSOR_WRONG_CHIP;
}

#ifndef ACQUISITION_WIRED_ONLY
// Another that may be at this address has its name at another place.
static enum sensor_result name_other(struct mpu9250 *chip,
                                     const IN_FLASH struct bus_device *bus) {
    const enum sensor_result result =
        read(bus, MPU9250_ADDRESS, REG_OTHER_WHO_AM_I, &chip->read, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if (chip->read == WHO_BMI160 || chip->read == WHO_ICM20948) {
        chip->identity.who_am_i[0] = chip->read;
    }
    return SENSOR_WRONG_CHIP;
}
#endif

static enum sensor_result
test_read(struct mpu9250 *chip, const IN_FLASH struct bus_device *bus, uint8_t place) {
    uint8_t bytes[MPU9250_INERTIAL_BYTES];
    int16_t *out = at(chip, place);
    const enum sensor_result result =
        read(bus, MPU9250_ADDRESS, MPU9250_REG_ACCEL_XOUT_H, bytes, sizeof bytes);
    (void)mpu9250_take_axes(bytes, out);
    (void)mpu9250_take_axes(bytes + MPU9250_GYR_PLACE, out + 3);
    return result;
}

static enum sensor_result await_force(struct mpu9250 *chip, uint16_t now,
                                      uint8_t ticks) {
    uint16_t square = 0;  // 2^-16ths; at most 3 * 2^14
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t counts = chip->test.before[axis];
        square = (uint16_t)(square + fixed_high_half((uint32_t)(counts * counts)));
    }
    if (square >= FORCE_SQUARE_MIN && square <= FORCE_SQUARE_MAX) {
        return SENSOR_OK;
    }
    ++chip->count;
    chip->step = (uint8_t)(chip->step - 2);
    wait_for(chip, now, ticks);
    return chip->count < FORCE_TRIES ? SENSOR_OK : SENSOR_NO_FORCE;
}

// Without an AK8963 that answers the probe has six axes, as identity shows.
NOINLINE static void mag_is_absent(struct mpu9250 *chip) {
    set_has_mag(chip, false);
    chip->identity.kind = SENSOR_MPU6500;
    memset(&chip->identity.who_am_i[1], 0, 4);
}

// A set-up that the AK8963 has spoiled. Where it holds its bus, and so that of the host
// while the bypass is on, recovery of the bus then clocks it free.
static enum sensor_result mag_failed(struct mpu9250 *chip) {
    chip->mag_failures = mag_failed_again(chip->mag_failures);
    return SENSOR_MAG_STUCK;
}

static enum sensor_result do_mag_row(struct mpu9250 *chip,
                                     const IN_FLASH struct bus_device *bus,
                                     uint16_t now, uint8_t what, uint8_t value) {
    if (!mpu9250_has_mag(chip)) {
        return SENSOR_OK;
    }
    if (what == MAG_IDENTIFY) {
        if (chip->identity.who_am_i[1] != AK8963_ID) {
            mag_is_absent(chip);
        }
        return SENSOR_OK;
    }
    enum sensor_result result;
    const uint8_t reg = (uint8_t)(what - MAG);
    if (what == MAG_BYPASS) {
        result = write(bus, MPU9250_ADDRESS, REG_INT_PIN_CFG, value);
    } else if (reg < AK_CNTL1 || reg > AK_ASTC) {
        result = read(bus, AK8963_ADDRESS, reg, at(chip, value), MAG_READ);
    } else {
        result = write(bus, AK8963_ADDRESS, reg, value);
    }
    if (result == SENSOR_OK) {
        return SENSOR_OK;
    }
    if (result != SENSOR_BUS_NACK) {
        return mag_failed(chip);
    }
    wait_for(chip, now, MAG_TICKS);
    ++chip->count;
    if (chip->count >= MAG_TRIES) {
        mag_is_absent(chip);
    }
    return SENSOR_BUSY;
}

static enum sensor_result await_data(struct mpu9250 *chip, uint16_t now,
                                     uint8_t ticks) {
    if ((chip->read & RAW_DATA_RDY) != 0) {
        return SENSOR_OK;
    }
    chip->step = (uint8_t)(chip->step - 2);
    if (is_within(chip, now, ticks)) {
        return SENSOR_OK;
    }
    if (mpu9250_has_mag(chip)) {
        return mag_failed(chip);  // for which the chip's master waits, and the chip
    }
    chip->mag_failures = 0;  // it was the chip
    return SENSOR_STUCK;
}

// Reads back a register that keeps its value; SENSOR_OK after the last of them.
static enum sensor_result verify(struct mpu9250 *chip,
                                 const IN_FLASH struct bus_device *bus) {
    const struct row row = table.kept[chip->verified];
    const enum sensor_result result =
        read(bus, MPU9250_ADDRESS, row.what, &chip->read, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if (chip->read != row.value) {
        chip->identity.wrong_register = row.what;
        return SENSOR_UNSET;
    }
    ++chip->verified;
    if (chip->verified < KEPT_ROWS) {
        return SENSOR_BUSY;
    }
    chip->verified = 0;
    return SENSOR_OK;
}

static enum sensor_result do_row(struct mpu9250 *chip,
                                 const IN_FLASH struct bus_device *bus, uint16_t now,
                                 uint8_t what, uint8_t value) {
    if (what >= READ) {
        return read(bus, MPU9250_ADDRESS, (uint8_t)(what - READ), at(chip, value), 1);
    }
    if (what >= MAG && what < MAG_END) {
        return do_mag_row(chip, bus, now, what, value);
    }
    switch (what) {
    case WAIT:
        wait_for(chip, now, value);
        return SENSOR_OK;
    case IDENTIFY: {
        enum sensor_result result = identify(chip);
#ifndef ACQUISITION_WIRED_ONLY
        if (result == SENSOR_WRONG_CHIP) {
            result = name_other(chip, bus);
        }
#endif
        return result;
    }
    case SKIP_IF_TESTED:
        if (chip->identity.self_test != 0) {
            chip->step = (uint8_t)(chip->step + value);
        }
        return SENSOR_OK;
    case TEST_READ:
        return test_read(chip, bus, value);
    case AWAIT_FORCE:
        return await_force(chip, now, value);
    case TEST_END:
        chip->identity.self_test = SELF_TEST_HOST_JUDGES;
        chip->count = 0;
        return SENSOR_OK;
    case AWAIT_DATA:
        return await_data(chip, now, value);
    case VERIFY:
        return verify(chip, bus);
    case MAG_ALIVE:
        // Held since its power came: nothing frees it, and no attempt may be made.
        if ((chip->read & value) == 0 && chip->was_running == 0) {
            chip->mag_failures = MAG_NEVER;
            mag_is_absent(chip);
        }
        return SENSOR_OK;
    case MASTER_IF_MAG:
        what = REG_USER_CTRL;
        if (!mpu9250_has_mag(chip)) {
            value = 0;
        }
        break;
    default:
        break;
    }
    return write(bus, MPU9250_ADDRESS, what, value);
}

#ifndef ACQUISITION_WIRED_ONLY
// RM 58: reading it clears it.
const struct sensor_ready mpu9250_ready = {MPU9250_ADDRESS, REG_INT_STATUS,
                                           RAW_DATA_RDY};
#endif

void mpu9250_begin(void *state) {
    struct mpu9250 *chip = state;
    const uint8_t self_test = chip->identity.self_test;
    memset(chip, 0, offsetof(struct mpu9250, mag_failures));
    chip->identity = mpu9250_known;
    chip->identity.self_test = self_test;
    chip->identity.answers = &chip->test;
    chip->bursts[0].address = MPU9250_ADDRESS;
    chip->bursts[0].reg = MPU9250_REG_ACCEL_XOUT_H;
    set_has_mag(chip, true);
    if (mag_is_left_out(chip->mag_failures)) {
        mag_is_absent(chip);
    }
}

enum sensor_result mpu9250_setup(void *state, const IN_FLASH struct bus_device *bus,
                                 uint32_t now_us) {
    struct mpu9250 *chip = state;
    const IN_FLASH struct row *const rows = (const IN_FLASH struct row *)&table;
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

// Looks for an AK8963 that was absent: each time later where it holds the bus, which
// ends in a new set-up. With its master off the chip minds no bypass.
static enum sensor_result look_for_mag(struct mpu9250 *chip,
                                       const IN_FLASH struct bus_device *bus) {
    ++chip->mag_age;
    if (chip->mag_age <= chip->mag_failures) {
        return SENSOR_OK;
    }
    chip->mag_age = 0;
    chip->read = 0;
    enum sensor_result result = write(bus, MPU9250_ADDRESS, REG_INT_PIN_CFG, BYPASS_EN);
    if (result == SENSOR_OK) {
        result = read(bus, AK8963_ADDRESS, AK_WIA, &chip->read, 1);
    }
    if (result != SENSOR_OK && result != SENSOR_BUS_NACK) {
        return mag_failed(chip);
    }
    if (chip->read == AK8963_ID) {
        chip->mag_failures = mag_tried_again(chip->mag_failures);
        return SENSOR_MAG_CHANGED;
    }
    return write(bus, MPU9250_ADDRESS, REG_INT_PIN_CFG, INT_PULSE);
}

enum sensor_result mpu9250_check(void *state, const IN_FLASH struct bus_device *bus) {
    struct mpu9250 *chip = state;
    const enum sensor_result result = verify(chip, bus);
    if (!mpu9250_has_mag(chip)) {
        return result == SENSOR_OK ? look_for_mag(chip, bus) : result;
    }
    ++chip->mag_age;
    if (chip->mag_age <= MAG_SILENT_LOOKS) {
        return result;
    }
    (void)mag_failed(chip);
    return SENSOR_MAG_CHANGED;
}
