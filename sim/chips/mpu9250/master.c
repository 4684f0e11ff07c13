// SPDX-License-Identifier: MIT
// The chip's own I2C master: its slaves 0 to 4, which are the AK8963 or absent.
#include "chip.h"

// RM 4.12: 8 MHz over 23..31 for 0..8, over 16..22 for 9..15.
static uint64_t aux_bits_ns(const struct mpu9250_chip *chip, unsigned bits) {
    const unsigned choice = chip->reg[REG_I2C_MST_CTRL] & MST_CLOCK;
    const unsigned divider = choice < 9 ? 23 + choice : 7 + choice;
    return (uint64_t)bits * divider * 125;
}

// SLV4 has a register more than the others.
static uint8_t aux_control(const struct mpu9250_chip *chip, unsigned slave) {
    return chip
        ->reg[slave == 4 ? REG_I2C_SLV4_CTRL : REG_I2C_SLV0_ADDR + 3 * slave + 2];
}

// RM 4.25: space goes in the order of the slaves, and a slave that is disabled keeps
// its space until all are, or the master is reset.
static void aux_allocate(struct mpu9250_chip *chip) {
    bool any = false;
    for (unsigned slave = 0; slave < 4; slave++) {
        any = any || (aux_control(chip, slave) & SLV_EN) != 0;
    }
    for (unsigned slave = 0; slave < 4; slave++) {
        const uint8_t control = aux_control(chip, slave);
        const bool reads = (chip->reg[REG_I2C_SLV0_ADDR + 3 * slave] & SLV_READ) != 0;
        if (!any) {
            chip->aux.reserved[slave] = 0;
        } else if ((control & SLV_EN) && reads) {
            chip->aux.reserved[slave] = control & SLV_LENG;
        }
    }
}

