// SPDX-License-Identifier: MIT
// The registers of both families. Of the LSM6DSOX's see ../lsm6dsox.h for the documents
// that DS, SO, AD, LX and QC stand for.
//
// Of the LSM6DSV16X's only ST's published drivers were at hand. None of its numbers is
// from lsm6dsv16x_reg.h, from which those in firmware/ are: V32 = ST's
// lsm6dsv32x_reg.h, whose registers are the same but for the accelerometer's ranges;
// LV = ST's driver st_lsm6dsvx for Linux; ZE = Zephyr's
// dt-bindings/sensor/lsm6dsv16x.h; SL = SlimeVR-Tracker-nRF, LSM6DSV.h and .c; BF =
// Betaflight, pull request 13046. Open points, and the model's choice:
// - Low-passes are the LSM6DSOX's, in proportion to the rate, with its samples to
//   discard, its times of boot, reset and turn-on, and I3C alone after a reset with
//   INT1 high. Of the gyroscope's low-pass ST tells the delay at 7.68 kHz only.
// - In high accuracy the clock has the same error; the set of rates counts when the
//   first sensor turns on. Reported are two sensors in different modes, and a range or
//   a set of rates that is changed while a sensor runs.
#include <math.h>

#include "family.h"

// DS 9; those that any firmware here uses, and their neighbours.
static const struct st_rule sox_rules[] = {
    {REG_COUNTER_BDR_REG1, 0x18, 0x67},
    {REG_INT1_CTRL, 0x00, 0xFC},
    {REG_INT2_CTRL, 0x80, 0x7F},
    {REG_CTRL1, 0x01, 0x02},
    {REG_CTRL2, 0x01, 0x00},
    {REG_CTRL3, 0x02, 0xA8},  // BOOT, H_LACTIVE, SPI
    {REG_CTRL4, 0x91, 0x6E},
    {REG_CTRL5, 0x00, 0xF0},   // ultra-low power, circular bursts
    {REG_CTRL6, 0x00, 0xF8},   // DEN, low power, offsets
    {REG_CTRL7, 0x08, 0xC7},   // low power, high-pass, OIS, offsets
    {REG_CTRL8, 0x00, 0x1E},   // high-pass, fast settling, the other ranges
    {REG_CTRL9, 0x01, 0x1C},   // DEN
    {REG_CTRL10, 0xDF, 0x20},  // timestamps
};

static const struct lsm6_family sox = {
    .rules = sox_rules,
    .rules_count = sizeof sox_rules / sizeof sox_rules[0],
    .rate = {{REG_CTRL2, 4, 15}, {REG_CTRL1, 4, 15}},  // DS tables 48, 44
    .range = {{REG_CTRL2, 1, 7}, {REG_CTRL1, 2, 3}},   // FS_G with FS_125; FS_XL
    .test = {{REG_CTRL5, 2, 3}, {REG_CTRL5, 0, 3}},
    .pulsed = {REG_COUNTER_BDR_REG1, 7, 1},
    .pulse_ns = 75 * US,  // DS table 34
    // DS table 18: 6667 Hz and its halves, which AN5192 (memory) and QC (odr_coeff)
    // divide from it: 12.5 Hz is 6667 / 512.
    .clock_hz = {LSM6DSOX_HZ},
    .first_rate = 1,
    // SO and DS: 250, 500, 1000, 2000, and with FS_125 125 deg/s. AD: the code's order
    // is 2, 16, 4, 8 g, as DS table 45 has 4, 32, 8, 16 g.
    .per_count = {{8.75, 4.375, 17.5, 4.375, 35.0, 4.375, 70.0, 4.375},
                  {0.061, 0.488, 0.122, 0.244}},
    // SO table 2: 20 to 80 deg/s at 250, 150 to 700 at 2000.
    .gyr_response = {0.125, 0.125, 0.25, 0.125, 0.5, 0.125, 1.0, 0.125},
    .sign = {{0, 1, NAN, -1}, {0, 1, -1, NAN}},  // DS tables 55, 56
    .fine = 0x63,                                // INTERNAL_FREQ_FINE
    .fine_ppm = 1500.0,                          // DS table 141: steps of 0.15 %
    .pin_ctrl = 0x3F,                            // DS table 20
    .ctrl9 = 0xE0,
};

