// SPDX-License-Identifier: MIT
// Lot, wafer and place on it differ in a few bits from chip to chip, of which no 64
// have them all: a hash.
#include "generic/identity.h"

#define OFFSET_BASIS UINT64_C(0xCBF29CE484222325)
#define PRIME UINT64_C(0x00000100000001B3)

void identity_fold(const uint8_t *chip_id, uint8_t length, uint8_t id[8]) {
    uint64_t hash = OFFSET_BASIS;
    for (uint8_t i = 0; i < length; i++) {
        hash ^= chip_id[i];
        hash *= PRIME;
    }
    if (hash == 0) {
        hash = OFFSET_BASIS;
    }
    for (uint8_t i = 0; i < 8; i++) {
        id[i] = (uint8_t)(hash >> (8 * i));
    }
}
