// SPDX-License-Identifier: MIT
// What ST's sensors share: a die's registers, which of them the host may write, and
// output words between the sensor and the host (block data update, BDU).
#ifndef SIM_CHIPS_SENSOR_ST_H
#define SIM_CHIPS_SENSOR_ST_H

#include "model.h"

enum { REG_COUNT = 128, AXES = 3 };

struct st_die {
    uint8_t reg[REG_COUNT];
    uint8_t pointer;
    bool moves_on;      // the pointer, with each byte
    uint64_t wait_end;  // of a reset or reboot under way; NEVER for none
};

// A register that the host may write: bits that are none and must stay 0, and bits that
// turn something on that is not modelled.
struct st_rule {
    uint8_t reg;
    uint8_t reserved;
    uint8_t unmodelled;
};

// The sub-address: bit 7 has it move on with each byte.
void st_set_pointer(struct st_die *die, uint8_t byte);
void st_step(struct st_die *die);
// Null where a register may not be written.
const struct st_rule *st_find_rule(const struct st_rule *rules, size_t count,
                                   uint8_t reg);
// Writes the register that the pointer is at, as its rule allows; complains of what it
// does not, of a write with no rule (null), and of one within a reset or a reboot, by
// its name. False: no write.
bool st_write(struct sensor_chip *chip, struct st_die *die, const struct st_rule *rule,
              const char *reset, uint8_t value);

// The latest values of a sensor. With BDU, of an output word of which one half has been
// read the other half is yet to be read: the word is not updated until then. `waiting`
// words have a newer value.
struct st_words {
    int16_t latest[AXES];
    uint8_t half_read;
    uint8_t waiting;
};

// A new value for a word: true where it shows at once, false where it waits.
bool st_word_shows(struct st_words *words, int word);
// With BDU: byte `number` of the output has been read. True where a word that waited
// shows now.
bool st_word_waited(struct st_words *words, int number);

// Output and status registers of three axes: in the status, overrun of an axis is its
// "data available", four bits up; bit 3 is of all.
struct st_output {
    uint8_t *out;     // the first of six registers
    uint8_t *status;  // the register
    uint8_t enabled;  // axes; bit 0 is x
    bool has_bdu;
};
enum { ST_DATA_ALL = 1 << 3, ST_OVERRUN_SHIFT = 4 };

// Two registers from `out` on, the low byte first.
void st_put(uint8_t *out, int16_t value);
// A sample has come.
void st_put_sample(struct st_words *words, const struct st_output *output);
// An output byte has been read: number 0 to 5.
void st_release(struct st_words *words, const struct st_output *output, int number);
// BDU changed: nothing is held back, newer values show.
void st_release_all(struct st_words *words, const struct st_output *output);

#endif
