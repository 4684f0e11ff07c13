// SPDX-License-Identifier: MIT
// The products of fixed.h as in fixed_mul.c, but one that leaves 32 bits ends the
// process: the conversion that loses it is not undefined, so no sanitizer would tell.
#include <stdio.h>
#include <stdlib.h>

#include "fixed.h"

static int32_t narrow(int64_t value, int32_t a, int32_t b) {
    if (value > INT32_MAX || value < INT32_MIN) {
        fprintf(stderr, "the product of %ld and %ld leaves 32 bits\n", (long)a, (long)b);
        abort();
    }
    return (int32_t)value;
}

int32_t fixed_mul_q30(int32_t a, int32_t b) {
    return narrow(((int64_t)a * b + (INT64_C(1) << 29)) >> 30, a, b);
}

int32_t fixed_mul_q32(int32_t a, int32_t b) {
    return narrow(((int64_t)a * b + (INT64_C(1) << 31)) >> 32, a, b);
}

uint32_t fixed_umul_q32(uint32_t a, uint32_t b) {
    return (uint32_t)(((uint64_t)a * b) >> 32);
}
