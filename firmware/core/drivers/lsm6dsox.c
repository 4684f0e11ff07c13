// SPDX-License-Identifier: MIT
// See lsm6dsox.h.
//
// Documents: DS = LSM6DSO32 data sheet, DocID032891 rev 1 (the LSM6DSOX and LSM6DSO
// have its registers but for the accelerometer's ranges); REG = ST's lsm6dsox_reg.h and
// ism330dhcx_reg.h; EX = ST's example lsm6dsox_self_test.c. The data sheet of the
// LSM6DSV16X was not at hand: its numbers are from ST's published driver, VH =
// lsm6dsv16x_reg.h and VC = lsm6dsv16x_reg.c, and VX = ST's lsm6dsv16x_self_test.c.
#include "core/drivers/lsm6dsox.h"

enum {
    // DS table 20.
    REG_COUNTER_BDR_REG1 = 0x0B,
    REG_INT1_CTRL = 0x0D,
    REG_CTRL1_XL = 0x10,
    REG_CTRL2_G = 0x11,
    REG_CTRL3_C = 0x12,
    REG_CTRL5_C = 0x14,
    REG_CTRL9_XL = 0x18,
    REG_STATUS = 0x1E,
    REG_OUT_TEMP_L = 0x20,  // then rates and accelerations
    REG_OUTX_L_G = 0x22,
    REG_OUTX_L_A = 0x28,

    ADDRESS = 0x6A,  // pin SA0 low
    ADDRESS_HIGH = 0x6B,

    DATAREADY_PULSED = 0x80,  // DS 9.7: for 75 us
    INT1_DRDY_G = 0x02,       // DS 9.9
    OFF = 0x00,               // DS table 44
    XL_52_HZ = 0x30,          // DS table 44
    XL_208_HZ = 0x50,         // DS table 44: high performance, by XL_HM_MODE 0
    XL_4_G = 0x08,            // REG: 2, 16, 4, 8 g
    XL_16_G = 0x04,
    G_208_HZ = 0x50,    // DS table 48
    G_2000_DPS = 0x0C,  // DS 9.13
    BDU = 0x40,         // DS 9.15
    IF_INC = 0x04,
    SW_RESET = 0x01,
    ST_XL_NEGATIVE = 0x02,  // DS tables 56 and 55
    ST_G_POSITIVE = 0x04,
    // DS 9.20: its reset value, and I3C_disable, which DS recommends.
    CTRL9_XL = 0xE2,
    XLDA = 0x01,  // REG: STATUS_REG
    GDA = 0x02,

    ACC_AXES = 0,
    GYR_AXES = 1,

    GYR_PLACE = REG_OUTX_L_G - REG_OUT_TEMP_L,  // among the bytes of the burst
    ACC_PLACE = REG_OUTX_L_A - REG_OUT_TEMP_L,
    BURST_BYTES = ACC_PLACE + 6,
};

// From INT1_CTRL to CTRL10_C. The accelerometer's low-pass is half its rate (DS table
// 65), the gyroscope's 66.8 Hz: at 208 Hz the choosable one before it changes nothing
// (DS table 60), and stays off.
static const IN_FLASH uint8_t kept_values[] = {
    INT1_DRDY_G,
    0,
    0,  // WHO_AM_I
    XL_208_HZ | XL_16_G,
    G_208_HZ | G_2000_DPS,
    BDU | IF_INC,
    0,
    0,
    0,
    0,
    0,
    CTRL9_XL,
    0,
};
_Static_assert(sizeof kept_values <= PART_KEPT_MAX, "part_verify() has room");

#ifdef PART_WITHOUT_SELF_TEST
static const IN_FLASH struct part_axes axes[] = {{XLDA}, {GDA}};
#else
// Answers, DS table 3: 50 to 1700 mg at 0.122, 150 to 700 deg/s at 0.07. An unmoved one
// stays within 0.1 g and 4 deg/s.
#define EACH(limit)                                                                    \
    { ROUNDED(limit), ROUNDED(limit), ROUNDED(limit) }

static const IN_FLASH struct part_axes axes[] = {
    [ACC_AXES] = {.ready = XLDA,
                  .reg = REG_OUTX_L_A,
                  .flag = SELF_TEST_ACC_PASSED,
                  .moving = ROUNDED(100 / 0.122),
                  .least = EACH(50 / 0.122),
                  .most = EACH(1700 / 0.122)},
    [GYR_AXES] = {.ready = GDA,
                  .reg = REG_OUTX_L_G,
                  .flag = SELF_TEST_GYR_PASSED,
                  .moving = ROUNDED(4 / 0.07),
                  .least = EACH(150 / 0.07),
                  .most = EACH(700 / 0.07)},
};
#endif

