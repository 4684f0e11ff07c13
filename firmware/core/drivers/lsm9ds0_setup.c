// SPDX-License-Identifier: MIT
// Set-up and self-test of the LSM9DS0; looks after it. Document: lsm9ds0_private.h.
#include <string.h>

#include "core/drivers/lsm9ds0_private.h"
#include "core/drivers/mag_watch.h"
#include "core/math/fixed.h"
#include "core/wire/messages.h"

enum {
    AUTO_INCREMENT = 0x80,  // DS 6.1.1: of the sub-address, in both halves

    // Both halves.
    REG_WHO_AM_I = 0x0F,
    WHO_AM_I_G = 0xD4,
    WHO_AM_I_XM = 0x49,
    BOOT = 0x80,  // CTRL_REG5_G, CTRL_REG0_XM: reloads the trimming

    // Gyroscope.
    REG_CTRL1_G = 0x20,  // then CTRL_REG2_G to CTRL_REG5_G
    REG_CTRL5_G = 0x24,
    REG_STATUS_G = 0x27,  // then three axes, little-endian
    G_380_HZ = 0x80,      // CTRL_REG1_G: DR
    G_760_HZ = 0xC0,
    G_100_HZ_LOW_PASS = 0x30,  // CTRL_REG1_G: BW, at either rate
    G_ON = 0x0F,               // CTRL_REG1_G: PD, all axes
    G_DRDY = 0x08,             // CTRL_REG3_G: data-ready on pin DRDY_G, active high
    G_BDU = 0x80,              // CTRL_REG4_G
    G_2000_DPS = 0x20,         // CTRL_REG4_G: FS
    G_SELF_TEST = 0x02,        // CTRL_REG4_G: ST 01
    G_LOW_PASSED = 0x02,       // CTRL_REG5_G: Out_Sel, output of LPF2

    // Accelerometer and magnetometer.
    REG_TEMPERATURE = 0x05,  // two bytes; then STATUS_REG_M, three axes
    REG_STATUS_M = 0x07,
    REG_CTRL0_XM = 0x1F,  // then CTRL_REG1_XM to CTRL_REG7_XM
    REG_CTRL1_XM = 0x20,
    REG_CTRL7_XM = 0x26,
    REG_STATUS_A = 0x27,  // then three axes
    A_800_HZ = 0x90,      // CTRL_REG1_XM: AODR
    A_1600_HZ = 0xA0,
    XM_BDU = 0x08,    // CTRL_REG1_XM: of both sensors
    A_AXES = 0x07,    // CTRL_REG1_XM
    A_194_HZ = 0x40,  // CTRL_REG2_XM: ABW, half of 380 Hz against aliases
    A_2_G = 0x00,     // CTRL_REG2_XM: AFS
    A_16_G = 0x20,
    A_SELF_TEST = 0x02,    // CTRL_REG2_XM: AST 01
    M_TEMPERATURE = 0x80,  // CTRL_REG5_XM: TEMP_EN
    M_FINE = 0x60,         // CTRL_REG5_XM: M_RES, high
    M_100_HZ = 0x14,       // CTRL_REG5_XM: M_ODR
    M_2_GAUSS = 0x00,      // CTRL_REG6_XM: MFS
    M_CONTINUOUS = 0x00,   // CTRL_REG7_XM: MD
    M_OFF = 0x02,

    G_VALUES = 5,   // of CTRL_REG1_G to CTRL_REG5_G
    XM_VALUES = 8,  // of CTRL_REG0_XM to CTRL_REG7_XM
};

enum {
    TICK_US = 1024,          // a wait of n ticks lasts more than n - 1
    BOOT_TICKS = 20,         // twice what a boot takes at most, 10 ms
    GYR_START_TICKS = 784,   // 800 ms, as long as ST has its gyroscopes tested after
    TEST_SETTLE_TICKS = 60,  // and after its stimulus changes
    TEST_PERIOD_TICKS = 3,   // a sample at 380 Hz
    TEST_SAMPLES = 32,
    RUN_SETTLE_TICKS = 30,  // three measurements of the slowest, at 100 Hz
    DATA_READY_TICKS = 60,

