// SPDX-License-Identifier: MIT
// Lot, wafer and place on it differ in a few bits from chip to chip, of which no 64
// have them all: a hash.
#include "identity.h"

#define OFFSET_BASIS UINT64_C(0xCBF29CE484222325)
#define PRIME UINT64_C(0x00000100000001B3)

void identity_fold(const uint32_t words[3], uint8_t id[8]) {
    uint64_t hash = OFFSET_BASIS;
    for (uint8_t i = 0; i < 12; i++) {
        hash ^= (uint8_t)(words[i / 4] >> (8 * (i % 4)));
        hash *= PRIME;
    }
    if (hash == 0) {
        hash = OFFSET_BASIS;
    }
    for (uint8_t i = 0; i < 8; i++) {
        id[i] = (uint8_t)(hash >> (8 * i));
    }
}
