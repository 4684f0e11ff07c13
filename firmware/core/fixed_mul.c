// SPDX-License-Identifier: MIT
// The products of fixed.h in portable C. A board whose processor lacks a wide multiply
// brings its own file in place of this one, equal to the last bit.
#include "fixed.h"

int32_t fixed_mul_q30(int32_t a, int32_t b) {
    const int64_t product = (int64_t)a * b;
    return (int32_t)((product + (INT64_C(1) << 29)) >> 30);
}

int32_t fixed_mul_q32(int32_t a, int32_t b) {
    const int64_t product = (int64_t)a * b;
    return (int32_t)((product + (INT64_C(1) << 31)) >> 32);
}

uint32_t fixed_umul_q32(uint32_t a, uint32_t b) {
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

int32_t fixed_dot3_q14(const int32_t v[3], const int16_t m[3]) {
    const int64_t sum =
        (int64_t)v[0] * m[0] + (int64_t)v[1] * m[1] + (int64_t)v[2] * m[2];
    return (int32_t)((sum + (1 << 13)) >> 14);
}
