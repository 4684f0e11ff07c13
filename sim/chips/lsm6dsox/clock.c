// SPDX-License-Identifier: MIT
// The clock that both sensors and the thermometer divide, and when each takes samples.
#include "chip.h"

#include <math.h>

// DS table 18: 6667 Hz and its halves, which AN5192 (memory) and QC (odr_coeff) divide
// from it: 12.5 Hz is 6667 / 512.
#define CLOCK_HZ 6667.0

enum {
    DIVIDER_12_5_HZ = 512,
    DIVIDER_1_6_HZ = 4096,  // DS table 44
    DIVIDER_52_HZ = 128,    // DS table 5: the thermometer's
};

static double tick_ns(const struct lsm6dsox_chip *chip) {
    const double warm_c = chip->base.config.temperature_c - 25.0;
    const double error_ppm =
        chip->config.rate_error_ppm + chip->config.rate_ppm_per_c * warm_c;
    return 1e9 / (CLOCK_HZ * (1.0 + error_ppm * 1e-6));
}

static double ticks_now(const struct lsm6dsox_chip *chip) {
    const double since_ns = (double)(chip->base.wire.now_ns - chip->anchor_ns);
    return chip->anchor_tick + since_ns / tick_ns(chip);
}

void lsm6dsox_chip_anchor(struct lsm6dsox_chip *chip) {
    chip->anchor_tick = ticks_now(chip);
    chip->anchor_ns = chip->base.wire.now_ns;
}

double lsm6dsox_chip_period_ns(const struct lsm6dsox_chip *chip, enum source source) {
    return chip->sensors[source].divider * tick_ns(chip);
}

void lsm6dsox_chip_set_next_tick(struct lsm6dsox_chip *chip, enum source source) {
    struct sensor *sensor = &chip->sensors[source];
    if (sensor->divider == 0) {
        sensor->tick_ns = NEVER;
        return;
    }
    const double ahead = (double)sensor->tick - chip->anchor_tick;
    sensor->tick_ns = chip->anchor_ns + (uint64_t)llround(ahead * tick_ns(chip));
}

static uint32_t divider_of(uint8_t code) {
    return code == ODR_OFF || code > ODR_LAST ? 0U
                                              : (uint32_t)DIVIDER_12_5_HZ >> (code - 1);
}

static uint32_t wanted(const struct lsm6dsox_chip *chip, enum source source) {
    const uint8_t *reg = chip->die.reg;
    const uint8_t acc = reg[REG_CTRL1_XL] >> ODR_SHIFT;
    const uint8_t gyr = reg[REG_CTRL2_G] >> ODR_SHIFT;
    const bool is_slow = (reg[REG_CTRL6_C] & XL_HM_MODE) != 0;
    if (chip->reset_end != NEVER || chip->die.wait_end != NEVER) {
        return 0;
    }
    switch (source) {
    case GYR:
        // AN 3.5: sleep whatever the rate.
        return (reg[REG_CTRL4_C] & SLEEP_G) ? 0 : divider_of(gyr);
    case ACC:
        if (acc == ODR_1_6_HZ) {  // DS table 44
            return is_slow ? DIVIDER_1_6_HZ : DIVIDER_12_5_HZ;
        }
        return divider_of(acc);
    default: {
        const uint32_t own = chip->sensors[ACC].divider;
        // DS table 5, note 2: in low power with the gyroscope off, the accelerometer's.
        if (chip->sensors[GYR].divider == 0 && own > DIVIDER_52_HZ && is_slow) {
            return own;
        }
        return own != 0 || chip->sensors[GYR].divider != 0 ? DIVIDER_52_HZ : 0;
    }
    }
}

// AN tables 13, 15, 16. Those of FTYPE 4 to 7 are in no document at hand: as long as
// 0.8 / bandwidth, in which a filter of second order comes within 1 %.
static uint32_t to_discard(const struct lsm6dsox_chip *chip, enum source source) {
    static const uint16_t gyr[ODR_LAST] = {2, 3, 3, 3, 3, 3, 3, 135, 270, 540};
    static const uint16_t gyr_lpf1[ODR_LAST] = {2, 3, 3, 4, 5, 6, 9, 135, 270, 540};
    static const uint16_t gyr_narrow[4] = {100, 50, 25, 12};  // Hz, FTYPE 4 to 7
    static const uint8_t acc[ODR_LAST] = {0, 0, 1, 1, 1, 1, 1, 2, 3, 13};
    static const uint8_t acc_lpf2[ODR_LAST] = {1, 1, 1, 2, 2, 2, 2, 2, 4, 13};
    const uint8_t *reg = chip->die.reg;
    const uint8_t code = reg[source == GYR ? REG_CTRL2_G : REG_CTRL1_XL] >> ODR_SHIFT;
    if (code == ODR_OFF || code > ODR_LAST) {
        return 1;
    }
    if (source == GYR) {
        const uint8_t type = reg[REG_CTRL6_C] & FTYPE;
        if (!(reg[REG_CTRL4_C] & LPF1_SEL_G) || (reg[REG_CTRL7_G] & G_HM_MODE)) {
            return gyr[code - 1];
        }
        const double hz = CLOCK_HZ / chip->sensors[GYR].divider;
        const uint32_t known = gyr_lpf1[code - 1];
        const uint32_t narrow =
            type < 4 ? 0 : (uint32_t)ceil(0.8 * hz / gyr_narrow[type - 4]);
        return narrow > known ? narrow : known;
    }
    const bool has_lpf2 = (reg[REG_CTRL1_XL] & LPF2_XL_EN) != 0;
    if ((reg[REG_CTRL6_C] & XL_HM_MODE) && code <= ODR_208_HZ) {
        return has_lpf2 ? 1 : 0;
    }
    return has_lpf2 ? acc_lpf2[code - 1] : acc[code - 1];
}

static void start(struct lsm6dsox_chip *chip, enum source source, uint32_t divider) {
    struct sensor *sensor = &chip->sensors[source];
    bool others_run = false;
    for (int i = 0; i < SOURCES; i++) {
        others_run = others_run || (i != (int)source && chip->sensors[i].divider != 0);
    }
    if (!others_run) {
        chip->anchor_tick = 0.0;
        chip->anchor_ns = chip->base.wire.now_ns;
    }
    sensor->divider = divider;
    // AN 3: both are on one grid. The first sample comes a period or more from now.
    const double periods = ceil(ticks_now(chip) / divider - 1e-6);
    sensor->tick = ((uint64_t)periods + 1) * divider;
    sensor->settling = source == TEMP ? 0 : to_discard(chip, source);
    lsm6dsox_chip_set_next_tick(chip, source);
    const uint64_t on_ns = chip->gyr_on_ns + chip->config.gyr_turn_on_ns;
    if (source == GYR && on_ns > sensor->tick_ns) {
        // AN table 14: the turn-on time, and then the samples to discard.
        const double early_ns = (double)(on_ns - sensor->tick_ns);
        sensor->settling +=
            (uint32_t)ceil(early_ns / lsm6dsox_chip_period_ns(chip, GYR));
    }
}

void lsm6dsox_chip_set_rates(struct lsm6dsox_chip *chip) {
    for (int i = 0; i < SOURCES; i++) {
        const enum source source = (enum source)i;
        const uint32_t divider = wanted(chip, source);
        if (divider != chip->sensors[i].divider) {
            if (divider == 0) {
                chip->sensors[i].divider = 0;
                lsm6dsox_chip_set_next_tick(chip, source);
            } else {
                start(chip, source, divider);
            }
        }
    }
}
