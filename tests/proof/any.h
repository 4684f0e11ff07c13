// SPDX-License-Identifier: MIT
// Values that are unknown to Frama-C: proofs hold for all of them.
#ifndef ANY_H
#define ANY_H

#include <stddef.h>
#include <stdint.h>

extern volatile uint8_t any_byte;
extern volatile uint16_t any_word;
extern volatile uint32_t any_long;

static inline uint8_t any_u8(void) { return any_byte; }
static inline uint16_t any_u16(void) { return any_word; }
static inline uint32_t any_u32(void) { return any_long; }

static inline uint8_t any_up_to(uint8_t most) {
    const uint8_t value = any_byte;
    return value <= most ? value : most;
}

static inline void any_fill(void *to, size_t size) {
    uint8_t *at = to;
    /*@ loop unroll 600; */
    for (size_t i = 0; i < size; i++) {
        at[i] = any_byte;
    }
}

// Reads them, so that none may be beyond its array or without a value.
static inline void any_use(const uint8_t *bytes, uint8_t length) {
    uint8_t sum = 0;
    for (uint8_t i = 0; i < length; i++) {
        sum = (uint8_t)(sum ^ bytes[i]);
    }
    any_byte = sum;
}

static inline void any_u16_use(uint16_t value) { any_word = value; }

#endif
