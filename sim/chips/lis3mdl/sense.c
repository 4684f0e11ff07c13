// SPDX-License-Identifier: MIT
// The sample clock, and the counts that field, self-test, offset registers and
// temperature make.
#include "chip.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>

#define UT_PER_GAUSS 100.0

// DS table 20: with FAST_ODR, by OM: low power to ultra-high performance. A measurement
// takes as long.
static const double fast_hz[4] = {1000.0, 560.0, 300.0, 155.0};

static int mode_of(const struct lis3mdl_chip *chip) {
    const bool is_low = (chip->reg[REG_CTRL3] & LP) != 0;
    return is_low ? 0 : (chip->reg[REG_CTRL1] >> OM_SHIFT) & OM_MASK;
}

// Samples a second by its own clock.
static double rate_hz(const struct lis3mdl_chip *chip) {
    const uint8_t ctrl1 = chip->reg[REG_CTRL1];
    if (chip->reg[REG_CTRL3] & LP) {
        return 0.625;  // DS CTRL_REG3: LP, memory
    }
    if (ctrl1 & FAST_ODR) {
        return fast_hz[mode_of(chip)];
    }
    return ldexp(0.625, (ctrl1 >> DO_SHIFT) & DO_MASK);  // AD: 0.625 Hz at 0 to 80 at 7
}

static double clock_factor(const struct lis3mdl_chip *chip) {
    return 1.0 + chip->config.rate_error_ppm * 1e-6;
}

static double period_ns(const struct lis3mdl_chip *chip) {
    return 1e9 / (rate_hz(chip) * clock_factor(chip));
}

static bool is_on(const struct lis3mdl_chip *chip) {
    return (chip->reg[REG_CTRL3] & MD_MASK) <= MD_SINGLE && chip->wait_end == NEVER;
}

static void set_next_tick(struct lis3mdl_chip *chip) {
    const double at = (double)chip->tick * period_ns(chip);
    chip->tick_ns = is_on(chip) ? chip->epoch_ns + (uint64_t)llround(at) : NEVER;
}

void lis3mdl_chip_restart_clock(struct lis3mdl_chip *chip) {
    static const double turn_on_us[4] = {1200.0, 1910.0, 3480.0, 6650.0};  // AN table 8
    const double turn_on_ns = 1e3 * turn_on_us[mode_of(chip)] / clock_factor(chip);
    const double period = period_ns(chip);
    const bool is_single = (chip->reg[REG_CTRL3] & MD_MASK) == MD_SINGLE;
    chip->epoch_ns = chip->wire.now_ns;
    chip->tick = 1;
    set_next_tick(chip);
    if (chip->tick_ns != NEVER && (is_single || turn_on_ns > period)) {
        chip->tick_ns = chip->wire.now_ns + (uint64_t)llround(turn_on_ns);
        // Then period after period.
        if (turn_on_ns > period) {
            chip->epoch_ns += (uint64_t)llround(turn_on_ns - period);
        }
    }
}

static int16_t word_at(const uint8_t *at) {
    return (int16_t)(uint16_t)(at[0] | (at[1] << 8));
}

static void measure_field(struct lis3mdl_chip *chip) {
    // DS table 3.
    static const double counts_per_gauss[4] = {6842.0, 3421.0, 2281.0, 1711.0};
    const uint8_t *reg = chip->reg;
    const double scale =
        counts_per_gauss[(reg[REG_CTRL2] >> FS_SHIFT) & FS_MASK] / UT_PER_GAUSS;
    const double takes_ns = 1e9 / (fast_hz[mode_of(chip)] * clock_factor(chip));
    const int64_t now = (int64_t)chip->wire.now_ns;
    double field_ut[AXES];
    chip_motion_mean(&chip->motion, CHIP_MAG, now - (int64_t)llround(takes_ns), now,
                     field_ut);
    for (int axis = 0; axis < AXES; axis++) {
        const int8_t from = chip->config.axes[axis];
        const double along_ut = field_ut[abs(from) - 1];
        double own_ut = from > 0 ? along_ut : -along_ut;
        if (reg[REG_CTRL1] & ST) {
            own_ut += chip->config.self_test_ut[axis];
        }
        // AN: the output is the measured value less the offset.
        const int16_t offset = word_at(&reg[REG_OFFSET_X_L + 2 * axis]);
        chip->latest[axis] = chip_motion_to_counts(own_ut * scale - offset, INT16_MAX);
    }
}

// AN 6: 8 LSB/degC, 0 at 25 degC.
static void measure_temperature(struct lis3mdl_chip *chip) {
    const double warm_c =
        chip->config.temperature_c + chip->config.temperature_error_c - 25.0;
    lis3mdl_chip_put(chip, REG_TEMP_OUT_L,
                     chip_motion_to_counts(warm_c * 8.0, INT16_MAX));
}

bool lis3mdl_chip_measure(struct lis3mdl_chip *chip) {
    chip->tick++;
    set_next_tick(chip);
    if ((chip->reg[REG_CTRL3] & MD_MASK) == MD_SINGLE) {
        chip->reg[REG_CTRL3] |= MD_POWER_DOWN;
        chip->tick_ns = NEVER;
    }
    if (i2c_slave_find_fault(&chip->wire, CHIP_FAULT_NO_DATA_READY, DIE) != NULL) {
        return false;
    }
    chip->samples++;
    if (i2c_slave_find_fault(&chip->wire, CHIP_FAULT_FROZEN, DIE) == NULL) {
        measure_field(chip);
        if (chip->reg[REG_CTRL1] & TEMP_EN) {
            measure_temperature(chip);
        }
    }
    return true;
}