    // Of the self-test, DS table 3, as sums of TEST_SAMPLES: 150 to 1000 deg/s at 70
    // mdps; 60 to 1700 mg at 0.061 mg.
    GYR_RESPONSE_MIN = ROUNDED(150 / 0.07) * TEST_SAMPLES,
    GYR_RESPONSE_MAX = ROUNDED(1000 / 0.07) * TEST_SAMPLES,
    ACC_RESPONSE_MIN = ROUNDED(60 / 0.061) * TEST_SAMPLES,
    ACC_RESPONSE_MAX = ROUNDED(1700 / 0.061) * TEST_SAMPLES,
    // How far a rate may stray from the first of a run: 4 deg/s.
    MOVING = ROUNDED(4 / 0.07),
};

enum step {
    POWER_UP,
    IDENTIFY,
    START,
    TEST_BEGIN,
    TEST_OFF,
    TEST_STIMULATE,
    TEST_ON,
    TEST_END,
    RUN,
    VERIFY,
    VERIFY_OTHER,
    READY,
    DONE,
};

enum {
    GYR_READY = 1,
    ACC_READY = 2,
    MAG_READY = 4,
};

static uint8_t sub_address(uint8_t reg, uint8_t length) {
    return length > 1 ? (uint8_t)(reg | AUTO_INCREMENT) : reg;
}

static enum sensor_result read_registers(const IN_FLASH struct bus_device *bus,
                                         uint8_t address, uint8_t reg, uint8_t *data,
                                         uint8_t length) {
    return (enum sensor_result)bus->read(bus->port, address, sub_address(reg, length),
                                         data, length);
}

static enum sensor_result write_registers(const IN_FLASH struct bus_device *bus,
                                          uint8_t address, uint8_t reg,
                                          const uint8_t *data, uint8_t length) {
    return (enum sensor_result)bus->write(bus->port, address, sub_address(reg, length),
                                          data, length);
}

// The configuration of each half: its control registers' values. Of the gyroscope, its
// stimulus on or off.
static void gyr_values(const struct lsm9ds0 *chip, uint8_t stimulus,
                       uint8_t values[G_VALUES]) {
    const uint8_t rate = chip->config.is_fast ? G_760_HZ : G_380_HZ;
    values[0] = (uint8_t)(rate | G_100_HZ_LOW_PASS | G_ON);
    values[1] = 0;
    values[2] = G_DRDY;
    values[3] = (uint8_t)(G_BDU | G_2000_DPS | stimulus);
    values[4] = G_LOW_PASSED;
}

// Of the other half, with the accelerometer's range and stimulus.
static void xm_values(const struct lsm9ds0 *chip, uint8_t range,
                      uint8_t values[XM_VALUES]) {
    // Twice the sample rate and more, whatever the two clocks: else an acceleration
    // that comes as its status is read could seem old for many samples on end.
    const uint8_t rate = chip->config.is_fast ? A_1600_HZ : A_800_HZ;
    memset(values, 0, XM_VALUES);
    values[1] = (uint8_t)(rate | XM_BDU | A_AXES);
    values[2] = (uint8_t)(A_194_HZ | range);
    values[5] = M_TEMPERATURE | M_FINE | M_100_HZ;
    values[6] = M_2_GAUSS;
    values[7] = M_CONTINUOUS;
}

// On to the next step, after a wait.
static enum sensor_result go_on(struct lsm9ds0 *chip, uint16_t now, uint16_t wait) {
    ++chip->step;
    chip->count = 0;
    chip->since = now;
    chip->wait = wait;
    return SENSOR_BUSY;
}

static bool is_within(const struct lsm9ds0 *chip, uint16_t now, uint16_t wait) {
    return (uint16_t)(now - chip->since) < wait;
}

