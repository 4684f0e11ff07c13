// SPDX-License-Identifier: MIT
// The products of fixed.h as in fixed_mul.c, but one that leaves 32 bits ends the
// process: the conversion that loses it is not undefined, so no sanitizer would tell.
#include <stdio.h>
#include <stdlib.h>

#include "fixed.h"

static int32_t narrow(int64_t value) {
    if (value > INT32_MAX || value < INT32_MIN) {
        fprintf(stderr, "a product leaves 32 bits: %lld\n", (long long)value);
        abort();
    }
    return (int32_t)value;
}

int32_t fixed_mul_q30(int32_t a, int32_t b) {
    return narrow(((int64_t)a * b + (INT64_C(1) << 29)) >> 30);
}

int32_t fixed_mul_q32(int32_t a, int32_t b) {
    return narrow(((int64_t)a * b + (INT64_C(1) << 31)) >> 32);
}

uint32_t fixed_umul_q32(uint32_t a, uint32_t b) {
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

int32_t fixed_dot3_q14(const int32_t v[3], const int16_t m[3]) {
    const int64_t sum = (int64_t)v[0] * m[0] + (int64_t)v[1] * m[1] + (int64_t)v[2] * m[2];
    return narrow((sum + (1 << 13)) >> 14);
}
