// SPDX-License-Identifier: MIT
// The MPU-9250's bursts to samples; documents: mpu9250_private.h.
#include "core/drivers/mpu9250_private.h"

#include "core/math/fixed.h"

enum {
    // Of the AK8963.
    ST1_DRDY = 0x01,
    ST1_DOR = 0x02,
    ST2_HOFL = 0x08,
    ST2_BITM = 0x10,  // mirrors CNTL1: 16 bits

    AK_COUNTS_MAX = 32760,  // AK 8.3: measurement data, 4912 uT
};

const IN_FLASH struct sensor_identity mpu9250_known = {
    .kind = SENSOR_MPU9250,
    .rate_hz = MPU9250_RATE_HZ,
    .gyr_delay_us = MPU9250_GYR_DELAY_US,
    .gyr_lsb_nrad_s = SENSOR_NANO_RAD(2000) / 32768,
    .acc_lsb_nm_s2 = SENSOR_NANO_G(16) / 32768,
    .mag_lsb_pt = 150000,  // AK 5: 0.15 uT
};

bool mpu9250_take_axes(const uint8_t *bytes, int16_t *out) {
    bool is_clipped = false;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int16_t value = mpu9250_word(bytes + 2 * axis);
        // 32767, -32768 and -32767 follow each other modulo 2^16.
        is_clipped |= (uint16_t)((uint16_t)value - INT16_MAX) < 3;
        out[axis] = value;
    }
    return is_clipped;
}

// Takes the AK8963's block of MPU9250_MAG_BYTES where it is a reading that was not
// there before. Needs the fields of `out` for it cleared.
static void take_field(struct mpu9250 *chip, const uint8_t *block, struct sample *out) {
    const uint8_t st1 = block[0];
    const uint8_t st2 = block[MPU9250_MAG_BYTES - 1];
    const bool was_ready = chip->was_ready;
    chip->was_ready = (st1 & ST1_DRDY) != 0;
    if ((st1 & (uint8_t)~ST1_DOR) != ST1_DRDY ||
        (st2 & (uint8_t)~ST2_HOFL) != ST2_BITM) {
        return;
    }
    // Measurements are 10 ms apart, samples 5: ready twice running with the same data
    // is a block that the chip's master did not renew.
    bool is_new = !was_ready;
    for (uint8_t i = 0; i < sizeof chip->mag; ++i) {
        const uint8_t byte = block[1 + i];
        is_new |= byte != chip->mag[i];
        chip->mag[i] = byte;
    }
    if (!is_new) {
        return;
    }
    bool is_beyond = (st2 & ST2_HOFL) != 0;
    int16_t field[3];
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const uint8_t *data = chip->mag + 2 * axis;
        const int16_t raw = (int16_t)(uint16_t)(data[1] * 256u + data[0]);
        if (raw > AK_COUNTS_MAX || raw < -AK_COUNTS_MAX) {
            return;  // no counts of an AK8963
        }
        // H * ((ASA - 128) * 0.5 / 128 + 1), AK 8.3; |raw| <= 32768 and ASA <= 255 keep
        // it within 49152.
        const int16_t factor = (int16_t)(128 + chip->identity.mag_adjust[axis]);
        const int32_t adjusted = fixed_scale_down((int32_t)raw * factor, 8);
        field[axis] = (int16_t)adjusted;
        is_beyond |= fixed_magnitude(adjusted) > INT16_MAX;
    }
    chip->mag_age = 0;
    chip->mag_failures = 0;
    if (is_beyond) {
        out->mag_overflow = true;
        return;
    }
    out->has_mag = true;
    // PS 9.1: the AK8963's x is the others' y, its y their x, its z points the other
    // way.
    out->mag = (struct counts){.x = field[1], .y = field[0], .z = (int16_t)-field[2]};
}

// The byte of an undriven or held bus: no reading.
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
    out->acc_clipped = mpu9250_take_axes(bytes, out->acc.axis);
    out->gyr_clipped = mpu9250_take_axes(bytes + MPU9250_GYR_PLACE, out->gyr.axis);
    // RM 65: TEMP_OUT / 333.87 + 21 degC.
    out->temperature_cdeg =
        (int16_t)(fixed_scale_down(mpu9250_word(bytes + MPU9250_TEMPERATURE_PLACE) *
                                       Q16(100 / 333.87),
                                   16) +
                  2100);
    out->mag = (struct counts){0};
    out->has_mag = false;
    out->mag_overflow = false;
    if (mpu9250_has_mag(chip)) {
        take_field(chip, bytes + MPU9250_INERTIAL_BYTES, out);
    }
    return true;
}
