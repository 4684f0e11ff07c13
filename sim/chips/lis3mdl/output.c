// SPDX-License-Identifier: MIT
// Output and status registers: a sample that arrives, a byte that is read, block data
// update (BDU) between them.
#include "chip.h"

void lis3mdl_chip_put(struct lis3mdl_chip *chip, uint8_t reg, int16_t value) {
    const bool is_big_endian = (chip->reg[REG_CTRL4] & BLE) != 0;
    chip->reg[reg + (is_big_endian ? 1 : 0)] = (uint8_t)((uint16_t)value & 0xFF);
    chip->reg[reg + (is_big_endian ? 0 : 1)] = (uint8_t)((uint16_t)value >> 8);
}

// The host sees the latest value of an axis.
static void show(struct lis3mdl_chip *chip, int axis) {
    lis3mdl_chip_put(chip, (uint8_t)(REG_OUT_X_L + 2 * axis), chip->latest[axis]);
}

// A new value replaces an unread one, and is flagged.
static void flag(struct lis3mdl_chip *chip, uint8_t bits) {
    uint8_t *status = &chip->reg[REG_STATUS];
    const uint8_t lost = *status & bits;
    *status |= (uint8_t)(bits | (lost << OVERRUN_SHIFT));
}

static void put_axis(struct lis3mdl_chip *chip, int axis) {
    const uint8_t bit = (uint8_t)(1 << axis);
    if (!(chip->half_read & (0x03 << (2 * axis)))) {
        show(chip, axis);
        flag(chip, bit);
    } else if (chip->waiting & bit) {
        chip->reg[REG_STATUS] |= (uint8_t)(bit << OVERRUN_SHIFT);
    } else {
        chip->waiting |= bit;
    }
}

void lis3mdl_chip_take_sample(struct lis3mdl_chip *chip) {
    if (!lis3mdl_chip_measure(chip)) {
        return;
    }
    for (int axis = 0; axis < AXES; axis++) {
        put_axis(chip, axis);
    }
    // Where an axis is held back, nothing of the set was overwritten.
    if (chip->waiting) {
        chip->reg[REG_STATUS] |= DATA_ALL;
    } else {
        flag(chip, DATA_ALL);
    }
}

void lis3mdl_chip_release(struct lis3mdl_chip *chip, int number) {
    uint8_t *status = &chip->reg[REG_STATUS];
    const int axis = number / 2;
    const uint8_t bit = (uint8_t)(1 << axis);
    const uint8_t halves = (uint8_t)(0x03 << (2 * axis));
    if (number & 1) {
        *status &= (uint8_t) ~(bit | (bit << OVERRUN_SHIFT));
        if (!(*status & DATA_AXES)) {
            *status &= (uint8_t) ~(DATA_ALL | (DATA_ALL << OVERRUN_SHIFT));
        }
    }
    if (!(chip->reg[REG_CTRL5] & BDU)) {
        return;
    }
    chip->half_read |= (uint8_t)(1 << number);
    if ((chip->half_read & halves) != halves) {
        return;
    }
    chip->half_read &= (uint8_t)~halves;
    if (chip->waiting & bit) {
        chip->waiting &= (uint8_t)~bit;
        show(chip, axis);
        *status |= bit | DATA_ALL;
    }
}

void lis3mdl_chip_release_all(struct lis3mdl_chip *chip) {
    for (int axis = 0; axis < AXES; axis++) {
        if (chip->waiting & (1 << axis)) {
            show(chip, axis);
        }
    }
    chip->half_read = 0;
    chip->waiting = 0;
}
