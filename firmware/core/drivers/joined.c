// SPDX-License-Identifier: MIT
// See joined.h.
#include "core/drivers/joined.h"

#include <string.h>

#include "core/drivers/mag_watch.h"
#include "core/math/fixed.h"

enum { MAG_TRIES = 3 };  // of its set-up, before it is left out

enum phase {
    SET_UP_INERTIAL,
    SET_UP_MAGNETIC,
    CLEAR,  // reads a sample away, so that data-ready is low and rises with the next
    DONE,
};

static void begin_part(struct part *part, const IN_FLASH struct part_chip *chip) {
    part->chip = chip;
    part_begin(part);
}

static void identify(struct joined *joined) {
    const struct part *part = &joined->inertial;
    joined->identity = *part->kind;
    joined->identity.who_am_i[0] = part->who_am_i;
    joined->identity.wrong_register = part->wrong_register;
    joined->identity.mag_lsb_pt = joined->config->magnetic->mag_lsb_pt;
    joined->identity.mag_lag_us = joined->config->mag_lag_us;
}

void joined_begin(void *state) {
    struct joined *joined = state;
    const IN_FLASH struct joined_config *config = joined->config;
    joined->phase = SET_UP_INERTIAL;
    joined->tries = 0;
    joined->mag_age = 0;
    joined->has_mag = false;
    begin_part(&joined->inertial, config->inertial->chip);
    begin_part(&joined->magnetic, config->magnetic->chip);
    identify(joined);
}

#ifndef PART_WITHOUT_SELF_TEST
// Where the chip that has answered is that of the other module, goes on with that one.
static bool takes_other(struct joined *joined) {
    const IN_FLASH struct joined_config *other = joined->config->or_else;
    if (other == 0 ||
        part_kind(other->inertial->chip, joined->inertial.who_am_i) == 0) {
        return false;
    }
    joined->config = other;
    joined_begin(joined);
    return true;
}
#endif

static enum sensor_result set_up_inertial(struct joined *joined,
                                          const IN_FLASH struct bus_device *bus,
                                          uint32_t now_us) {
    struct part *part = &joined->inertial;
    const enum sensor_result result = part_setup(part, bus, now_us);
    identify(joined);
#ifndef PART_WITHOUT_SELF_TEST
    if (result == SENSOR_WRONG_CHIP && takes_other(joined)) {
        return SENSOR_BUSY;
    }
#endif
    if (result != SENSOR_OK) {
        return result;
    }
    joined->bursts[0] = joined->config->inertial->burst;
    joined->bursts[0].address = part->address;
#ifndef ACQUISITION_WIRED_ONLY
    joined->ready = joined->config->inertial->ready;
    joined->ready.address = part->address;
#endif
    joined->phase = SET_UP_MAGNETIC;
    return SENSOR_BUSY;
}

static void end_magnetic(struct joined *joined, bool has_mag) {
    const struct part *part = &joined->magnetic;
    joined->has_mag = has_mag;
    joined->bursts[1] = joined->config->magnetic->burst;
    joined->bursts[1].address = part->address;
    joined->identity.self_test = joined->inertial.verdicts;
    if (has_mag) {
        joined->identity.who_am_i[1] = part->who_am_i;
        joined->identity.self_test |= part->verdicts;
    } else {
        joined->bursts[1].length = 0;
        if (part->is_found) {  // and tried three times
            joined->mag_failures = mag_failed_again(joined->mag_failures | 3);
        }
        if (joined->mag_failures > 0) {
            joined->identity.self_test |= SELF_TEST_MAG_FAILED;
        }
    }
    joined->phase = CLEAR;
}

// A missing chip is no failure, and a failure here is tried again. A line that is held
// is for the board to free.
static enum sensor_result set_up_magnetic(struct joined *joined,
                                          const IN_FLASH struct bus_device *bus,
                                          uint32_t now_us) {
    struct part *part = &joined->magnetic;
    if (mag_is_left_out(joined->mag_failures)) {
        end_magnetic(joined, false);
        return SENSOR_BUSY;
    }
    const enum sensor_result result = part_setup(part, bus, now_us);
    if (result == SENSOR_BUS_TIMEOUT || result == SENSOR_BUS_STUCK) {
        joined->mag_failures = mag_failed_again(joined->mag_failures);
        return result;
    }
    if (result == SENSOR_OK) {
        end_magnetic(joined, true);
    } else if (result != SENSOR_BUSY) {
        ++joined->tries;
        if (joined->tries == MAG_TRIES) {
            end_magnetic(joined, false);
        } else {
            part_begin(part);
        }
    }
    return SENSOR_BUSY;
}

static enum sensor_result clear(struct joined *joined,
                                const IN_FLASH struct bus_device *bus) {
    uint8_t unused[BUS_BURST_MAX];
    const struct bus_burst *burst = joined->bursts;
    const enum sensor_result result =
        part_read(&joined->inertial, bus, burst->reg, unused, burst->length);
    if (result == SENSOR_OK) {
        joined->phase = DONE;
    }
    return result;
}