// V32: those that any firmware here uses, and their neighbours.
static const struct st_rule dsv_rules[] = {
    {REG_COUNTER_BDR_REG1, 0x9C, 0x63},
    {REG_INT1_CTRL, 0x84, 0x78},
    {REG_INT2_CTRL, 0x00, 0xFF},
    {REG_CTRL1, 0x80, 0x60},  // low power, triggered
    {REG_CTRL2, 0x80, 0x60},
    {REG_CTRL3, 0x3A, 0x80},  // BOOT
    {REG_CTRL4, 0xE0, 0x1D},
    {REG_CTRL5, 0xF8, 0x07},  // I3C
    {REG_CTRL6, 0x80, 0x70},
    {REG_CTRL7, 0x0E, 0xF1},  // LPF1, Qvar
    {REG_CTRL8, 0x14, 0xE8},  // the second channel, filters
    {REG_CTRL9, 0x84, 0x7B},  // offsets, filters
    {REG_CTRL10, 0xB0, 0x40},
    {0x62, 0xFC, 0x00},  // HAODR_CFG
};

static const struct lsm6_family dsv = {
    .rules = dsv_rules,
    .rules_count = sizeof dsv_rules / sizeof dsv_rules[0],
    .rate = {{REG_CTRL2, 0, 15}, {REG_CTRL1, 0, 15}},  // SL
    .mode = {{REG_CTRL2, 4, 7}, {REG_CTRL1, 4, 7}},    // SL; 1 is high accuracy
    .range = {{REG_CTRL6, 0, 15}, {REG_CTRL8, 0, 3}},  // V32
    .test = {{REG_CTRL10, 2, 3}, {REG_CTRL10, 0, 3}},
    .pulsed = {REG_CTRL4, 1, 1},
    .rates = {0x62, 0, 3},
    .pulse_ns = 66 * US,                           // BF
    .clock_hz = {7680.0, 8000.0, 6400.0, 7680.0},  // ZE: the fastest rate of each set
    .first_rate = 3,  // ZE: 15 Hz; those below are of low power
    // LV: gains; SL: codes. 125 to 2000, and by code 12 4000 deg/s; 2 to 16 g.
    .per_count = {{4.375, 8.75, 17.5, 35.0, 70.0, [12] = 140.0},
                  {0.061, 0.122, 0.244, 0.488}},
    .gyr_response = {1.0, 1.0, 1.0, 1.0, 1.0, [12] = 1.0},
    .sign = {{0, 1, -1, NAN}, {0, 1, -1, NAN}},  // V32: gy_self_test_t, xl_self_test_t
    .stays_in_operation = true,
    .fine = 0x4F,        // SL
    .fine_ppm = 1300.0,  // SL
};

struct lsm6dsox_chip_config lsm6dsox_chip_defaults(void) {
    return (struct lsm6dsox_chip_config){
        // AN5192, memory: boot; AN 4.1 has 15 ms.
        .sensor = {.temperature_c = 25.0, .startup_ns = 10 * MS},
        .family = &sox,
        .reset_ns = 50 * US,        // AN5192, memory; LX waits 50 ms
        .gyr_turn_on_ns = 70 * MS,  // AN table 14, the maximum; DS table 4 has 35
        .who_am_i = 0x6C,           // DS table 41; AD: LSM6DSOX_CHIP_ID
        .gyr_self_test_dps = {400.0, 400.0, 400.0},
        .acc_self_test_mg = {420.0, 390.0, 510.0},  // SO: 50 to 1700
    };
}

struct lsm6dsox_chip_config lsm6dsv16x_chip_defaults(void) {
    struct lsm6dsox_chip_config config = lsm6dsox_chip_defaults();
    config.family = &dsv;
    config.who_am_i = 0x70;  // LV
    return config;
}
