// SPDX-License-Identifier: MIT
// A chip of ST that is one part of a sensor in several: found at one of its addresses,
// reset, tested and set up by its table, a row each call. What the chips have in
// common: registers of a byte, three axes little-endian, a status that shows which data
// are new, WHO_AM_I at 0x0F.
//
// With PART_WITHOUT_SELF_TEST, for a board that has no room for it, nothing is tested,
// and there is one kind of module.
#ifndef PART_H
#define PART_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/sensor.h"

enum {
    PART_WHO_AM_I = 0x0F,
    PART_TEST_SAMPLES = 5,  // that ST's examples take the mean of
    PART_WHO_NOBODY = 0,    // nothing has answered
    PART_KEPT_MAX = 13,     // registers that part_verify() reads at once
};

// A row is a register with the value to write, or one of these.
struct part_row {
    uint8_t what;
    uint8_t value;
};

enum {
    PART_WAIT = 0x80,  // the value: ticks of 1.024 ms
    PART_FIND,         // tries the addresses, and takes what has the name
    PART_AWAIT_RESET,  // until these bits of the reset register are clear
    // Skips so many rows where the chip has been tested before.
    PART_SKIP_IF_TESTED,
    PART_SAMPLE_PLAIN,       // of these axes (their number), without the stimulus
    PART_SAMPLE_STIMULATED,  // and with it
    PART_FORCE,              // the row before it has read about 1 g, or is done again
    PART_JUDGE,              // notes how these axes answered
    PART_CONFIGURE,
    PART_VERIFY,
    PART_AWAIT_DATA,  // of all axes; the value: ticks at most
    PART_DONE,
};

// Three axes of a chip, and how they answer to its stimulus.
struct part_axes {
    uint8_t ready;  // bits of the status
#ifndef PART_WITHOUT_SELF_TEST
    uint8_t reg;   // six bytes from it on
    uint8_t flag;  // SELF_TEST_..._PASSED
    // Counts: how far readings may differ while it lies still; of each axis' answer,
    // its size at least and at most.
    uint16_t moving;
    uint16_t least[3];
    uint16_t most[3];
#endif
};

// The properties of a kind of chip.
struct part_chip {
    uint8_t addresses[2];
    uint8_t kinds_count;
    // A row for each identity (WHO_AM_I, in who_am_i[0]) with these registers. The
    // first is taken for it before it answers.
    const IN_FLASH struct sensor_identity *kinds;
    uint8_t increment;  // in a register's number, to move on with each byte
    uint8_t status;     // register
    uint8_t reset;      // register
    // Registers that keep these values in operation. WHO_AM_I may be among them.
    uint8_t kept;
    uint8_t kept_count;
    const IN_FLASH uint8_t *kept_values;
    const IN_FLASH struct part_axes *axes;
    uint8_t axes_count;
#ifndef PART_WITHOUT_SELF_TEST
    struct part_row kept_apart;  // a register elsewhere; number 0: none
    uint16_t gravity_counts;     // of 1 g, in PART_FORCE
#endif
    const IN_FLASH struct part_row *rows;
};

// Starts zeroed, but for `chip`. Private to the driver.
struct part {
    const IN_FLASH struct part_chip *chip;
    uint8_t verdicts;  // flags self_test of the protocol
    // A new set-up forgets all but these.
    const IN_FLASH struct sensor_identity *kind;  // the first, until it is found
    uint8_t address;
    uint8_t who_am_i;  // PART_WHO_NOBODY, or the chip's answer
    uint8_t wrong_register;
    uint8_t step;   // of the rows
    uint8_t count;  // within the row
    uint8_t tries;
    uint8_t wait;    // ticks
    uint16_t since;  // start of the current wait, ticks
    bool is_found;
#ifndef PART_WITHOUT_SELF_TEST
    bool is_apart_next;  // of part_verify()
    bool is_moving;
    struct part_sum {
        int32_t sum;
        int16_t first;  // of a run
    } sums[3];
#endif
};

// Starts set-up over; the verdicts of its self-test are kept.
void part_begin(struct part *part);

// One row, one or two transactions; as sensor_driver's. Failures are tried again by
// part_begin(). Every wait is bounded.
enum sensor_result part_setup(struct part *part, const IN_FLASH struct bus_device *bus,
                              uint32_t now_us) MUST_CHECK;

// Reads back the registers that are kept, in one transaction; one that is kept apart in
// every second call. SENSOR_UNSET: `wrong_register` is not as it was written.
enum sensor_result part_verify(struct part *part,
                               const IN_FLASH struct bus_device *bus) MUST_CHECK;

// Asks who is at an address. SENSOR_OK: a chip of this kind is.
enum sensor_result part_ask(struct part *part, const IN_FLASH struct bus_device *bus,
                            uint8_t place) MUST_CHECK;

// The row of an identity; null: of none of the chip's kinds.
const IN_FLASH struct sensor_identity *part_kind(const IN_FLASH struct part_chip *chip,
                                                 uint8_t who);

// Reads consecutive registers.
enum sensor_result part_read(const struct part *part,
                             const IN_FLASH struct bus_device *bus, uint8_t reg,
                             uint8_t *data, uint8_t length) MUST_CHECK;

// Two bytes, the lower one first.
static inline int16_t part_word(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[1] * 256u + bytes[0]);
}

#endif