enum sensor_result joined_setup(void *state, const IN_FLASH struct bus_device *bus,
                                uint32_t now_us) {
    struct joined *joined = state;
    switch ((enum phase)joined->phase) {
    case SET_UP_INERTIAL:
        return set_up_inertial(joined, bus, now_us);
    case SET_UP_MAGNETIC:
        return set_up_magnetic(joined, bus, now_us);
    case CLEAR:
        return clear(joined, bus);
    case DONE:
        break;
    }
    return SENSOR_OK;
}

// The byte of an undriven or held bus: no reading.
static bool is_no_reading(const uint8_t *bytes, uint8_t length) {
    for (uint8_t i = 1; i < length; ++i) {
        if (bytes[i] != bytes[0]) {
            return false;
        }
    }
    return bytes[0] == 0x00 || bytes[0] == 0xFF;
}

// Takes three axes, from a chip's to the module's; true where one is beyond its range.
static bool take(const uint8_t *bytes, const IN_FLASH struct joined_axes *from,
                 const IN_FLASH int8_t *axes, struct counts *out) {
    bool is_beyond = false;
    bytes += from->place - 2;
    for (uint8_t i = 0; i < 3; ++i) {
        const int8_t axis = axes[i];
        int32_t value = part_word(bytes + 2 * (axis < 0 ? -axis : axis));
        is_beyond |= fixed_magnitude(value) >= from->beyond;
        if (axis < 0) {
            value = fixed_clamp(-value, INT16_MAX);
        }
        out->axis[i] = (int16_t)value;
    }
    return is_beyond;
}

static void take_field(struct joined *joined, const uint8_t *bytes,
                       struct sample *out) {
    const IN_FLASH struct joined_magnetic *from = joined->config->magnetic;
    if (!joined->has_mag || (bytes[0] & from->fresh) != from->fresh ||
        is_no_reading(bytes, joined->bursts[1].length)) {
        return;
    }
    joined->mag_age = 0;
    joined->mag_failures = 0;
    out->mag_overflow =
        take(bytes, &from->mag, &joined->config->mag_axes[0], &out->mag);
    out->has_mag = !out->mag_overflow;
    if (out->mag_overflow) {
        out->mag = (struct counts){0};
    }
}

bool joined_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                  struct sample *out) {
    struct joined *joined = state;
    const IN_FLASH struct joined_config *config = joined->config;
    const IN_FLASH struct joined_inertial *from = config->inertial;
    const uint8_t length = joined->bursts[0].length;
    if (is_no_reading(bytes, length)) {
        return false;
    }
    out->time_us = time_us;
    out->acc_clipped = take(bytes, &from->acc, &config->inertial_axes[0], &out->acc);
    out->gyr_clipped = take(bytes, &from->gyr, &config->inertial_axes[0], &out->gyr);
    // Needs a factor below 1: within 2^15 of the zero.
    const int32_t warmth = (int32_t)part_word(bytes) * from->temperature_cdeg_q8;
    out->temperature_cdeg =
        (int16_t)(from->temperature_zero_cdeg + fixed_scale_down(warmth, 8));
    out->mag = (struct counts){0};
    out->has_mag = false;
    out->mag_overflow = false;
    take_field(joined, bytes + length, out);
    return true;
}

// Looks for a magnetometer that was absent, at one address after the other.
static enum sensor_result look_for_mag(struct joined *joined,
                                       const IN_FLASH struct bus_device *bus) {
    ++joined->mag_age;
    if (joined->mag_age <= joined->mag_failures) {
        return SENSOR_OK;
    }
    joined->mag_age = 0;
    for (uint8_t place = 0; place < sizeof joined->magnetic.chip->addresses; ++place) {
        const enum sensor_result result = part_ask(&joined->magnetic, bus, place);
        if (result == SENSOR_OK) {
            joined->mag_failures = mag_tried_again(joined->mag_failures);
            return SENSOR_MAG_CHANGED;
        }
        if (result != SENSOR_BUS_NACK && result != SENSOR_WRONG_CHIP) {
            return result;
        }
    }
    return SENSOR_OK;
}

static enum sensor_result verify(struct joined *joined, struct part *part,
                                 const IN_FLASH struct bus_device *bus) {
    const enum sensor_result result = part_verify(part, bus);
    if (result == SENSOR_UNSET) {
        joined->identity.wrong_register = part->wrong_register;
    }
    return result;
}

static enum sensor_result check_magnetic(struct joined *joined,
                                         const IN_FLASH struct bus_device *bus) {
    if (!joined->has_mag) {
        return look_for_mag(joined, bus);
    }
    ++joined->mag_age;
    if (joined->mag_age > MAG_SILENT_LOOKS) {
        joined->mag_failures = mag_failed_again(joined->mag_failures);
        return SENSOR_MAG_CHANGED;
    }
    return verify(joined, &joined->magnetic, bus);
}

// The chips in turn.
enum sensor_result joined_check(void *state, const IN_FLASH struct bus_device *bus) {
    struct joined *joined = state;
    joined->checks_magnetic = !joined->checks_magnetic;
    if (!joined->checks_magnetic) {
        return check_magnetic(joined, bus);
    }
    return verify(joined, &joined->inertial, bus);
}
