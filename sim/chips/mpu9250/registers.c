// SPDX-License-Identifier: MIT
// What reading and writing the MPU-9250's registers does.
#include "chip.h"

#include <stddef.h>
#include <string.h>

static void clear_interrupt(struct mpu9250_chip *chip) {
    chip->reg[REG_INT_STATUS] = 0;
    if (chip->reg[REG_INT_PIN_CFG] & INT_LATCH) {
        chip->int_level = false;
        chip->int_end_ns = NEVER;
    }
}

uint8_t mpu9250_chip_read_register(struct mpu9250_chip *chip) {
    const uint8_t at = chip->pointer;
    uint8_t value = chip->reg[at];
    if (at == REG_INT_STATUS || (chip->reg[REG_INT_PIN_CFG] & INT_ANYRD_2CLEAR)) {
        clear_interrupt(chip);
    }
    if (at == REG_I2C_MST_STATUS) {
        chip->reg[at] = 0;  // RM 4.18: reading clears
    }
    if (at == REG_WHO_AM_I) {
        value = sensor_chip_identity(&chip->base, MPU9250_CHIP_MPU, value);
    }
    if (at != REG_FIFO_R_W) {  // the one register that does not move on
        chip->pointer = (at + 1) & (REG_COUNT - 1);
    }
    return value;
}

static void write_power(struct mpu9250_chip *chip, uint8_t value) {
    if (value & PWR_H_RESET) {
        mpu9250_chip_reset(chip);  // the AK8963 is another die and keeps its state
        return;
    }
    if (value & PWR_CYCLE) {
        sensor_chip_complain(&chip->base, "low-power cycling is not modelled");
    }
    chip->reg[REG_PWR_MGMT_1] = value;
    const bool is_asleep = (value & PWR_SLEEP) != 0;
    if (chip->is_asleep && !is_asleep) {
        chip->awake_ns = chip->base.wire.now_ns;
    }
    if (chip->is_asleep != is_asleep) {
        chip->is_asleep = is_asleep;
        mpu9250_chip_restart_clock(chip);
    } else {
        mpu9250_chip_set_next_tick(chip);
    }
}

static void write_user_control(struct mpu9250_chip *chip, uint8_t value) {
    if (value & 0x54) {  // FIFO_EN, I2C_IF_DIS, FIFO_RST
        sensor_chip_complain(&chip->base, "FIFO and SPI are not modelled");
    }
    if (value & USER_I2C_MST_RST) {
        mpu9250_chip_cut_aux(chip);
        memset(&chip->aux, 0, sizeof chip->aux);
        mpu9250_chip_finish_aux(chip);
    }
    if (value & USER_SIG_COND_RST) {  // RM 4.33: clears the sensors' registers too
        memset(&chip->inner[REG_ACCEL_XOUT_H], 0,
               REG_EXT_SENS_DATA_23 - REG_ACCEL_XOUT_H + 1);
    }
    chip->reg[REG_USER_CTRL] =
        value & (uint8_t) ~(USER_I2C_MST_RST | USER_SIG_COND_RST | 0x04);
    // Switched off, the master ends the transaction under way, and the round with it.
}

static void check_slaves(struct mpu9250_chip *chip) {
    const uint8_t address = chip->reg[REG_I2C_SLV0_ADDR];
    const uint8_t controls = (uint8_t)(chip->reg[REG_I2C_SLV0_CTRL] & ~SLV_LENG) |
                             chip->reg[REG_I2C_SLV4_CTRL];
    if ((address != 0 && !(address & SLV_READ)) || (controls & ~SLV_EN)) {
        sensor_chip_complain(&chip->base,
                             "of its own I2C master only reads by slave 0 and single "
                             "bytes by slave 4 are modelled");
    }
}

void mpu9250_chip_write_register(struct mpu9250_chip *chip, uint8_t value) {
    const uint8_t at = chip->pointer;
    const uint8_t old = chip->reg[at];
    switch (at) {
    case REG_SMPLRT_DIV:
    case REG_CONFIG:
    case REG_GYRO_CONFIG:
        chip->reg[at] = value;
        if (value != old) {
            mpu9250_chip_restart_clock(chip);
        }
        break;
    case REG_INT_ENABLE:
        chip->reg[at] = value;
        if (value & ~INT_RAW_RDY) {
            sensor_chip_complain(&chip->base,
                                 "only the data-ready interrupt is modelled");
        }
        break;
    case REG_SIGNAL_PATH_RESET:
        break;  // RM 4.31: filters restart; the bits clear themselves
    case REG_USER_CTRL:
        write_user_control(chip, value);
        break;
    case REG_PWR_MGMT_1:
        write_power(chip, value);
        break;
    case REG_I2C_SLV4_DI:
    case REG_I2C_MST_STATUS:
        sensor_chip_complain(&chip->base, "a read-only register written");
        break;
    case REG_ACCEL_CONFIG:
    case REG_ACCEL_CONFIG_2:
    case REG_I2C_MST_CTRL:
    case REG_INT_PIN_CFG:
    case REG_PWR_MGMT_2:
    case REG_I2C_SLV0_ADDR:
    case REG_I2C_SLV0_REG:
    case REG_I2C_SLV0_CTRL:
    case REG_I2C_SLV4_ADDR:
    case REG_I2C_SLV4_REG:
    case REG_I2C_SLV4_DO:
    case REG_I2C_SLV4_CTRL:
        chip->reg[at] = value;
        check_slaves(chip);
        break;
    default:
        if (at < REG_SELF_TEST_X_GYRO + 3 ||
            (at >= REG_SELF_TEST_X_ACCEL && at < REG_SELF_TEST_X_ACCEL + 3)) {
            chip->reg[at] = value;
        } else if (value != 0 || at > REG_WHO_AM_I) {
            sensor_chip_complain(&chip->base,
                                 "a register written that is reserved, read-only "
                                 "or not modelled");
        }
        break;
    }
    chip->pointer = (at + 1) & (REG_COUNT - 1);
}
