// SPDX-License-Identifier: MIT
// Shared by the files of the LSM6DSOX's model: its registers and its state. See
// ../lsm6dsox.h for the documents that DS, SO, AN, AD, LX and QC stand for.
#ifndef SIM_CHIPS_LSM6DSOX_CHIP_H
#define SIM_CHIPS_LSM6DSOX_CHIP_H

#include "../lsm6dsox.h"
#include "../sensor/st.h"

enum { DIE = 1 };

// DS table 20.
enum {
    REG_FUNC_CFG_ACCESS = 0x01,
    REG_PIN_CTRL = 0x02,
    REG_FIFO_CTRL1 = 0x07,
    REG_FIFO_CTRL2 = 0x08,
    REG_FIFO_CTRL3 = 0x09,
    REG_FIFO_CTRL4 = 0x0A,
    REG_COUNTER_BDR_REG1 = 0x0B,
    REG_COUNTER_BDR_REG2 = 0x0C,
    REG_INT1_CTRL = 0x0D,
    REG_INT2_CTRL = 0x0E,
    REG_WHO_AM_I = 0x0F,
    REG_CTRL1_XL = 0x10,
    REG_CTRL2_G = 0x11,
    REG_CTRL3_C = 0x12,
    REG_CTRL4_C = 0x13,
    REG_CTRL5_C = 0x14,
    REG_CTRL6_C = 0x15,
    REG_CTRL7_G = 0x16,
    REG_CTRL8_XL = 0x17,
    REG_CTRL9_XL = 0x18,
    REG_CTRL10_C = 0x19,
    REG_STATUS = 0x1E,
    REG_OUT_TEMP_L = 0x20,
    REG_OUTX_L_G = 0x22,
    REG_OUTX_L_A = 0x28,
    REG_OUTZ_H_A = 0x2D,
    REG_TAP_CFG0 = 0x56,
    REG_TAP_CFG1 = 0x57,
    REG_TAP_CFG2 = 0x58,
    REG_TAP_THS_6D = 0x59,
    REG_INT_DUR2 = 0x5A,
    REG_WAKE_UP_THS = 0x5B,
    REG_WAKE_UP_DUR = 0x5C,
    REG_FREE_FALL = 0x5D,
    REG_MD1_CFG = 0x5E,
    REG_MD2_CFG = 0x5F,
    REG_I3C_BUS_AVB = 0x62,
    REG_INTERNAL_FREQ_FINE = 0x63,
    REG_X_OFS_USR = 0x73,
    REG_Y_OFS_USR = 0x74,
    REG_Z_OFS_USR = 0x75,
};

enum {
    DATAREADY_PULSED = 1 << 7,  // COUNTER_BDR_REG1
    // INT1_CTRL, INT2_CTRL
    INT_DRDY_XL = 1 << 0,
    INT_DRDY_G = 1 << 1,
    INT1_BOOT = 1 << 2,
    INT2_DRDY_TEMP = 1 << 2,
    // CTRL1_XL, CTRL2_G
    ODR_SHIFT = 4,
    ODR_OFF = 0,
    ODR_208_HZ = 5,
    ODR_LAST = 10,
    ODR_1_6_HZ = 11,  // of the accelerometer in low power; else it is 12.5 Hz
    FS_SHIFT = 2,
    FS_MASK = 0x03,
    LPF2_XL_EN = 1 << 1,
    FS_125 = 1 << 1,
    FS_4000 = 1 << 0,
    // CTRL3_C
    BOOT = 1 << 7,
    BDU = 1 << 6,
    H_LACTIVE = 1 << 5,
    IF_INC = 1 << 2,
    SW_RESET = 1 << 0,
    // CTRL4_C
    SLEEP_G = 1 << 6,
    INT2_ON_INT1 = 1 << 5,
    DRDY_MASK = 1 << 3,
    I2C_DISABLE = 1 << 2,
    LPF1_SEL_G = 1 << 1,
    // CTRL5_C to CTRL8_XL
    ST_G_SHIFT = 2,
    ST_MASK = 0x03,
    XL_HM_MODE = 1 << 4,  // 1: not high performance
    USR_OFF_W = 1 << 3,
    FTYPE = 0x07,
    G_HM_MODE = 1 << 7,  // 1: not high performance
    USR_OFF_ON_OUT = 1 << 1,
    HPCF_XL_SHIFT = 5,
    // STATUS_REG
    XLDA = 1 << 0,
    GDA = 1 << 1,
    TDA = 1 << 2,
};

// The sampled quantities: the first two are those of enum chip_quantity.
enum source { GYR = CHIP_GYR, ACC = CHIP_ACC, TEMP, SOURCES };

struct sensor {
    uint32_t divider;  // of the clock's ticks; 0: off
    uint64_t tick;     // number of the clock's tick of the next sample
    uint64_t tick_ns;  // NEVER: off
    uint64_t samples;
    uint32_t settling;  // samples yet to come that are wrong
    struct st_words words;
    bool is_signalled;  // its data-ready signal, latched
};

struct lsm6dsox_chip {
    struct sensor_chip base;
    struct lsm6dsox_chip_config config;
    struct st_die die;   // wait_end: of a BOOT
    uint64_t reset_end;  // of a SW_RESET under way; NEVER for none
    bool is_i3c_only;

    // The clock of 6667 Hz: tick number anchor_tick was, or would have been, at
    // anchor_ns.
    double anchor_tick;
    uint64_t anchor_ns;
    uint64_t gyr_on_ns;  // the gyroscope left power-down
    uint64_t pulse_end;  // of data-ready where it is pulsed; NEVER for none
    struct sensor sensors[SOURCES];
};

// chip.c
// One of enum lsm6dsox_chip_pin.
bool lsm6dsox_chip_pin_is_high(const void *self, unsigned pin);

// clock.c
// Turns each sensor on or off, or to another rate, as its registers say.
void lsm6dsox_chip_set_rates(struct lsm6dsox_chip *chip);
// The time of the next sample after a change of the clock's speed or a reboot.
void lsm6dsox_chip_set_next_tick(struct lsm6dsox_chip *chip, enum source source);
double lsm6dsox_chip_period_ns(const struct lsm6dsox_chip *chip, enum source source);
// The clock continues from here at its current speed.
void lsm6dsox_chip_anchor(struct lsm6dsox_chip *chip);

// sense.c
// Measures: `latest` of the sensor.
void lsm6dsox_chip_sense(struct lsm6dsox_chip *chip, enum source source);

// output.c
void lsm6dsox_chip_take_sample(struct lsm6dsox_chip *chip, enum source source);
// An output byte has been read.
void lsm6dsox_chip_release(struct lsm6dsox_chip *chip, uint8_t reg);
// BDU changed: nothing is held back, newer values show.
void lsm6dsox_chip_release_all(struct lsm6dsox_chip *chip);

// registers.c: one byte from or to the register that the pointer is at.
uint8_t lsm6dsox_chip_read(void *self, uint8_t die);
void lsm6dsox_chip_write(void *self, uint8_t die, uint8_t value);

#endif
