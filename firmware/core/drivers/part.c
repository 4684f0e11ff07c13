// SPDX-License-Identifier: MIT
// See part.h.
#include "core/drivers/part.h"

#include <string.h>

#include "core/drivers/ports_of.h"
#include "core/math/fixed.h"

enum {
    TICK_US = 1024,    // a wait of n ticks lasts more than n - 1
    DATA_TICKS = 100,  // of one sample, at 52 Hz or more
    RESET_TICKS = 20,  // ST's drivers poll without a bound; theirs of others wait 20 ms
    FORCE_TRIES = 10,  // a second: a shaken probe passes 1 g by then
    FORCE_SCALE = 3,   // bits: an eighth of the sum of five
};

static bool is_within(const struct part *part, uint16_t now, uint8_t ticks) {
    return (uint16_t)(now - part->since) < ticks;
}

static enum sensor_result next(struct part *part, uint16_t now) {
    ++part->step;
    part->count = 0;
    part->since = now;
    return SENSOR_BUSY;
}

enum sensor_result part_read(const struct part *part,
                             const IN_FLASH struct bus_device *bus, uint8_t reg,
                             uint8_t *data, uint8_t length) {
    if (length > 1) {
        reg |= part->chip->increment;
    }
    return (enum sensor_result)BUS_PORT(bus)->read(BUS_PORT(bus)->port, part->address,
                                                   reg, data, length);
}

const IN_FLASH struct sensor_identity *part_kind(const IN_FLASH struct part_chip *chip,
                                                 uint8_t who) {
    for (uint8_t i = 0; i < chip->kinds_count; ++i) {
        if (chip->kinds[i].who_am_i[0] == who) {
            return &chip->kinds[i];
        }
    }
    return 0;
}