// Each half by its name, before a register of a chip that may be another is written.
static enum sensor_result
identify(struct lsm9ds0 *chip, const IN_FLASH struct bus_device *bus, uint16_t now) {
    const struct lsm9ds0_config *config = &chip->config;
    struct sensor_identity *identity = &chip->identity;
    uint8_t *who = identity->who_am_i;
    enum sensor_result result =
        read_registers(bus, config->gyr_address, REG_WHO_AM_I, &who[0], 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if (who[0] != WHO_AM_I_G) {
        return SENSOR_WRONG_CHIP;
    }
    result = read_registers(bus, config->xm_address, REG_WHO_AM_I, &who[1], 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if (who[1] != WHO_AM_I_XM) {
        who[0] = who[1];
        who[1] = 0;
        return SENSOR_WRONG_CHIP;
    }
    identity->kind = SENSOR_LSM9DS0;
    identity->rate_hz = config->is_fast ? LSM9DS0_FAST_RATE_HZ : LSM9DS0_RATE_HZ;
    identity->gyr_delay_us = LSM9DS0_GYR_DELAY_US;
    identity->mag_lag_us = LSM9DS0_MAG_LAG_US;
    identity->gyr_lsb_nrad_s = SENSOR_NANO_RAD(0.07);
    identity->acc_lsb_nm_s2 = SENSOR_NANO_G(0.000732);
    identity->mag_lsb_pt = 8000;  // 0.08 mgauss
    const uint8_t boot = BOOT;
    result = write_registers(bus, config->gyr_address, REG_CTRL5_G, &boot, 1);
    if (result == SENSOR_OK) {
        result = write_registers(bus, config->xm_address, REG_CTRL0_XM, &boot, 1);
    }
    return result == SENSOR_OK ? go_on(chip, now, BOOT_TICKS) : result;
}

// Writes both halves, then waits.
static enum sensor_result configure(struct lsm9ds0 *chip,
                                    const IN_FLASH struct bus_device *bus, uint16_t now,
                                    uint8_t gyr_stimulus, uint8_t acc_range,
                                    uint16_t wait) {
    uint8_t values[XM_VALUES];
    gyr_values(chip, gyr_stimulus, values);
    enum sensor_result result =
        write_registers(bus, chip->config.gyr_address, REG_CTRL1_G, values, G_VALUES);
    if (result == SENSOR_OK) {
        xm_values(chip, acc_range, values);
        result = write_registers(bus, chip->config.xm_address, REG_CTRL0_XM, values,
                                 XM_VALUES);
    }
    return result == SENSOR_OK ? go_on(chip, now, wait) : result;
}

static enum sensor_result
test_begin(struct lsm9ds0 *chip, const IN_FLASH struct bus_device *bus, uint16_t now) {
    if (chip->identity.self_test != 0) {
        chip->step = RUN;
        return SENSOR_BUSY;
    }
    return configure(chip, bus, now, 0, A_2_G, TEST_SETTLE_TICKS);
}

// Adds one sample of a run; TEST_SAMPLES * 32768 fit by far.
static enum sensor_result
test_sample(struct lsm9ds0 *chip, const IN_FLASH struct bus_device *bus, uint16_t now) {
    uint8_t acc[LSM9DS0_AXES_BYTES];
    uint8_t gyr[LSM9DS0_AXES_BYTES];
    const struct lsm9ds0_config *config = &chip->config;
    enum sensor_result result =
        read_registers(bus, config->gyr_address, REG_STATUS_G, gyr, sizeof gyr);
    if (result == SENSOR_OK) {
        result = read_registers(bus, config->xm_address, REG_STATUS_A, acc, sizeof acc);
    }
    if (result != SENSOR_OK) {
        return result;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const uint8_t place = (uint8_t)(1 + 2 * axis);
        const bool is_first = chip->count == 0;
        self_test_add(&chip->test, axis, lsm9ds0_word(acc + place), is_first, MOVING);
        self_test_add(&chip->test, (uint8_t)(SELF_TEST_GYR + axis),
                      lsm9ds0_word(gyr + place), is_first, MOVING);
    }
    chip->since = now;
    chip->wait = TEST_PERIOD_TICKS;
    ++chip->count;
    return chip->count < TEST_SAMPLES ? SENSOR_BUSY : go_on(chip, now, 0);
}

// True where all three axes answered within the limits. The sign of the gyroscope's
// differs between axes.
static bool responds(const struct self_test_axis *axes, uint32_t low, uint32_t high) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const uint32_t size = fixed_magnitude(axes[axis].sum);
        if (size < low || size > high) {
            return false;
        }
    }
    return true;
}

