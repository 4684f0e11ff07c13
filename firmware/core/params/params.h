// SPDX-License-Identifier: MIT
// What turns raw into pose, and how the probe behaves: the values of the records that
// the firmware works with. What else the records tell stays in memory.
#ifndef PARAMS_H
#define PARAMS_H

#include "core/fusion/calibrate.h"
#include "core/params/records.h"

struct params {
    struct calibration calibration;
    uint8_t button_does;  // enum button_does
    uint8_t reference;    // enum reference
};

// Where records come from, byte by byte.
struct params_source {
    uint8_t (*read)(const void *context, uint16_t at);
    const void *context;
    uint16_t length;
};

enum params_fault {
    PARAMS_FINE = 0,
    PARAMS_WRONG_LENGTH = 1,  // it is too short, or the list ends in it
    PARAMS_OUT_OF_RANGE = 2,  // of a value
    PARAMS_DOUBLED = 3,       // it is there twice
};

// No records: identity calibration and the defaults.
void params_clear(struct params *out);

// Reads a list of records. Those that it does not know, and parts behind those that it
// knows, it passes over. Writes to `out` only where all of them are fine; otherwise
// `tag` is that of the first record that is not.
enum params_fault params_read(const struct params_source *source, struct params *out,
                              uint8_t *tag) MUST_CHECK;

#endif
