// SPDX-License-Identifier: MIT
// Registers of the MPU-9250 and its AK8963 that set-up uses, and their values;
// documents: mpu9250_private.h.
#ifndef MPU9250_REGISTERS_H
#define MPU9250_REGISTERS_H

// Of the MPU-9250.
enum {
    REG_SELF_TEST_X_GYRO = 0x00,   // RM 0 to 2
    REG_OTHER_WHO_AM_I = 0x00,     // of Bosch's chips and the ICM-20948, bank 0
    REG_SELF_TEST_X_ACCEL = 0x0D,  // RM 13 to 15
    REG_SMPLRT_DIV = 0x19,         // RM 25
    REG_CONFIG = 0x1A,             // RM 26
    REG_GYRO_CONFIG = 0x1B,        // RM 27
    REG_ACCEL_CONFIG = 0x1C,       // RM 28
    REG_ACCEL_CONFIG_2 = 0x1D,     // RM 29
    REG_I2C_MST_CTRL = 0x24,       // RM 36
    REG_I2C_SLV0_ADDR = 0x25,      // RM 37
    REG_I2C_SLV0_REG = 0x26,       // RM 38
    REG_I2C_SLV0_CTRL = 0x27,      // RM 39
    REG_I2C_SLV4_ADDR = 0x31,      // RM 49
    REG_I2C_SLV4_REG = 0x32,       // RM 50
    REG_I2C_SLV4_DO = 0x33,        // RM 51
    REG_I2C_SLV4_CTRL = 0x34,      // RM 52
    REG_I2C_MST_STATUS = 0x36,     // RM 54
    REG_INT_PIN_CFG = 0x37,        // RM 55
    REG_INT_ENABLE = 0x38,         // RM 56
    REG_INT_STATUS = 0x3A,         // RM 58
    REG_USER_CTRL = 0x6A,          // RM 106
    REG_PWR_MGMT_1 = 0x6B,         // RM 107
    REG_PWR_MGMT_2 = 0x6C,         // RM 108
    REG_WHO_AM_I = 0x75,           // RM 117

    H_RESET = 0x80,       // PWR_MGMT_1
    CLKSEL_AUTO = 0x01,   // PWR_MGMT_1: the gyroscope's PLL once it runs
    RAW_DATA_RDY = 0x01,  // INT_STATUS, INT_ENABLE
    DLPF_2 = 0x02,        // gyroscope 92 Hz, accelerometer 99 Hz, both at 1 kHz
    DLPF_5 = 0x05,        // both 10 Hz
    FULL_SCALE_0 = 0x00,  // 250 deg/s, 2 g
    FULL_SCALE_3 = 0x18,  // 2000 deg/s, 16 g
    STIMULUS_ON = 0xE0,   // GYRO_CONFIG, ACCEL_CONFIG: all three axes
    I2C_MST_EN = 0x20,    // USER_CTRL
    MST_CTRL = 0x4D,      // WAIT_FOR_ES: INT comes after the AK8963's bytes; 400 kHz
    SLAVE_READ = 0x80,    // I2C_SLV0_ADDR
    SLAVE_ENABLE = 0x80,  // I2C_SLVx_CTRL
    SLV4_DONE = 0x40,     // I2C_MST_STATUS
    SLV4_NACK = 0x10,     // I2C_MST_STATUS
    // INT_PIN_CFG. A pulse of 50 us, active high, push-pull: an edge a sample whether
    // the one before it was read or not, so that one lost burst can't end the stream.
    INT_PULSE = 0x00,
    BYPASS_EN = 0x02,  // the AK8963 is on the host's bus

    WHO_MPU6500 = 0x70,  // then MPU-9250, a gap, MPU-9255, MPU-6515
    WHO_MPU6515 = 0x74,
    // As drivers of others have them; no document was at hand.
    WHO_BMI160 = 0xD1,
    WHO_ICM20948 = 0xEA,
    // The byte of an undriven or held bus.
    WHO_NOBODY = 0xFF,
    WHO_HELD = 0x00,
};

// Of the AK8963.
enum {
    AK8963_ADDRESS = 0x0C,  // AK 7.2
    AK8963_ID = 0x48,       // AK 8.3: WIA

    AK_WIA = 0x00,
    AK_ST1 = 0x02,
    AK_HXL = 0x03,
    AK_CNTL1 = 0x0A,
    AK_CNTL2 = 0x0B,
    AK_ASTC = 0x0C,
    AK_ASAX = 0x10,

    MODE_POWER_DOWN = 0x00,
    MODE_FUSE = 0x0F,
    MODE_SELF_TEST = 0x18,     // 16 bits
    MODE_CONTINUOUS_2 = 0x16,  // 100 Hz, 16 bits
    SRST = 0x01,
    SELF_FIELD_ON = 0x40,
    SELF_FIELD_OFF = 0x00,
};

#endif
