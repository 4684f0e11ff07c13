// SPDX-License-Identifier: MIT
// See st.h. AN3308 (LIS3DH) says most about status and data-ready of these blocks.
#include "st.h"

#include <stdio.h>

// Registers

void st_set_pointer(struct st_die *die, uint8_t byte) {
    die->pointer = byte & (REG_COUNT - 1);
    die->moves_on = (byte & 0x80) != 0;
}

void st_step(struct st_die *die) {
    if (die->moves_on) {
        die->pointer = (die->pointer + 1) & (REG_COUNT - 1);
    }
}

const struct st_rule *st_find_rule(const struct st_rule *rules, size_t count,
                                   uint8_t reg) {
    for (size_t i = 0; i < count; i++) {
        if (rules[i].reg == reg) {
            return &rules[i];
        }
    }
    return NULL;
}

bool st_write(struct sensor_chip *chip, struct st_die *die, const struct st_rule *rule,
              const char *reset, uint8_t value) {
    if (die->wait_end != NEVER) {  // the documents don't define this
        char what[48];
        (void)snprintf(what, sizeof what, "a register written during a %s", reset);
        sensor_chip_complain(chip, what);
    }
    if (rule == NULL) {
        sensor_chip_complain(
            chip, "a register written that is reserved, read-only or not modelled");
        return false;
    }
    if (value & rule->reserved) {
        sensor_chip_complain(chip, "a reserved bit set");
    }
    if (value & rule->unmodelled) {
        sensor_chip_complain(chip, "something turned on that is not modelled");
    }
    die->reg[die->pointer] = value & (uint8_t)~rule->reserved;
    return true;
}

// Words

bool st_word_shows(struct st_words *words, int word) {
    const bool is_held = (words->half_read & (0x03 << (2 * word))) != 0;
    if (is_held) {
        words->waiting |= (uint8_t)(1 << word);
    }
    return !is_held;
}

bool st_word_waited(struct st_words *words, int number) {
    const int word = number / 2;
    const uint8_t bit = (uint8_t)(1 << word);
    const uint8_t halves = (uint8_t)(0x03 << (2 * word));
    words->half_read |= (uint8_t)(1 << number);
    if ((words->half_read & halves) != halves) {
        return false;
    }
    words->half_read &= (uint8_t)~halves;
    const bool has_waited = (words->waiting & bit) != 0;
    words->waiting &= (uint8_t)~bit;
    return has_waited;
}

// Output and status

void st_put(uint8_t *out, int16_t value) {
    out[0] = (uint8_t)((uint16_t)value & 0xFF);
    out[1] = (uint8_t)((uint16_t)value >> 8);
}

// The host sees the latest value of an axis.
static void show(const struct st_words *words, const struct st_output *output,
                 int axis) {
    st_put(output->out + 2 * axis, words->latest[axis]);
}

// A new value replaces an unread one, and is flagged.
static void flag(uint8_t *status, uint8_t bits) {
    const uint8_t lost = *status & bits;
    *status |= (uint8_t)(bits | (lost << ST_OVERRUN_SHIFT));
}

static void put_axis(struct st_words *words, const struct st_output *output, int axis) {
    const uint8_t bit = (uint8_t)(1 << axis);
    const bool has_waited = (words->waiting & bit) != 0;
    if (st_word_shows(words, axis)) {
        show(words, output, axis);
        flag(output->status, bit);
    } else if (has_waited) {
        *output->status |= (uint8_t)(bit << ST_OVERRUN_SHIFT);  // one more behind it
    }
}

void st_put_sample(struct st_words *words, const struct st_output *output) {
    for (int axis = 0; axis < AXES; axis++) {
        if (output->enabled & (1 << axis)) {
            put_axis(words, output, axis);
        }
    }
    // Where an axis is held back, nothing of the set was overwritten.
    if (words->waiting) {
        *output->status |= ST_DATA_ALL;
    } else {
        flag(output->status, ST_DATA_ALL);
    }
}

void st_release(struct st_words *words, const struct st_output *output, int number) {
    uint8_t *status = output->status;
    const int axis = number / 2;
    const uint8_t bit = (uint8_t)(1 << axis);
    if (number & 1) {
        // AN3308: the flags of an axis go as its high byte is read, those of all as it
        // was the last one.
        *status &= (uint8_t) ~(bit | (bit << ST_OVERRUN_SHIFT));
        if (!(*status & output->enabled)) {
            *status &= (uint8_t) ~(ST_DATA_ALL | (ST_DATA_ALL << ST_OVERRUN_SHIFT));
        }
    }
    if (output->has_bdu && st_word_waited(words, number)) {
        show(words, output, axis);
        *status |= bit | ST_DATA_ALL;
    }
}

void st_release_all(struct st_words *words, const struct st_output *output) {
    for (int axis = 0; axis < AXES; axis++) {
        if (words->waiting & (1 << axis)) {
            show(words, output, axis);
        }
    }
    words->half_read = 0;
    words->waiting = 0;
}