static enum sensor_result test_end(struct lsm9ds0 *chip, uint16_t now) {
    struct self_test *test = &chip->test;
    if (!responds(test->axes, ACC_RESPONSE_MIN, ACC_RESPONSE_MAX)) {
        test->failed |= SELF_TEST_ACC_PASSED;
    }
    if (!responds(test->axes + SELF_TEST_GYR, GYR_RESPONSE_MIN, GYR_RESPONSE_MAX)) {
        test->failed |= SELF_TEST_GYR_PASSED;
    }
    self_test_end(test, &chip->identity);
    return go_on(chip, now, 0);
}

// Notes whether the sensor whose status that is has data, unless the bus has failed.
static enum sensor_result look_for(struct lsm9ds0 *chip,
                                   const IN_FLASH struct bus_device *bus,
                                   enum sensor_result before, uint8_t flag,
                                   uint8_t address, uint8_t reg) {
    uint8_t status = 0;
    const enum sensor_result result =
        before == SENSOR_OK ? read_registers(bus, address, reg, &status, 1) : before;
    if (result == SENSOR_OK && (status & LSM9DS0_DATA_READY) == LSM9DS0_DATA_READY) {
        chip->ready |= flag;
    }
    return result;
}

// Waits for all three sensors. The gyroscope's data are then read, so that DRDY_G is
// low and rises with the next.
static enum sensor_result ready(struct lsm9ds0 *chip,
                                const IN_FLASH struct bus_device *bus, uint16_t now) {
    const uint8_t g = chip->config.gyr_address;
    const uint8_t xm = chip->config.xm_address;
    enum sensor_result result = SENSOR_OK;
    result = look_for(chip, bus, result, GYR_READY, g, REG_STATUS_G);
    result = look_for(chip, bus, result, ACC_READY, xm, REG_STATUS_A);
    result = look_for(chip, bus, result, MAG_READY, xm, REG_STATUS_M);
    if (result != SENSOR_OK) {
        return result;
    }
    if (chip->ready != (GYR_READY | ACC_READY | MAG_READY)) {
        if (is_within(chip, now, DATA_READY_TICKS)) {
            return SENSOR_BUSY;
        }
        if ((chip->ready & GYR_READY) == 0 || (chip->ready & ACC_READY) == 0) {
            return SENSOR_STUCK;
        }
    }
    uint8_t unused[LSM9DS0_AXES_BYTES];
    result = read_registers(bus, g, REG_STATUS_G, unused, sizeof unused);
    if (result != SENSOR_OK) {
        return result;
    }
    chip->has_mag =
        (chip->ready & MAG_READY) != 0 && !mag_is_left_out(chip->mag_failures);
    if (!chip->has_mag) {
        chip->identity.who_am_i[1] = 0;
        chip->identity.self_test |= SELF_TEST_MAG_FAILED;
    }
    (void)go_on(chip, now, 0);
    return SENSOR_OK;
}

// One that does not measure, or measures again, is for a new set-up.
static enum sensor_result watch_mag(struct lsm9ds0 *chip) {
    const bool measured = chip->mag_measured;
    chip->mag_measured = false;
    ++chip->mag_age;
    if (chip->has_mag && measured) {
        chip->mag_age = 0;
        chip->mag_failures = 0;
    } else if (chip->has_mag && chip->mag_age > MAG_SILENT_LOOKS) {
        chip->mag_failures = mag_failed_again(chip->mag_failures);
        return SENSOR_MAG_CHANGED;
    } else if (measured && !chip->has_mag && chip->mag_age > chip->mag_failures) {
        chip->mag_failures = mag_tried_again(chip->mag_failures);
        return SENSOR_MAG_CHANGED;
    }
    return SENSOR_OK;
}

