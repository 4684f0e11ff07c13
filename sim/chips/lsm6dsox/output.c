// SPDX-License-Identifier: MIT
// Output and status registers: a sample that arrives, a byte that is read, block data
// update (BDU) between them.
#include "chip.h"

#include <stddef.h>

#define PULSE_NS UINT64_C(75000)  // DS table 34

static const struct place {
    uint8_t reg, flag, words;
} places[SOURCES] = {
    [GYR] = {REG_OUTX_L_G, GDA, AXES},
    [ACC] = {REG_OUTX_L_A, XLDA, AXES},
    [TEMP] = {REG_OUT_TEMP_L, TDA, 1},
};

// The host sees the latest value of a word.
static void show(struct lsm6dsox_chip *chip, enum source source, int word) {
    st_put(&chip->die.reg[places[source].reg + 2 * word],
           chip->sensors[source].words.latest[word], false);
}

void lsm6dsox_chip_take_sample(struct lsm6dsox_chip *chip, enum source source) {
    struct sensor *sensor = &chip->sensors[source];
    sensor->tick += sensor->divider;
    lsm6dsox_chip_set_next_tick(chip, source);
    if (sensor_chip_suffers(&chip->base, CHIP_FAULT_NO_DATA_READY, DIE)) {
        return;
    }
    sensor->samples++;
    if (!sensor_chip_suffers(&chip->base, CHIP_FAULT_FROZEN, DIE)) {
        lsm6dsox_chip_sense(chip, source);
    }
    for (int word = 0; word < places[source].words; word++) {
        if (st_word_shows(&sensor->words, word)) {
            show(chip, source, word);
        }
    }
    chip->die.reg[REG_STATUS] |= places[source].flag;
    // AN 4.3.1: DRDY_MASK keeps the signals away until the filters have settled.
    if (sensor->settling == 0 || (chip->die.reg[REG_CTRL4_C] & DRDY_MASK) == 0) {
        sensor->is_signalled = true;
        if (chip->die.reg[REG_COUNTER_BDR_REG1] & DATAREADY_PULSED) {
            chip->pulse_end = chip->base.wire.now_ns + PULSE_NS;
        }
    }
    if (sensor->settling > 0) {
        sensor->settling--;
    }
}

void lsm6dsox_chip_release(struct lsm6dsox_chip *chip, uint8_t reg) {
    enum source source = TEMP;
    if (reg >= REG_OUTX_L_A) {
        source = ACC;
    } else if (reg >= REG_OUTX_L_G) {
        source = GYR;
    }
    struct sensor *sensor = &chip->sensors[source];
    const int number = reg - places[source].reg;
    if (number & 1) {
        // AN 4.3: reset as the higher part of one of the channels is read.
        chip->die.reg[REG_STATUS] &= (uint8_t)~places[source].flag;
        sensor->is_signalled = false;
    }
    if ((chip->die.reg[REG_CTRL3_C] & BDU) && st_word_waited(&sensor->words, number)) {
        show(chip, source, number / 2);
        chip->die.reg[REG_STATUS] |= places[source].flag;
        sensor->is_signalled = true;
    }
}

void lsm6dsox_chip_release_all(struct lsm6dsox_chip *chip) {
    for (int i = 0; i < SOURCES; i++) {
        struct sensor *sensor = &chip->sensors[i];
        for (int word = 0; word < places[i].words; word++) {
            if (sensor->words.waiting & (1 << word)) {
                show(chip, (enum source)i, word);
            }
        }
        sensor->words.half_read = 0;
        sensor->words.waiting = 0;
    }
}
