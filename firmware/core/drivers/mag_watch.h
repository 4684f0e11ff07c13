// SPDX-License-Identifier: MIT
// When a sensor does without a magnetometer that answers and does not measure: after
// three set-ups that it has spoiled. It is tried again after pauses that double.
//
// The drivers keep one byte, 0 at the start and after each field: 1, 3, 7 after a
// spoiled set-up, and from 7 on it is left out for as many looks. 14, 30, 62, 126 while
// it is tried again: 15, 31, 63, 127 if that was in vain.
#ifndef MAG_WATCH_H
#define MAG_WATCH_H

#include <stdbool.h>
#include <stdint.h>

enum {
    MAG_SILENT_LOOKS = 5,  // without a field, before the sensor is set up again
    MAG_LEFT_OUT = 7,
    MAG_NEVER = UINT8_MAX,  // it is not tried again
};

static inline bool mag_is_left_out(uint8_t failures) {
    return (failures & MAG_LEFT_OUT) == MAG_LEFT_OUT;
}

static inline uint8_t mag_failed_again(uint8_t failures) {
    return (uint8_t)(failures << 1 | failures | 1) & INT8_MAX;
}

static inline uint8_t mag_tried_again(uint8_t failures) {
    return failures & (uint8_t)~1;
}

#endif
