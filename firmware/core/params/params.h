// SPDX-License-Identifier: MIT
// What turns raw into pose, and how the probe behaves: the values of the records that
// the firmware works with. What else the records tell stays in memory.
#ifndef PARAMS_H
#define PARAMS_H

#include "core/fusion/pose.h"
#include "core/params/records.h"
#include "core/storage/memory.h"

struct params {
    struct calibration calibration;
    uint8_t button_does;  // enum button_does
    uint8_t reference;    // enum reference
    uint32_t digest;      // CRC-32 of the calibration
#ifndef POSE_WITHOUT_STROKES
    struct pose_tip tip;
#endif
};

enum params_fault {
    PARAMS_FINE = 0,
    PARAMS_WRONG_LENGTH = 1,  // it is too short, or the list ends in it
    PARAMS_OUT_OF_RANGE = 2,  // of a value
    PARAMS_DOUBLED = 3,       // it is there twice
};

// Reads the list of records of `length` bytes that begins at `offset` of a memory;
// without records the calibration is the identity, and the rest zeros. Those that it
// does not know, and parts behind those that it knows, it passes over. Where not all of
// them are fine, `tag` is that of the first record that is not, and `out` is not to be
// used.
enum params_fault params_read(const IN_FLASH struct memory *memory, uint16_t offset,
                              uint8_t length, struct params *out,
                              uint8_t *tag) MUST_CHECK;

#endif
