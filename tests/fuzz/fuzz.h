// SPDX-License-Identifier: MIT
// What a fuzz target is made of: an input read number by number, and a check that stops
// the program where a sanitizer would.
#ifndef FUZZ_H
#define FUZZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

// One input, whatever it holds; libFuzzer's entry, and replay.c's.
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define CHECK(claim)                                                                   \
    do {                                                                               \
        if (!(claim)) {                                                                \
            fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #claim);        \
            abort();                                                                   \
        }                                                                              \
    } while (false)

struct input {
    const uint8_t *next, *end;
};

// Zeros follow the last byte.
static inline uint8_t input_u8(struct input *input) {
    return input->next < input->end ? *input->next++ : 0;
}

static inline uint16_t input_u16(struct input *input) {
    const uint16_t low = input_u8(input);
    return (uint16_t)(low | (uint16_t)(input_u8(input) << 8));
}

static inline uint32_t input_u32(struct input *input) {
    const uint32_t low = input_u16(input);
    return low | (uint32_t)input_u16(input) << 16;
}

#endif
