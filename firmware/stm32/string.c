// SPDX-License-Identifier: MIT
// The four functions that a compiler may call where there is no C library.
#include <stdint.h>
#include <string.h>

// Keeps the compiler from making a loop into a call of the function that it is in.
#define STAY_A_LOOP() __asm__ volatile("")

// A word that may lie anywhere and alias anything: the processor loads and stores it in
// one instruction even where it is not aligned (PM0214, "Address alignment").
typedef uint32_t __attribute__((may_alias, aligned(1))) word_t;

void *memcpy(void *restrict to, const void *restrict from, size_t length) {
    uint8_t *out = to;
    const uint8_t *in = from;
    for (; length >= sizeof(word_t); length -= sizeof(word_t)) {
        *(word_t *)out = *(const word_t *)in;
        out += sizeof(word_t);
        in += sizeof(word_t);
        STAY_A_LOOP();
    }
    for (; length > 0; length--) {
        *out++ = *in++;
        STAY_A_LOOP();
    }
    return to;
}

void *memmove(void *to, const void *from, size_t length) {
    uint8_t *out = to;
    const uint8_t *in = from;
    if ((uintptr_t)out - (uintptr_t)in >= length) {  // the start overlaps nothing
        for (; length > 0; length--) {
            *out++ = *in++;
            STAY_A_LOOP();
        }
    } else {
        for (; length > 0; length--) {
            out[length - 1] = in[length - 1];
            STAY_A_LOOP();
        }
    }
    return to;
}

void *memset(void *to, int value, size_t length) {
    uint8_t *out = to;
    const uint32_t four = (uint8_t)value * UINT32_C(0x01010101);
    for (; length >= sizeof(word_t); length -= sizeof(word_t)) {
        *(word_t *)out = four;
        out += sizeof(word_t);
        STAY_A_LOOP();
    }
    for (; length > 0; length--) {
        *out++ = (uint8_t)value;
        STAY_A_LOOP();
    }
    return to;
}

int memcmp(const void *one, const void *other, size_t length) {
    const uint8_t *left = one;
    const uint8_t *right = other;
    for (; length > 0; length--, left++, right++) {
        if (*left != *right) {
            return *left - *right;
        }
    }
    return 0;
}
