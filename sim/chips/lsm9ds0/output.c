// SPDX-License-Identifier: MIT
// Output and status registers: a sample that arrives, a byte that is read, block data
// update (BDU) between them.
#include "chip.h"

#include <stddef.h>

static uint8_t status_reg(enum chip_quantity quantity) {
    return quantity == CHIP_MAG ? REG_STATUS_M : REG_STATUS;
}

static uint8_t first_out_reg(enum chip_quantity quantity) {
    return quantity == CHIP_MAG ? REG_OUT_X_L_M : REG_OUT_X_L;
}

// Bit 0 is x. All three have their enable bits there; the magnetometer has none.
static uint8_t enabled_axes(const struct lsm9ds0_chip *chip,
                            enum chip_quantity quantity) {
    switch (quantity) {
    case CHIP_GYR:
        return chip->g.reg[REG_CTRL1_G] & G_AXES;
    case CHIP_ACC:
        return chip->xm.reg[REG_CTRL1_XM] & A_AXES;
    default:
        return 0x07;
    }
}

static bool has_bdu(const struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    if (quantity == CHIP_GYR) {
        return (chip->g.reg[REG_CTRL4_G] & G_BDU) != 0;
    }
    return (chip->xm.reg[REG_CTRL1_XM] & XM_BDU) != 0;
}

// The host sees the latest value of an axis.
static void show(struct lsm9ds0_chip *chip, enum chip_quantity quantity, int axis) {
    const uint16_t value = (uint16_t)chip->sensors[quantity].latest[axis];
    uint8_t *at =
        &lsm9ds0_chip_die_of(chip, quantity)->reg[first_out_reg(quantity) + 2 * axis];
    const bool is_big_endian =
        quantity == CHIP_GYR && (chip->g.reg[REG_CTRL4_G] & G_BLE) != 0;
    at[is_big_endian ? 1 : 0] = (uint8_t)(value & 0xFF);
    at[is_big_endian ? 0 : 1] = (uint8_t)(value >> 8);
}

// AN3308: a new value replaces an unread one, and is flagged.
static void flag(uint8_t *status, uint8_t bits) {
    const uint8_t lost = *status & bits;
    *status |= (uint8_t)(bits | (lost << OVERRUN_SHIFT));
}

static void put_axis(struct lsm9ds0_chip *chip, enum chip_quantity quantity, int axis) {
    struct sensor *sensor = &chip->sensors[quantity];
    uint8_t *status = &lsm9ds0_chip_die_of(chip, quantity)->reg[status_reg(quantity)];
    const uint8_t bit = (uint8_t)(1 << axis);
    const uint8_t halves = (uint8_t)(0x03 << (2 * axis));
    if (!(sensor->half_read & halves)) {
        show(chip, quantity, axis);
        flag(status, bit);
    } else if (sensor->waiting & bit) {
        *status |= (uint8_t)(bit << OVERRUN_SHIFT);  // one more behind the held one
    } else {
        sensor->waiting |= bit;
    }
}

void lsm9ds0_chip_take_sample(struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    struct die *die = lsm9ds0_chip_die_of(chip, quantity);
    sensor->tick++;
    lsm9ds0_chip_set_next_tick(chip, quantity);
    if (i2c_slave_find_fault(&chip->wire, CHIP_FAULT_NO_DATA_READY, die->number) !=
            NULL ||
        (quantity == CHIP_MAG &&
         i2c_slave_find_fault(&chip->wire, CHIP_FAULT_NO_MAG, die->number) != NULL)) {
        return;
    }
    sensor->samples++;
    if (i2c_slave_find_fault(&chip->wire, CHIP_FAULT_FROZEN, die->number) == NULL) {
        lsm9ds0_chip_sense(chip, quantity);
    }
    const uint8_t axes = enabled_axes(chip, quantity);
    for (int axis = 0; axis < AXES; axis++) {
        if (axes & (1 << axis)) {
            put_axis(chip, quantity, axis);
        }
    }
    // Where an axis is held back, nothing of the set was overwritten.
    uint8_t *status = &die->reg[status_reg(quantity)];
    if (sensor->waiting) {
        *status |= DATA_ALL;
    } else {
        flag(status, DATA_ALL);
    }
    if (quantity == CHIP_MAG && (chip->xm.reg[REG_CTRL7_XM] & M_MODE) == M_SINGLE) {
        chip->xm.reg[REG_CTRL7_XM] ^= M_SINGLE ^ M_POWER_DOWN;
        lsm9ds0_chip_set_next_tick(chip, quantity);
    }
}

void lsm9ds0_chip_release(struct lsm9ds0_chip *chip, enum chip_quantity quantity,
                          int number) {
    struct sensor *sensor = &chip->sensors[quantity];
    uint8_t *status = &lsm9ds0_chip_die_of(chip, quantity)->reg[status_reg(quantity)];
    const int axis = number / 2;
    const uint8_t bit = (uint8_t)(1 << axis);
    const uint8_t halves = (uint8_t)(0x03 << (2 * axis));
    if (number & 1) {
        // AN3308: the flags of an axis go as its high byte is read, those of all
        // as it was the last one.
        *status &= (uint8_t) ~(bit | (bit << OVERRUN_SHIFT));
        if (!(*status & enabled_axes(chip, quantity))) {
            *status &= (uint8_t) ~(DATA_ALL | (DATA_ALL << OVERRUN_SHIFT));
        }
    }
    if (!has_bdu(chip, quantity)) {
        return;
    }
    sensor->half_read |= (uint8_t)(1 << number);
    if ((sensor->half_read & halves) != halves) {
        return;
    }
    sensor->half_read &= (uint8_t)~halves;
    if (sensor->waiting & bit) {
        sensor->waiting &= (uint8_t)~bit;
        show(chip, quantity, axis);
        *status |= bit | DATA_ALL;
    }
}

void lsm9ds0_chip_release_all(struct lsm9ds0_chip *chip, enum chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    for (int axis = 0; axis < AXES; axis++) {
        if (sensor->waiting & (1 << axis)) {
            show(chip, quantity, axis);
        }
    }
    sensor->half_read = 0;
    sensor->waiting = 0;
}
