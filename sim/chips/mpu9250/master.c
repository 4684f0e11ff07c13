// SPDX-License-Identifier: MIT
// The chip's own I2C master: its slave 0, which is read after each sample, and its
// slave 4, which reads or writes one byte once. Both are the AK8963 or absent.
#include "chip.h"

// RM 4.12: 8 MHz over 23..31 for 0..8, over 16..22 for 9..15.
static uint64_t aux_bits_ns(const struct mpu9250_chip *chip, unsigned bits) {
    const unsigned choice = chip->reg[REG_I2C_MST_CTRL] & MST_CLOCK;
    const unsigned divider = choice < 9 ? 23 + choice : 7 + choice;
    return (uint64_t)bits * divider * 125;
}

static uint8_t aux_address(const struct mpu9250_chip *chip, unsigned slave) {
    return chip->reg[slave == 4 ? REG_I2C_SLV4_ADDR : REG_I2C_SLV0_ADDR];
}

static uint8_t aux_control(const struct mpu9250_chip *chip, unsigned slave) {
    return chip->reg[slave == 4 ? REG_I2C_SLV4_CTRL : REG_I2C_SLV0_CTRL];
}

void mpu9250_chip_finish_aux(struct mpu9250_chip *chip) {
    chip->aux.slave = AUX_NONE;
    chip->aux.byte_ns = NEVER;
    if (chip->waits_for_aux) {
        chip->waits_for_aux = false;
        mpu9250_chip_signal_data_ready(chip);
    }
    mpu9250_chip_show(chip);
}

// A master that vanishes while the AK8963 sends leaves it in the middle of a byte:
// where the bit on the wire is a 0, it holds the line until it has been clocked to a 1
// or to its acknowledge (RM 106, the note on I2C_MST_RST).
void mpu9250_chip_cut_aux(struct mpu9250_chip *chip) {
    enum { BYTE_BITS = 9 };  // with the acknowledge
    const struct aux *aux = &chip->aux;
    if (aux->byte_ns == NEVER || aux->slave == AUX_NONE || aux->is_refused ||
        (aux_address(chip, aux->slave) & SLV_READ) == 0) {
        return;
    }
    const uint64_t bit_ns = aux_bits_ns(chip, 1);
    const uint64_t left = (aux->byte_ns - chip->base.wire.now_ns + bit_ns - 1) / bit_ns;
    if (left < 2 || left > BYTE_BITS) {
        return;  // the acknowledge, or an address
    }
    const uint8_t value =
        chip->ak.pointer < AK_COUNT ? chip->ak.reg[chip->ak.pointer] : 0;
    uint8_t clocks = 0;
    for (uint64_t bit = left - 1; bit > 0 && !(value >> (bit - 1) & 1); bit--) {
        clocks++;
    }
    if (clocks > 0) {
        chip->aux_bus = (struct aux_bus){true, clocks};
    }
}

static bool has_transaction(const struct mpu9250_chip *chip, unsigned slave) {
    const uint8_t control = aux_control(chip, slave);
    return (control & SLV_EN) && (slave == 4 || (control & SLV_LENG) > 0);
}

// Starts the transaction of this slave or of a later one, or ends the round.
static void aux_next(struct mpu9250_chip *chip, unsigned slave) {
    struct aux *aux = &chip->aux;
    if (slave == 0 && !has_transaction(chip, 0)) {
        slave = 4;
    }
    if (!(chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) || slave > 4 ||
        !has_transaction(chip, slave)) {
        mpu9250_chip_finish_aux(chip);
        return;
    }
    const uint8_t address = aux_address(chip, slave);
    aux->slave = (uint8_t)slave;
    aux->length = slave == 4 ? 1 : aux_control(chip, slave) & SLV_LENG;
    aux->at = 0;
    aux->is_refused = (address & 0x7F) != AK_ADDRESS || !mpu9250_chip_has_ak8963(chip);
    if (!aux->is_refused) {
        chip->ak.pointer = chip->reg[slave == 4 ? REG_I2C_SLV4_REG : REG_I2C_SLV0_REG];
    }
    // START and address, register, and for a read a second START and address; a byte.
    unsigned bits = 1 + 9 + 1;
    if (!aux->is_refused) {
        bits = 1 + 9 + 9 + (address & SLV_READ ? 1 + 9 : 0) + 9;
    }
    aux->byte_ns = chip->base.wire.now_ns + aux_bits_ns(chip, bits);
}

static void move_byte(struct mpu9250_chip *chip, unsigned slave) {
    if (!(aux_address(chip, slave) & SLV_READ)) {
        mpu9250_chip_write_ak8963(chip, chip->reg[REG_I2C_SLV4_DO]);
        return;
    }
    const uint8_t value = mpu9250_chip_read_ak8963(chip);
    if (slave == 4) {
        chip->reg[REG_I2C_SLV4_DI] = value;
    } else {
        chip->inner[REG_EXT_SENS_DATA_00 + chip->aux.at] = value;
    }
}

void mpu9250_chip_move_aux_byte(struct mpu9250_chip *chip) {
    struct aux *aux = &chip->aux;
    const unsigned slave = aux->slave;
    if (aux->is_refused) {
        chip->reg[REG_I2C_MST_STATUS] |= (uint8_t)(1 << slave);
    } else {
        move_byte(chip, slave);
        aux->at++;
        if (aux->at < aux->length) {
            aux->byte_ns = chip->base.wire.now_ns + aux_bits_ns(chip, 9);
            return;
        }
    }
    if (slave == 4) {
        chip->reg[REG_I2C_SLV4_CTRL] &= (uint8_t)~SLV_EN;  // RM 4.17
        chip->reg[REG_I2C_MST_STATUS] |= STATUS_SLV4_DONE;
    }
    mpu9250_chip_show(chip);
    aux_next(chip, slave == 4 ? AUX_NONE : 4);
}

void mpu9250_chip_begin_aux(struct mpu9250_chip *chip) {
    if (chip->aux_bus.is_held) {
        return;  // no START can be made; who waits for the master waits on
    }
    aux_next(chip, 0);
}
