// SPDX-License-Identifier: MIT
// Shared by the files of the LSM9DS0's model: its registers and its state. See
// ../lsm9ds0.h for the documents that DS and AN stand for.
#ifndef SIM_CHIPS_LSM9DS0_CHIP_H
#define SIM_CHIPS_LSM9DS0_CHIP_H

#include "../lsm9ds0.h"
#include "../sensor/st.h"

enum { SENSORS = 3 };

// DS register map. Both dies have these at the same place.
enum {
    REG_WHO_AM_I = 0x0F,
    REG_STATUS = 0x27,  // STATUS_REG_G, STATUS_REG_A
    REG_OUT_X_L = 0x28,
    REG_FIFO_SRC = 0x2F,
};
enum {
    REG_CTRL1_G = 0x20,
    REG_CTRL2_G = 0x21,
    REG_CTRL3_G = 0x22,
    REG_CTRL4_G = 0x23,
    REG_CTRL5_G = 0x24,
};
enum {
    REG_OUT_TEMP_L_XM = 0x05,
    REG_OUT_TEMP_H_XM = 0x06,
    REG_STATUS_M = 0x07,
    REG_OUT_X_L_M = 0x08,
    REG_OUT_Z_H_M = 0x0D,
    REG_INT_CTRL_M = 0x12,
    REG_CTRL0_XM = 0x1F,
    REG_CTRL1_XM = 0x20,
    REG_CTRL2_XM = 0x21,
    REG_CTRL3_XM = 0x22,
    REG_CTRL4_XM = 0x23,
    REG_CTRL5_XM = 0x24,
    REG_CTRL6_XM = 0x25,
    REG_CTRL7_XM = 0x26,
};

enum {
    // CTRL_REG1_G
    G_DR_SHIFT = 6,
    G_BW_SHIFT = 4,
    G_PD = 1 << 3,
    G_AXES = 0x07,  // Zen Yen Xen here: bit 2, 1, 0
    // CTRL_REG3_G to CTRL_REG5_G
    G_I2_DRDY = 1 << 3,
    G_BDU = 1 << 7,
    G_FS_SHIFT = 4,
    G_ST_SHIFT = 1,
    BOOT = 1 << 7,  // also of CTRL_REG0_XM
    // INT_CTRL_REG_M
    XM_IEA = 1 << 3,
    // CTRL_REG1_XM to CTRL_REG4_XM
    A_ODR_SHIFT = 4,
    A_ODR_50_HZ = 5,
    A_ODR_LAST = 10,
    XM_BDU = 1 << 3,
    A_AXES = 0x07,
    A_BW_SHIFT = 6,
    A_FS_SHIFT = 3,
    A_FS_LAST = 4,
    A_ST_SHIFT = 1,
    P1_DRDYA = 1 << 2,
    P1_DRDYM = 1 << 1,
    P2_DRDYA = 1 << 3,
    P2_DRDYM = 1 << 2,
    // CTRL_REG5_XM to CTRL_REG7_XM
    TEMP_EN = 1 << 7,
    M_RES_SHIFT = 5,
    M_ODR_SHIFT = 2,
    M_ODR_100_HZ = 5,
    M_FS_SHIFT = 5,
    M_MODE = 0x03,
    M_CONTINUOUS = 0,
    M_SINGLE = 1,
    M_POWER_DOWN = 2,
    // FIFO_SRC_REG
    FIFO_EMPTY = 1 << 5,
};

// One of gyroscope, accelerometer, magnetometer: its clock and its six output bytes.
struct sensor {
    uint64_t epoch_ns;  // sample number n falls at epoch + n periods
    uint64_t tick;      // number of the next sample
    uint64_t tick_ns;   // NEVER: off
    uint64_t samples;
    struct st_words words;
};

struct lsm9ds0_chip {
    struct sensor_chip base;
    struct lsm9ds0_chip_config config;
    uint64_t gyr_on_ns;  // the gyroscope left power-down
    struct st_die g;
    struct st_die xm;
    struct sensor sensors[SENSORS];  // by chip_quantity
};

// registers.c
// The number of a quantity's die, enum lsm9ds0_chip_die, and the die.
uint8_t lsm9ds0_chip_die_of(enum chip_quantity quantity);
struct st_die *lsm9ds0_chip_die(struct lsm9ds0_chip *chip, uint8_t number);
struct st_output lsm9ds0_chip_output(struct lsm9ds0_chip *chip,
                                     enum chip_quantity quantity);
// One byte from or to the register that the die's pointer is at.
uint8_t lsm9ds0_chip_read(void *self, uint8_t number);
void lsm9ds0_chip_write(void *self, uint8_t number, uint8_t value);

// sense.c
// Sets the time of the next sample after a change of rate or power, or at a reboot.
void lsm9ds0_chip_set_next_tick(struct lsm9ds0_chip *chip, enum chip_quantity quantity);
void lsm9ds0_chip_restart_clock(struct lsm9ds0_chip *chip, enum chip_quantity quantity);
// Takes a sample: measures, and with the field the temperature.
void lsm9ds0_chip_take_sample(struct lsm9ds0_chip *chip, enum chip_quantity quantity);

#endif
