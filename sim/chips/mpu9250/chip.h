// SPDX-License-Identifier: MIT
// Shared by the files of the MPU-9250's model: its registers and its state. See
// ../mpu9250.h for the documents that RM, PS, ST and AK stand for.
#ifndef SIM_CHIPS_MPU9250_CHIP_H
#define SIM_CHIPS_MPU9250_CHIP_H

#include "../mpu9250.h"
#include "../sensor/model.h"

// RM 3, table 1.
enum {
    REG_SELF_TEST_X_GYRO = 0,
    REG_SELF_TEST_X_ACCEL = 13,
    REG_SMPLRT_DIV = 25,
    REG_CONFIG = 26,
    REG_GYRO_CONFIG = 27,
    REG_ACCEL_CONFIG = 28,
    REG_ACCEL_CONFIG_2 = 29,
    REG_I2C_MST_CTRL = 36,
    REG_I2C_SLV0_ADDR = 37,
    REG_I2C_SLV0_REG = 38,
    REG_I2C_SLV0_CTRL = 39,
    REG_I2C_SLV4_ADDR = 49,
    REG_I2C_SLV4_REG = 50,
    REG_I2C_SLV4_DO = 51,
    REG_I2C_SLV4_CTRL = 52,
    REG_I2C_SLV4_DI = 53,
    REG_I2C_MST_STATUS = 54,
    REG_INT_PIN_CFG = 55,
    REG_INT_ENABLE = 56,
    REG_INT_STATUS = 58,
    REG_ACCEL_XOUT_H = 59,
    REG_TEMP_OUT_H = 65,
    REG_GYRO_XOUT_H = 67,
    REG_EXT_SENS_DATA_00 = 73,
    REG_EXT_SENS_DATA_23 = 96,
    REG_SIGNAL_PATH_RESET = 104,
    REG_USER_CTRL = 106,
    REG_PWR_MGMT_1 = 107,
    REG_PWR_MGMT_2 = 108,
    REG_FIFO_R_W = 116,
    REG_WHO_AM_I = 117,
    REG_COUNT = 128,
};

enum {
    // RM 4.12, 4.13, 4.17
    MST_WAIT_FOR_ES = 1 << 6,
    MST_CLOCK = 0x0F,
    SLV_READ = 1 << 7,
    SLV_EN = 1 << 7,
    SLV_LENG = 0x0F,
    // RM 4.18
    STATUS_SLV4_DONE = 1 << 6,
    // RM 4.19, 4.21
    INT_ACTL = 1 << 7,
    INT_LATCH = 1 << 5,
    INT_ANYRD_2CLEAR = 1 << 4,
    INT_BYPASS_EN = 1 << 1,
    INT_RAW_RDY = 1 << 0,
    // RM 4.33 to 4.35
    USER_I2C_MST_EN = 1 << 5,
    USER_I2C_MST_RST = 1 << 1,
    USER_SIG_COND_RST = 1 << 0,
    PWR_H_RESET = 1 << 7,
    PWR_SLEEP = 1 << 6,
    PWR_CYCLE = 1 << 5,
    PWR_GYRO_STANDBY = 1 << 4,
    PWR_CLKSEL = 0x07,
    CLKSEL_STOPPED = 7,
    // RM 4.6, 4.8: the self-test bits and the ranges of both sensors, and FCHOICE
    SELF_TEST_X = 1 << 7,
    RANGE_SHIFT = 3,
    GYRO_FCHOICE_B = 0x03,
    ACCEL_FCHOICE_B = 1 << 3,
    DLPF = 0x07,
};

enum { AK_ADDRESS = 0x0C, AK_COUNT = 0x14 };

struct ak8963 {
    uint8_t reg[AK_COUNT];
    uint8_t pointer;
    bool is_reading;       // between the first data byte and ST2: data are protected
    uint64_t measured_ns;  // when the measurement under way ends; NEVER for none
    uint64_t started_ns;   // when the first of a continuous run started
    uint64_t count;        // of measurements started since
    uint64_t powered_down_ns;  // when power-down mode was entered
};

// The bus between the chip's own master and the AK8963, which no reset changes.
struct aux_bus {
    bool is_held;    // the AK8963 holds its data line low
    uint8_t clocks;  // SCL pulses until it lets go; 0: it never does
};

// One transaction of the chip's own I2C master, a byte at a time (RM 4.13 to 4.17).
enum { AUX_NONE = 5 };
struct aux {
    uint8_t slave;  // 0 or 4 under way, or AUX_NONE
    uint8_t at;     // bytes moved
    uint8_t length;
    bool is_refused;
    uint64_t byte_ns;  // when the next byte is through
};

struct mpu9250_chip {
    struct sensor_chip base;
    struct mpu9250_chip_config config;
    uint8_t reg[REG_COUNT];
    // Registers 59 to 96 as the sensors fill them; what the host sees follows while the
    // wire is idle, so that a burst is of one instant (RM 4.22, 4.24).
    uint8_t inner[REG_COUNT];
    uint64_t awake_ns;  // the sensors run since
    bool is_asleep;
    uint64_t epoch_ns;  // sample number n falls at epoch + n periods
    uint64_t tick;      // number of the next sample
    uint64_t tick_ns;
    uint64_t samples;
    bool int_level;  // asserted, before ACTL
    uint64_t int_end_ns;
    bool waits_for_aux;
    uint8_t pointer;

    struct aux aux;
    struct aux_bus aux_bus;
    struct ak8963 ak;
};

// False for an MPU-6500, and while CHIP_FAULT_NO_MAG is active.
bool mpu9250_chip_has_ak8963(const struct mpu9250_chip *chip);
// H_RESET and power-up. The AK8963 is another die and keeps its state.
void mpu9250_chip_reset(struct mpu9250_chip *chip);

// sense.c
// Sets the time of the next sample after a change of clock or power.
void mpu9250_chip_set_next_tick(struct mpu9250_chip *chip);
void mpu9250_chip_restart_clock(struct mpu9250_chip *chip);
void mpu9250_chip_take_sample(struct mpu9250_chip *chip);
// Copies `inner` to the host's registers, unless a transaction is under way.
void mpu9250_chip_show(struct mpu9250_chip *chip);
void mpu9250_chip_signal_data_ready(struct mpu9250_chip *chip);

// registers.c: one byte from or to the MPU's register that the pointer is at.
uint8_t mpu9250_chip_read_register(struct mpu9250_chip *chip);
void mpu9250_chip_write_register(struct mpu9250_chip *chip, uint8_t value);

// master.c
// A round of all slaves that are enabled starts, advances by a byte, or ends.
void mpu9250_chip_begin_aux(struct mpu9250_chip *chip);
void mpu9250_chip_move_aux_byte(struct mpu9250_chip *chip);
void mpu9250_chip_finish_aux(struct mpu9250_chip *chip);
// The master is reset: a transaction under way is cut off.
void mpu9250_chip_cut_aux(struct mpu9250_chip *chip);
// The host's bus is passed on to the AK8963.
bool mpu9250_chip_is_bypass(const struct mpu9250_chip *chip);

// ak8963.c
void mpu9250_chip_reset_ak8963(struct mpu9250_chip *chip);
void mpu9250_chip_end_measurement(struct mpu9250_chip *chip);
// One byte to or from the AK8963's register that its pointer is at.
void mpu9250_chip_write_ak8963(struct mpu9250_chip *chip, uint8_t value);
uint8_t mpu9250_chip_read_ak8963(struct mpu9250_chip *chip);

#endif