void mpu9250_chip_finish_aux(struct mpu9250_chip *chip) {
    chip->aux.slave = 5;
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
    if (aux->byte_ns == NEVER || aux->slave > 4 || aux->is_refused ||
        (chip->reg[REG_I2C_SLV0_ADDR + 3 * aux->slave] & SLV_READ) == 0) {
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

// The first slave from this one on that has a transaction to make in this round; 5:
// none. DELAY_CTRL lets some wait (RM 4.30).
static unsigned aux_choose(const struct mpu9250_chip *chip, unsigned slave) {
    for (; slave <= 4; slave++) {
        const uint8_t control = aux_control(chip, slave);
        const bool is_delayed = (chip->reg[REG_I2C_MST_DELAY_CTRL] & (1 << slave)) != 0;
        if ((control & SLV_EN) && (slave == 4 || (control & SLV_LENG) > 0) &&
            (!is_delayed || chip->aux.delay_count == 0)) {
            break;
        }
    }
    return slave;
}

// Starts the transaction of this slave or of a later one, or ends the round.
static void aux_next(struct mpu9250_chip *chip, unsigned slave) {
    struct aux *aux = &chip->aux;
    const bool is_on = (chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) != 0;
    slave = is_on ? aux_choose(chip, slave) : 5;
    if (slave > 4) {
        mpu9250_chip_finish_aux(chip);
        return;
    }
    const uint8_t control = aux_control(chip, slave);
    const uint8_t address = chip->reg[REG_I2C_SLV0_ADDR + 3 * slave];
    const uint8_t reg = chip->reg[REG_I2C_SLV0_ADDR + 3 * slave + 1];
    aux->slave = (uint8_t)slave;
    aux->length = slave == 4 ? 1 : control & SLV_LENG;
    aux->at = 0;
    aux->base = 0;
    for (unsigned i = 0; i < slave && i < 4; i++) {
        aux->base = (uint8_t)(aux->base + aux->reserved[i]);
    }
    aux->is_refused = (address & 0x7F) != AK_ADDRESS || !mpu9250_chip_has_ak8963(chip);
    const bool has_reg = (control & SLV_REG_DIS) == 0;
    if (has_reg && !aux->is_refused) {
        chip->ak.pointer = reg;
    }
    // START and address, register, and for a read a second START and address.
    unsigned bits = 1 + 9 + (has_reg ? 9 : 0);
    if (aux->is_refused) {
        bits = 1 + 9 + 1;
    } else {
        bits += (address & SLV_READ) && has_reg ? 1 + 9 : 0;
        bits += 9;
    }
    aux->byte_ns = chip->base.wire.now_ns + aux_bits_ns(chip, bits);
}

static void aux_put(struct mpu9250_chip *chip, unsigned index, uint8_t value) {
    if (index < sizeof chip->aux.held) {  // RM 4.25: beyond 24 bytes are lost
        chip->aux.held[index] = value;
        if (!(chip->reg[REG_I2C_MST_DELAY_CTRL] & DELAY_ES_SHADOW)) {
            chip->inner[REG_EXT_SENS_DATA_00 + index] = value;
        }
    }
}

// A byte read by slaves 0 to 3 finds its place.
static void aux_place(struct mpu9250_chip *chip, uint8_t reg, uint8_t value) {
    const struct aux *aux = &chip->aux;
    const uint8_t control = aux_control(chip, aux->slave);
    unsigned index = aux->base + aux->at;
    if (control & SLV_BYTE_SW) {
        // RM 4.13: the two bytes of a word change places; GRP says whether a word
        // starts at an even or an odd register.
        const bool is_first = ((reg & 1) != 0) == ((control & SLV_GRP) != 0);
        if (is_first && aux->at + 1 < aux->length) {
            index++;
        } else if (!is_first && aux->at > 0) {
            index--;
        }
    }
    aux_put(chip, index, value);
}

void mpu9250_chip_move_aux_byte(struct mpu9250_chip *chip) {
    struct aux *aux = &chip->aux;
    const unsigned slave = aux->slave;
    const uint8_t address = chip->reg[REG_I2C_SLV0_ADDR + 3 * slave];
    const bool is_read = (address & SLV_READ) != 0;
    if (aux->is_refused) {
        chip->reg[REG_I2C_MST_STATUS] |= (uint8_t)(1 << slave);
    } else if (!is_read) {
        mpu9250_chip_write_ak8963(chip, slave == 4
                                            ? chip->reg[REG_I2C_SLV4_DO]
                                            : chip->reg[REG_I2C_SLV0_DO + slave]);
    } else {
        const uint8_t reg = chip->ak.pointer;
        const uint8_t value = mpu9250_chip_read_ak8963(chip);
        if (slave == 4) {
            chip->reg[REG_I2C_SLV4_DI] = value;
        } else {
            aux_place(chip, reg, value);
        }
    }
    aux->at++;
    if (!aux->is_refused && aux->at < aux->length) {
        aux->byte_ns = chip->base.wire.now_ns + aux_bits_ns(chip, 9);
        return;
    }
    if (slave == 4) {
        chip->reg[REG_I2C_SLV4_CTRL] &= (uint8_t)~SLV_EN;  // RM 4.17
        chip->reg[REG_I2C_MST_STATUS] |= STATUS_SLV4_DONE;
    } else if (is_read && !aux->is_refused) {
        for (unsigned i = aux->base; i < aux->base + aux->length && i < 24U; i++) {
            chip->inner[REG_EXT_SENS_DATA_00 + i] = aux->held[i];
        }
    }
    mpu9250_chip_show(chip);
    aux_next(chip, slave + 1);
}

void mpu9250_chip_begin_aux(struct mpu9250_chip *chip) {
    struct aux *aux = &chip->aux;
    const uint8_t delay = chip->reg[REG_I2C_SLV4_CTRL] & SLV4_DELAY;
    aux->delay_count = aux->delay_count >= delay ? 0 : (uint8_t)(aux->delay_count + 1);
    aux_allocate(chip);
    if (chip->aux_bus.is_held) {
        return;  // no START can be made; who waits for the master waits on
    }
    aux_next(chip, 0);
}
