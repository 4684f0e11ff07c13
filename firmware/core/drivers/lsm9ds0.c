// SPDX-License-Identifier: MIT
// The LSM9DS0's bursts to samples; document: lsm9ds0_private.h.
#include "core/drivers/lsm9ds0_private.h"

#include "core/math/fixed.h"

enum {
    OVERRUN = 0x80,  // STATUS_REG_G: of all axes
    HELD_MAX = 4,    // 11 ms at 380 Hz: the accelerometer stands still

    GYR_PLACE = 0,  // among the bytes of a sample
    ACC_PLACE = GYR_PLACE + LSM9DS0_AXES_BYTES,
    TEMPERATURE_PLACE = ACC_PLACE + LSM9DS0_AXES_BYTES,
    MAG_PLACE = TEMPERATURE_PLACE + LSM9DS0_TEMPERATURE_BYTES,
    SAMPLE_BYTES = MAG_PLACE + LSM9DS0_AXES_BYTES,
};

_Static_assert((int)SAMPLE_BYTES <= (int)BUS_BURST_MAX, "a sample fits its place");

// Counts at the ends of the ranges, DS table 3.
enum {
    GYR_COUNTS_MAX = INT32_C(2000000) / 70,    // 2000 deg/s, 70 mdps each
    ACC_COUNTS_MAX = INT32_C(16000000) / 732,  // 16 g, 0.732 mg each
    MAG_COUNTS_MAX = INT32_C(200000) / 8,      // 2 gauss, 0.08 mgauss each
};

// Three axes after their status; true where one is beyond its range.
static bool take_axes(const uint8_t *bytes, int16_t limit, struct counts *out) {
    bool is_beyond = false;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = lsm9ds0_word(bytes + 1 + 2 * axis);
        is_beyond |= fixed_magnitude(out->axis[axis]) > (uint16_t)limit;
    }
    return is_beyond;
}

static bool is_fresh(const uint8_t *status) {
    return (*status & LSM9DS0_DATA_READY) == LSM9DS0_DATA_READY;
}

// The bytes of an undriven bus, which power that fails amid a sample leaves: all ones.
// All zeros are not fresh.
static bool is_floating(const uint8_t *bytes, uint8_t count) {
    for (uint8_t i = 0; i < count; ++i) {
        if (bytes[i] != 0xFF) {
            return false;
        }
    }
    return true;
}

// DS table 4: 8 counts a degC, 12 bits to the right. It gives no zero: 25 degC is that
// of ST's later parts, and may be some degrees off.
static int16_t temperature_cdeg(const uint8_t *bytes) {
    // The sign is bit 11: within +-2048.
    const int16_t raw = (int16_t)(bytes[1] % 16 * 256 + bytes[0]);
    const int32_t counts = raw < 2048 ? raw : raw - 4096;
    return (int16_t)(2500 + fixed_half_floor(counts * 25));  // within +-28100
}

bool lsm9ds0_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                   struct sample *out) {
    struct lsm9ds0 *chip = state;
    const uint8_t *gyr = bytes + GYR_PLACE;
    const uint8_t *acc = bytes + ACC_PLACE;
    const uint8_t *mag = bytes + MAG_PLACE;
    const bool is_held = !is_fresh(acc);
    if (!is_fresh(gyr) || is_floating(gyr, TEMPERATURE_PLACE) ||
        is_floating(acc, SAMPLE_BYTES - ACC_PLACE) ||
        (is_held && chip->held == HELD_MAX)) {
        return false;
    }
    chip->held = is_held ? (uint8_t)(chip->held + 1) : 0;
    out->time_us = time_us;
    out->acc_clipped = take_axes(acc, ACC_COUNTS_MAX, &out->acc);
    out->gyr_clipped = take_axes(gyr, GYR_COUNTS_MAX, &out->gyr);
    out->temperature_cdeg = temperature_cdeg(bytes + TEMPERATURE_PLACE);
    const bool has_mag = is_fresh(mag) && !is_floating(mag, LSM9DS0_AXES_BYTES);
    chip->mag_measured |= has_mag;
    out->has_mag = chip->has_mag && has_mag;
    out->mag_overflow = false;
    out->mag = (struct counts){0};
    if (out->has_mag) {
        out->mag_overflow = take_axes(mag, MAG_COUNTS_MAX, &out->mag);
        out->has_mag = !out->mag_overflow;
        // DS figure 1: the sensors share their axes, right-handed, but the
        // magnetometer's z points into the package.
        out->mag.z = (int16_t)fixed_clamp(-(int32_t)out->mag.z, INT16_MAX);
    }
    if ((*gyr & OVERRUN) != 0) {
        out->has_gap = true;
    }
    return true;
}