static const IN_FLASH struct part_row rows[] = {
    {PART_WAIT, 20},  // EX: 10 ms of boot
    {PART_FIND, 0},
    {REG_INT1_CTRL, 0},  // INT1 high at a start has it know I3C alone (DS table 19)
    {REG_CTRL3_C, IF_INC | SW_RESET},
    {PART_AWAIT_RESET, SW_RESET},
    {REG_CTRL9_XL, CTRL9_XL},
    {REG_CTRL3_C, BDU | IF_INC},
#ifndef PART_WITHOUT_SELF_TEST
    // EX, in its order, with its rates, ranges, signs and waits.
    {PART_SKIP_IF_TESTED, 17},
    {REG_CTRL1_XL, XL_52_HZ | XL_4_G},
    {PART_WAIT, 100},
    {PART_SAMPLE_PLAIN, ACC_AXES},
    {PART_FORCE, 0},
    {REG_CTRL5_C, ST_XL_NEGATIVE},
    {PART_WAIT, 100},
    {PART_SAMPLE_STIMULATED, ACC_AXES},
    {PART_JUDGE, ACC_AXES},
    {REG_CTRL5_C, 0},
    {REG_CTRL1_XL, OFF},
    {REG_CTRL2_G, G_208_HZ | G_2000_DPS},
    {PART_WAIT, 100},
    {PART_SAMPLE_PLAIN, GYR_AXES},
    {REG_CTRL5_C, ST_G_POSITIVE},
    {PART_WAIT, 100},
    {PART_SAMPLE_STIMULATED, GYR_AXES},
    {PART_JUDGE, GYR_AXES},
#endif
    {PART_CONFIGURE, 0},
    {PART_WAIT, 100},
    {PART_VERIFY, 0},
    {PART_AWAIT_DATA, 50},
#ifdef ACQUISITION_WIRED_ONLY
    // An edge a sample whether the one before it was read or not, so that one lost
    // burst can't end the stream; last, as the bits of STATUS may be pulses, too.
    {REG_COUNTER_BDR_REG1, DATAREADY_PULSED},
#endif
    {PART_DONE, 0},
};

// What the settings make of a relative: 16 g, 2000 deg/s. Its place on the wire is the
// first one's, and who_am_i tells them apart.
#define KIND(of, who, hz, delay_us)                                                    \
    {                                                                                  \
        .kind = (of), .who_am_i = {(who)}, .rate_hz = (hz),                            \
        .gyr_delay_us = (delay_us), .acc_lsb_nm_s2 = SENSOR_NANO_G(0.000488),          \
        .gyr_lsb_nrad_s = SENSOR_NANO_RAD(0.07)                                        \
    }

static const IN_FLASH struct sensor_identity kinds[] = {
    // DS table 3. LSM6DSOX and LSM6DSO; and LSM6DSO32, which the force shows.
    KIND(SENSOR_LSM6DSOX, 0x6C, LSM6DSOX_RATE_HZ, LSM6DSOX_GYR_DELAY_US),
    // ISM330DHCX. REG: ISM330DHCX_ID, and the counts of ism330dhcx_from_fs16g_to_mg()
    // and ism330dhcx_from_fs2000dps_to_mdps(). No document of its delay was at hand.
    KIND(SENSOR_LSM6DSOX, 0x6B, LSM6DSOX_RATE_HZ, LSM6DSOX_GYR_DELAY_US),
};

static const IN_FLASH struct part_chip chip = {
    .addresses = {ADDRESS, ADDRESS_HIGH},
    .kinds = kinds,
    .kinds_count = sizeof kinds / sizeof kinds[0],
    .status = REG_STATUS,
    .reset = REG_CTRL3_C,
    .kept = REG_INT1_CTRL,
    .kept_count = sizeof kept_values,
    .kept_values = kept_values,
    .axes = axes,
    .axes_count = sizeof axes / sizeof axes[0],
#ifndef PART_WITHOUT_SELF_TEST
    .gravity_counts = ROUNDED(1000 / 0.122),
#endif
    .rows = rows,
};

// Both families have the same outputs.
#define LSM6(of)                                                                       \
    {                                                                                  \
        .chip = (of), .burst = {0, REG_OUT_TEMP_L, BURST_BYTES},                       \
        .ready = {0, REG_STATUS, GDA}, .acc = {ACC_PLACE, INT16_MAX},                  \
        .gyr = {GYR_PLACE, ROUNDED(2000 / 0.07) + 1}, .temperature_zero_cdeg = 2500,   \
        .temperature_cdeg_q8 = 100                                                     \
    }

// 16 g are 32787 counts; 2000 deg/s 28571, beyond which the document has no data.
// Temperature, DS table 5: 256 a degC, 0 at 25 degC.
const IN_FLASH struct joined_inertial lsm6dsox = LSM6(&chip);

