// SPDX-License-Identifier: MIT
// Shared by the files of the LIS3MDL's model: its registers and its state. See
// ../lis3mdl.h for the documents that DS, AN, AD and LX stand for.
#ifndef SIM_CHIPS_LIS3MDL_CHIP_H
#define SIM_CHIPS_LIS3MDL_CHIP_H

#include "../chip_motion.h"
#include "../i2c_slave.h"
#include "../lis3mdl.h"

#define NEVER UINT64_MAX

enum { REG_COUNT = 128, AXES = 3, DIE = 1 };

// DS table 16; AN for the offsets.
enum {
    REG_OFFSET_X_L = 0x05,
    REG_OFFSET_Z_H = 0x0A,
    REG_WHO_AM_I = 0x0F,
    REG_CTRL1 = 0x20,
    REG_CTRL2 = 0x21,
    REG_CTRL3 = 0x22,
    REG_CTRL4 = 0x23,
    REG_CTRL5 = 0x24,
    REG_STATUS = 0x27,
    REG_OUT_X_L = 0x28,
    REG_OUT_Z_H = 0x2D,
    REG_TEMP_OUT_L = 0x2E,
    REG_TEMP_OUT_H = 0x2F,
    REG_INT_CFG = 0x30,
    REG_INT_THS_L = 0x32,
    REG_INT_THS_H = 0x33,
};

enum {
    // CTRL_REG1
    TEMP_EN = 1 << 7,
    OM_SHIFT = 5,
    OM_MASK = 0x03,
    DO_SHIFT = 2,
    DO_MASK = 0x07,
    FAST_ODR = 1 << 1,
    ST = 1 << 0,
    // CTRL_REG2
    FS_SHIFT = 5,
    FS_MASK = 0x03,
    REBOOT = 1 << 3,
    SOFT_RST = 1 << 2,
    // CTRL_REG3
    LP = 1 << 5,
    MD_MASK = 0x03,
    MD_CONTINUOUS = 0,
    MD_SINGLE = 1,
    MD_POWER_DOWN = 3,
    // CTRL_REG4, CTRL_REG5
    BLE = 1 << 1,
    BDU = 1 << 6,
    INT_CFG_ONE = 1 << 3,  // must be 1
    // STATUS_REG: overrun of an axis is its "data available", four bits up.
    DATA_AXES = 0x07,
    DATA_ALL = 1 << 3,
    OVERRUN_SHIFT = 4,
};

struct lis3mdl_chip {
    struct lis3mdl_chip_config config;
    struct i2c_slave wire;
    struct chip_motion motion;
    const char *complaint;

    uint8_t reg[REG_COUNT];
    uint8_t pointer;
    bool moves_on;      // bit 7 of the sub-address
    uint64_t wait_end;  // of a reset or reboot under way; NEVER for none
    uint64_t epoch_ns;  // sample number n falls at epoch + n periods
    uint64_t tick;      // number of the next sample
    uint64_t tick_ns;   // NEVER: off
    uint64_t samples;
    int16_t latest[AXES];
    // With BDU, output bytes of which the other half of the axis is yet to be read: the
    // axis is not updated until then. `waiting` axes have a newer value.
    uint8_t half_read;
    uint8_t waiting;
};

// chip.c
// Keeps the first thing that the host did against the documents.
void lis3mdl_chip_complain(struct lis3mdl_chip *chip, const char *what);

// sense.c
void lis3mdl_chip_restart_clock(struct lis3mdl_chip *chip);
// Measures `latest` and the temperature, and sets the time of the next sample. False:
// a fault keeps this one away.
bool lis3mdl_chip_measure(struct lis3mdl_chip *chip);

// output.c
void lis3mdl_chip_put(struct lis3mdl_chip *chip, uint8_t reg, int16_t value);
void lis3mdl_chip_take_sample(struct lis3mdl_chip *chip);
// An output byte has been read: number 0 to 5.
void lis3mdl_chip_release(struct lis3mdl_chip *chip, int number);
// BDU changed: nothing is held back, newer values show.
void lis3mdl_chip_release_all(struct lis3mdl_chip *chip);

// registers.c: one byte from or to the register that the pointer is at.
uint8_t lis3mdl_chip_read_register(struct lis3mdl_chip *chip);
void lis3mdl_chip_write_register(struct lis3mdl_chip *chip, uint8_t value);

#endif
