// SPDX-License-Identifier: MIT
// Uses 5000 bytes of stack, and variables of a known size.
#include "bare.h"

static volatile uint32_t variables[250];

static __attribute__((noinline)) uint32_t deep(uint32_t from) {
    volatile uint8_t bytes[5000];
    for (unsigned i = 0; i < sizeof bytes; i++) {
        bytes[i] = (uint8_t)(from + i);
    }
    return bytes[from % sizeof bytes];
}

void program(void) {
    variables[3] = deep(variables[2]);
    say("done", variables[3]);
}
