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