enum sensor_result part_ask(struct part *part, const IN_FLASH struct bus_device *bus,
                            uint8_t place) {
    uint8_t who = PART_WHO_NOBODY;
    part->address = part->chip->addresses[place];
    const enum sensor_result result = part_read(part, bus, PART_WHO_AM_I, &who, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    part->who_am_i = who;
    const IN_FLASH struct sensor_identity *kind = part_kind(part->chip, who);
    if (kind == 0) {
        return SENSOR_WRONG_CHIP;
    }
    part->kind = kind;
    return SENSOR_OK;
}

static enum sensor_result find(struct part *part, const IN_FLASH struct bus_device *bus,
                               uint16_t now) {
    const enum sensor_result result = part_ask(part, bus, part->count);
    if (result == SENSOR_OK) {
        part->is_found = true;
        return next(part, now);
    }
    if (result != SENSOR_BUS_NACK && result != SENSOR_WRONG_CHIP) {
        return result;
    }
    ++part->count;
    if (part->count < sizeof part->chip->addresses) {
        return SENSOR_BUSY;
    }
    return part->who_am_i == PART_WHO_NOBODY ? SENSOR_BUS_NACK : SENSOR_WRONG_CHIP;
}

static enum sensor_result await_reset(struct part *part,
                                      const IN_FLASH struct bus_device *bus,
                                      uint16_t now, uint8_t mask) {
    uint8_t value;
    const enum sensor_result result =
        part_read(part, bus, part->chip->reset, &value, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if ((value & mask) == 0) {
        return next(part, now);
    }
    return is_within(part, now, RESET_TICKS) ? SENSOR_BUSY : SENSOR_STUCK;
}

#ifndef PART_WITHOUT_SELF_TEST
// Adds a reading to a run of PART_TEST_SAMPLES, which 2^18 bounds. The second run has
// the first one taken off.
static void add(struct part *part, uint8_t axis, int16_t value, bool is_stimulated,
                uint16_t moving) {
    struct part_sum *run = &part->sums[axis];
    if (part->count == 1) {
        run->sum = is_stimulated ? -run->sum : 0;
        run->first = value;
    }
    run->sum += value;
    if (fixed_magnitude((int32_t)value - run->first) > moving) {
        part->is_moving = true;
    }
}

// As ST's examples: the first reading is thrown away.
static enum sensor_result sample(struct part *part,
                                 const IN_FLASH struct bus_device *bus, uint16_t now,
                                 uint8_t number, bool is_stimulated) {
    const IN_FLASH struct part_axes *axes = &part->chip->axes[number];
    uint8_t bytes[6];
    enum sensor_result result = part_read(part, bus, part->chip->status, bytes, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    if ((bytes[0] & axes->ready) != axes->ready) {
        return is_within(part, now, DATA_TICKS) ? SENSOR_BUSY : SENSOR_STUCK;
    }
    result = part_read(part, bus, axes->reg, bytes, sizeof bytes);
    if (result != SENSOR_OK) {
        return result;
    }
    if (part->count == 0 && !is_stimulated) {
        part->is_moving = false;
    }
    for (uint8_t axis = 0; part->count > 0 && axis < 3; ++axis) {
        add(part, axis, part_word(bytes + 2 * axis), is_stimulated, axes->moving);
    }
    part->since = now;
    ++part->count;
    return part->count <= PART_TEST_SAMPLES ? SENSOR_BUSY : next(part, now);
}

// Between 0.75 and 1.25 g: else it was shaken, or its counts are not what they are
// taken for.
static enum sensor_result force(struct part *part, uint16_t now) {
    // Five readings, over eight: within 2^15.
    const uint32_t gravity = (uint32_t)fixed_scale_down(
        (int32_t)part->chip->gravity_counts * PART_TEST_SAMPLES, FORCE_SCALE);
    const uint32_t square = fixed_high_half(gravity * gravity);
    uint32_t found = 0;  // 2^16ths, as `square`
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t size = fixed_scale_down(part->sums[axis].sum, FORCE_SCALE);
        found += fixed_high_half((uint32_t)(size * size));
    }
    if (16 * found > 9 * square && 16 * found < 25 * square) {
        part->tries = 0;
        return next(part, now);
    }
    ++part->tries;
    (void)next(part, now);
    part->step = (uint8_t)(part->step - 2);
    return part->tries < FORCE_TRIES ? SENSOR_BUSY : SENSOR_NO_FORCE;
}

// Whether all axes have a verdict.
static bool is_tested(const struct part *part) {
    for (uint8_t i = 0; i < part->chip->axes_count; ++i) {
        if ((part->verdicts & (part->chip->axes[i].flag * 17)) == 0) {
            return false;
        }
    }
    return true;
}

// A failure while moving is no verdict.
static enum sensor_result judge(struct part *part, uint16_t now, uint8_t number) {
    const IN_FLASH struct part_axes *axes = &part->chip->axes[number];
    uint8_t verdict = axes->flag;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const uint32_t size = fixed_magnitude(part->sums[axis].sum);
        if (size < (uint32_t)axes->least[axis] * PART_TEST_SAMPLES ||
            size > (uint32_t)axes->most[axis] * PART_TEST_SAMPLES) {
            verdict = part->is_moving ? 0 : (uint8_t)(axes->flag * 16);
        }
    }
    part->verdicts &= (uint8_t) ~(axes->flag * 17);
    part->verdicts |= verdict;
    return next(part, now);
}

static enum sensor_result verify_apart(struct part *part,
                                       const IN_FLASH struct bus_device *bus) {
    const IN_FLASH struct part_row *kept = &part->chip->kept_apart;
    uint8_t found = 0;
    const enum sensor_result result = part_read(part, bus, kept->what, &found, 1);
    if (result == SENSOR_OK && found != kept->value) {
        part->wrong_register = kept->what;
        return SENSOR_UNSET;
    }
    return result;
}
#endif

static enum sensor_result write(const struct part *part,
                                const IN_FLASH struct bus_device *bus, uint8_t reg,
                                uint8_t value) {
    return (enum sensor_result)BUS_PORT(bus)->write(BUS_PORT(bus)->port, part->address,
                                                    reg, &value, 1);
}

// A register of those that are kept.
static enum sensor_result
configure(struct part *part, const IN_FLASH struct bus_device *bus, uint16_t now) {
    const IN_FLASH struct part_chip *chip = part->chip;
    const uint8_t reg = (uint8_t)(chip->kept + part->count);
    if (reg != PART_WHO_AM_I) {
        const enum sensor_result result =
            write(part, bus, reg, chip->kept_values[part->count]);
        if (result != SENSOR_OK) {
            return result;
        }
    }
    ++part->count;
    return part->count < chip->kept_count ? SENSOR_BUSY : next(part, now);
}

enum sensor_result part_verify(struct part *part,
                               const IN_FLASH struct bus_device *bus) {
    const IN_FLASH struct part_chip *chip = part->chip;
#ifndef PART_WITHOUT_SELF_TEST
    part->is_apart_next = chip->kept_apart.what != 0 && !part->is_apart_next;
    if (chip->kept_apart.what != 0 && !part->is_apart_next) {
        return verify_apart(part, bus);
    }
#endif
    uint8_t found[PART_KEPT_MAX];
    const enum sensor_result result =
        part_read(part, bus, chip->kept, found, chip->kept_count);
    for (uint8_t i = 0; result == SENSOR_OK && i < chip->kept_count; ++i) {
        const uint8_t reg = (uint8_t)(chip->kept + i);
        const uint8_t wanted =
            reg == PART_WHO_AM_I ? part->who_am_i : chip->kept_values[i];
        if (found[i] != wanted) {
            part->wrong_register = reg;
            return SENSOR_UNSET;
        }
    }
    return result;
}

static enum sensor_result await_data(struct part *part,
                                     const IN_FLASH struct bus_device *bus,
                                     uint16_t now, uint8_t ticks) {
    uint8_t status;
    const enum sensor_result result =
        part_read(part, bus, part->chip->status, &status, 1);
    if (result != SENSOR_OK) {
        return result;
    }
    for (uint8_t i = 0; i < part->chip->axes_count; ++i) {
        const uint8_t ready = part->chip->axes[i].ready;
        if ((status & ready) != ready) {
            return is_within(part, now, ticks) ? SENSOR_BUSY : SENSOR_STUCK;
        }
    }
    return next(part, now);
}

void part_begin(struct part *part) {
    const struct part before = *part;
    memset(part, 0, sizeof *part);
    part->chip = before.chip;
    part->kind = part->chip->kinds;
    part->verdicts = before.verdicts;
}

static enum sensor_result do_row(struct part *part,
                                 const IN_FLASH struct bus_device *bus, uint16_t now,
                                 uint8_t what, uint8_t value) {
    switch (what) {
    case PART_WAIT:
        part->wait = value;
        return next(part, now);
    case PART_FIND:
        return find(part, bus, now);
    case PART_AWAIT_RESET:
        return await_reset(part, bus, now, value);
#ifndef PART_WITHOUT_SELF_TEST
    case PART_SKIP_IF_TESTED:
        if (is_tested(part)) {
            part->step = (uint8_t)(part->step + value);
        }
        return next(part, now);
    case PART_SAMPLE_PLAIN:
    case PART_SAMPLE_STIMULATED:
        return sample(part, bus, now, value, what == PART_SAMPLE_STIMULATED);
    case PART_FORCE:
        return force(part, now);
    case PART_JUDGE:
        return judge(part, now, value);
#endif
    case PART_CONFIGURE:
        return configure(part, bus, now);
    case PART_VERIFY: {
        const enum sensor_result result = part_verify(part, bus);
        return result == SENSOR_OK ? next(part, now) : result;
    }
    case PART_AWAIT_DATA:
        return await_data(part, bus, now, value);
    case PART_DONE:
        return SENSOR_OK;
    default: {
        const enum sensor_result result = write(part, bus, what, value);
        return result == SENSOR_OK ? next(part, now) : result;
    }
    }
}

enum sensor_result part_setup(struct part *part, const IN_FLASH struct bus_device *bus,
                              uint32_t now_us) {
    // Ticks wrap after 67 s, at the wrap of now_us too: waits are far shorter.
    const uint16_t now = (uint16_t)(now_us / TICK_US);
    if (is_within(part, now, part->wait)) {
        return SENSOR_BUSY;
    }
    part->wait = 0;
    const IN_FLASH struct part_row *row = &part->chip->rows[part->step];
    return do_row(part, bus, now, row->what, row->value);
}