// Reads back one half, the halves in turn.
enum sensor_result lsm9ds0_check(void *state, const IN_FLASH struct bus_device *bus) {
    struct lsm9ds0 *chip = state;
    uint8_t wanted[XM_VALUES];
    uint8_t found[XM_VALUES];
    const bool is_xm = chip->checks_xm;
    const uint8_t address = is_xm ? chip->config.xm_address : chip->config.gyr_address;
    const uint8_t reg = is_xm ? REG_CTRL0_XM : REG_CTRL1_G;
    const uint8_t count = is_xm ? XM_VALUES : G_VALUES;
    if (is_xm) {
        xm_values(chip, A_16_G, wanted);
    } else {
        gyr_values(chip, 0, wanted);
    }
    chip->checks_xm = !is_xm;
    const enum sensor_result result = read_registers(bus, address, reg, found, count);
    for (uint8_t i = 0; result == SENSOR_OK && i < count; ++i) {
        if (found[i] != wanted[i]) {
            chip->identity.wrong_register = (uint8_t)(reg + i);
            return SENSOR_UNSET;
        }
    }
    return result == SENSOR_OK && is_xm && chip->step == DONE ? watch_mag(chip)
                                                              : result;
}

void lsm9ds0_begin(void *state) {
    struct lsm9ds0 *chip = state;
    const struct lsm9ds0_config config = chip->config;
    const uint8_t verdict = chip->identity.self_test & (uint8_t)~SELF_TEST_MAG_FAILED;
    const uint8_t mag_failures = chip->mag_failures;
    memset(chip, 0, sizeof *chip);
    chip->mag_failures = mag_failures;
    chip->config = config;
    chip->identity.self_test = verdict;
    chip->bursts[0] = (struct bus_burst){
        config.gyr_address, REG_STATUS_G | AUTO_INCREMENT, LSM9DS0_AXES_BYTES};
    chip->bursts[1] = (struct bus_burst){
        config.xm_address, REG_STATUS_A | AUTO_INCREMENT, LSM9DS0_AXES_BYTES};
    chip->bursts[2] =
        (struct bus_burst){config.xm_address, REG_TEMPERATURE | AUTO_INCREMENT,
                           LSM9DS0_TEMPERATURE_BYTES + LSM9DS0_AXES_BYTES};
}

static enum sensor_result verify(struct lsm9ds0 *chip,
                                 const IN_FLASH struct bus_device *bus, uint16_t now) {
    const enum sensor_result result = lsm9ds0_check(chip, bus);
    return result == SENSOR_OK ? go_on(chip, now, 0) : result;
}

enum sensor_result lsm9ds0_setup(void *state, const IN_FLASH struct bus_device *bus,
                                 uint32_t now_us) {
    struct lsm9ds0 *chip = state;
    // Ticks wrap after 67 s, at the wrap of now_us too: waits are far shorter.
    const uint16_t now = (uint16_t)(now_us / TICK_US);
    if (is_within(chip, now, chip->wait)) {
        return SENSOR_BUSY;
    }
    switch ((enum step)chip->step) {
    case POWER_UP:
        return go_on(chip, now, BOOT_TICKS);
    case IDENTIFY:
        return identify(chip, bus, now);
    case START:
        return configure(chip, bus, now, 0, A_16_G, GYR_START_TICKS);
    case TEST_BEGIN:
        return test_begin(chip, bus, now);
    case TEST_STIMULATE:
        return configure(chip, bus, now, G_SELF_TEST, A_2_G | A_SELF_TEST,
                         TEST_SETTLE_TICKS);
    case TEST_OFF:
    case TEST_ON:
        return test_sample(chip, bus, now);
    case TEST_END:
        return test_end(chip, now);
    case RUN:
        return configure(chip, bus, now, 0, A_16_G, RUN_SETTLE_TICKS);
    case VERIFY:
    case VERIFY_OTHER:
        return verify(chip, bus, now);
    case READY:
        return ready(chip, bus, now);
    case DONE:
        break;
    }
    return SENSOR_OK;
}

bool lsm9ds0_power_down(const struct lsm9ds0 *chip,
                        const IN_FLASH struct bus_device *bus) {
    const uint8_t off = 0;  // CTRL_REG1_G: PD; CTRL_REG1_XM: AODR
    const uint8_t mag_off = M_OFF;
    const uint8_t g = chip->config.gyr_address;
    const uint8_t xm = chip->config.xm_address;
    return write_registers(bus, g, REG_CTRL1_G, &off, 1) == SENSOR_OK &&
           write_registers(bus, xm, REG_CTRL1_XM, &off, 1) == SENSOR_OK &&
           write_registers(bus, xm, REG_CTRL7_XM, &mag_off, 1) == SENSOR_OK;
}