#ifndef PART_WITHOUT_SELF_TEST
// Addresses, answers, counts, outputs and their status are as above: VH, VX, VC.
enum {
    REG_CTRL3 = 0x12,  // VH, "bitfields page main"; with the bits of CTRL3_C used here
    REG_CTRL1 = 0x10,
    REG_CTRL2 = 0x11,
    REG_CTRL6 = 0x15,
    REG_CTRL8 = 0x17,
    REG_CTRL10 = 0x19,
    REG_HAODR_CFG = 0x62,

    // VH: data_rate_t, xl_mode_t, gy_mode_t. ODR_HA02_AT_200Hz is rate 7 of set 2.
    V_XL_60_HZ = 0x05,
    V_G_240_HZ = 0x07,
    V_HA_200_HZ = 0x17,
    HAODR_SET_2 = 0x02,
    V_XL_4_G = 0x01,  // VH: xl_full_scale_t
    V_XL_16_G = 0x03,
    V_G_2000_DPS = 0x04,  // VH: gy_full_scale_t
};

// From INT1_CTRL to CTRL10. The filters that can be chosen stay off: ctrl7_t, ctrl9_t.
static const IN_FLASH uint8_t v_kept_values[] = {
    INT1_DRDY_G, 0,           0,  // WHO_AM_I
    V_HA_200_HZ, V_HA_200_HZ, BDU | IF_INC,
    0,           0,           V_G_2000_DPS,
    0,           V_XL_16_G,   0,
    0,
};
_Static_assert(sizeof v_kept_values <= PART_KEPT_MAX, "part_verify() has room");

// Ranges are set while their sensor is off: of relatives with a second accelerometer
// users report that the gyroscope's does not hold else.
static const IN_FLASH struct part_row v_rows[] = {
    {PART_WAIT, 20},  // VX: 10 ms of boot
    {PART_FIND, 0},
    {REG_INT1_CTRL, 0},  // in case it starts as an LSM6DSOX does
    {REG_CTRL1, OFF},    // VC: sw_reset()
    {REG_CTRL2, OFF},
    {REG_CTRL3, IF_INC | SW_RESET},
    {PART_AWAIT_RESET, SW_RESET},
    {REG_CTRL3, BDU | IF_INC},
    // VX, in its order, with its rates, ranges, signs and waits.
    {PART_SKIP_IF_TESTED, 20},
    {REG_CTRL8, V_XL_4_G},
    {REG_CTRL1, V_XL_60_HZ},
    {PART_WAIT, 100},
    {PART_SAMPLE_PLAIN, ACC_AXES},
    {PART_FORCE, 0},  // an LSM6DSV32X, which has the same identity, reads 0.5 g
    {REG_CTRL10, ST_XL_NEGATIVE},
    {PART_WAIT, 100},
    {PART_SAMPLE_STIMULATED, ACC_AXES},
    {PART_JUDGE, ACC_AXES},
    {REG_CTRL10, 0},
    {REG_CTRL1, OFF},
    {REG_CTRL6, V_G_2000_DPS},
    {REG_CTRL2, V_G_240_HZ},
    {PART_WAIT, 100},
    {PART_SAMPLE_PLAIN, GYR_AXES},
    {REG_CTRL10, ST_G_POSITIVE},
    {PART_WAIT, 100},
    {PART_SAMPLE_STIMULATED, GYR_AXES},
    {PART_JUDGE, GYR_AXES},
    {REG_CTRL2, OFF},
    {REG_HAODR_CFG, HAODR_SET_2},
    {REG_CTRL6, V_G_2000_DPS},
    {REG_CTRL8, V_XL_16_G},
    {PART_CONFIGURE, 0},
    {PART_WAIT, 100},
    {PART_VERIFY, 0},
    {PART_VERIFY, 0},  // of HAODR_CFG
    {PART_AWAIT_DATA, 50},
    {PART_DONE, 0},
};

// VH: LSM6DSV16X_ID; lsm6dsv_reg.h has the same. VC: from_fs16_to_mg() and
// from_fs2000_to_mdps().
static const IN_FLASH struct sensor_identity v_kinds[] = {
    KIND(SENSOR_LSM6DSV16X, 0x70, LSM6DSV16X_RATE_HZ, LSM6DSV16X_GYR_DELAY_US),
};

static const IN_FLASH struct part_chip v_chip = {
    .addresses = {ADDRESS, ADDRESS_HIGH},
    .kinds = v_kinds,
    .kinds_count = sizeof v_kinds / sizeof v_kinds[0],
    .status = REG_STATUS,
    .reset = REG_CTRL3,
    .kept = REG_INT1_CTRL,
    .kept_count = sizeof v_kept_values,
    .kept_values = v_kept_values,
    .kept_apart = {REG_HAODR_CFG, HAODR_SET_2},
    .axes = axes,
    .axes_count = sizeof axes / sizeof axes[0],
    .gravity_counts = ROUNDED(1000 / 0.122),
    .rows = v_rows,
};

const IN_FLASH struct joined_inertial lsm6dsv16x = LSM6(&v_chip);
#endif
