// SPDX-License-Identifier: MIT
// See lis3mdl.h.
//
// Documents: DS = LIS3MDL data sheet, DocID024204 rev 4, as Zephyr's emulator of the
// chip and others cite it; REG = ST's lis3mdl_reg.h; EX = ST's example
// lis3mdl_self_test.c; AP = ArduPilot's AP_Compass_LIS3MDL.cpp.
#include "core/drivers/lis3mdl.h"

enum {
    // REG.
    REG_CTRL1 = 0x20,
    REG_CTRL2 = 0x21,
    REG_CTRL3 = 0x22,
    REG_CTRL5 = 0x24,
    REG_STATUS = 0x27,
    REG_OUT_X_L = 0x28,

    ADDRESS = 0x1C,  // pin SA1 low
    ADDRESS_HIGH = 0x1E,
    WHO_LIS3MDL = 0x3D,
    AUTO_INCREMENT = 0x80,  // DS 5.1.1: of the sub-address

    // AP and PX4 run with it: an early document states that it compensates.
    TEMP_EN = 0x80,        // CTRL1
    XY_ULTRA_HIGH = 0x60,  // CTRL1: OM
    XY_LOW_POWER = 0x00,
    RATE_80_HZ = 0x1C,     // CTRL1: DO
    SELF_TEST = 0x01,      // CTRL1
    RANGE_4_GAUSS = 0x00,  // CTRL2: FS
    RANGE_12_GAUSS = 0x40,
    SOFT_RST = 0x04,         // CTRL2
    MODE_CONTINUOUS = 0x00,  // CTRL3
    MODE_POWER_DOWN = 0x03,
    Z_ULTRA_HIGH = 0x0C,  // CTRL4: OMZ
    BDU = 0x40,           // CTRL5
    ZYXDA = 0x08,         // STATUS: all axes are new

    FIELD_PLACE = REG_OUT_X_L - REG_STATUS,  // among the bytes of the burst
    BURST_BYTES = FIELD_PLACE + 6,
    COUNTS_MAX = INT32_C(4) * 6842,  // DS table 3: 4 gauss
};

// CTRL1 to CTRL5; as AP.
static const IN_FLASH uint8_t kept_values[] = {
    TEMP_EN | XY_ULTRA_HIGH | RATE_80_HZ,
    RANGE_4_GAUSS,
    MODE_CONTINUOUS,
    Z_ULTRA_HIGH,
    BDU,
};
_Static_assert(sizeof kept_values <= PART_KEPT_MAX, "part_verify() has room");

#ifdef PART_WITHOUT_SELF_TEST
static const IN_FLASH struct part_axes axes[] = {{ZYXDA}};
#else
// Answers, EX: 1 to 3 gauss, z 0.1 to 1, at 12 gauss. A field that changes by 0.1 gauss
// is one that the probe turns in.
static const IN_FLASH struct part_axes axes[] = {
    {.ready = ZYXDA,
     .reg = REG_OUT_X_L,
     .flag = SELF_TEST_MAG_PASSED,
     .moving = 228,
     .least = {2281, 2281, 228},
     .most = {3 * 2281, 3 * 2281, 2281}},
};
#endif

static const IN_FLASH struct part_row rows[] = {
    {PART_FIND, 0},
    {REG_CTRL2, SOFT_RST},
    {PART_AWAIT_RESET, SOFT_RST},
#ifndef PART_WITHOUT_SELF_TEST
    // EX, with its rate, range and waits.
    {PART_SKIP_IF_TESTED, 12},
    {REG_CTRL5, BDU},
    {REG_CTRL2, RANGE_12_GAUSS},
    {REG_CTRL1, XY_LOW_POWER | RATE_80_HZ},
    {PART_WAIT, 21},
    {REG_CTRL3, MODE_CONTINUOUS},
    {PART_WAIT, 21},
    {PART_SAMPLE_PLAIN, 0},
    {REG_CTRL1, XY_LOW_POWER | RATE_80_HZ | SELF_TEST},
    {PART_WAIT, 60},
    {PART_SAMPLE_STIMULATED, 0},
    {PART_JUDGE, 0},
    {REG_CTRL3, MODE_POWER_DOWN},
#endif
    {PART_CONFIGURE, 0},
    {PART_WAIT, 40},  // three measurements
    {PART_VERIFY, 0},
    {PART_AWAIT_DATA, 40},
    {PART_DONE, 0},
};

static const IN_FLASH struct sensor_identity kinds[] = {{.who_am_i = {WHO_LIS3MDL}}};

static const IN_FLASH struct part_chip chip = {
    .addresses = {ADDRESS, ADDRESS_HIGH},
    .kinds = kinds,
    .kinds_count = sizeof kinds / sizeof kinds[0],
    .increment = AUTO_INCREMENT,
    .status = REG_STATUS,
    .reset = REG_CTRL2,
    .kept = REG_CTRL1,
    .kept_count = sizeof kept_values,
    .kept_values = kept_values,
    .axes = axes,
    .axes_count = sizeof axes / sizeof axes[0],
    .rows = rows,
};

const IN_FLASH struct joined_magnetic lis3mdl = {
    .chip = &chip,
    .mag_lsb_pt = ROUNDED(1e8 / 6842),  // DS table 3; a gauss is 1e8 pT
    .burst = {0, REG_STATUS | AUTO_INCREMENT, BURST_BYTES},
    .fresh = ZYXDA,
    .mag = {FIELD_PLACE, COUNTS_MAX + 1},
};
