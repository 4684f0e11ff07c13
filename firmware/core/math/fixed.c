// SPDX-License-Identifier: MIT
// Sizes and shifts in fixed point; see fixed.h for formats and bounds. fixed_mul.c, or
// what a board brings in its place, calls this; fixed_trig.c calls both.
#include "core/math/fixed.h"

uint32_t fixed_magnitude(int32_t value) {
    return value < 0 ? 0u - (uint32_t)value : (uint32_t)value;
}

int32_t fixed_divide(int32_t value, uint8_t divisor) {
    return value / divisor;
}

int32_t fixed_scale_up(int32_t value, uint8_t bits) {
    return (int32_t)((uint32_t)value << bits);
}

int32_t fixed_scale_up_sat(uint32_t value, uint8_t bits) {
    for (; bits > 0; --bits) {
        if (value > (uint32_t)INT32_MAX / 2) {
            return INT32_MAX;
        }
        value *= 2;
    }
    return value > INT32_MAX ? INT32_MAX : (int32_t)value;
}

int32_t fixed_scale_down(int32_t value, uint8_t bits) {
    uint8_t left = (uint8_t)(bits - 1);
    for (; left >= 8; left = (uint8_t)(left - 8)) {  // whole bytes are cheap to shift
        value >>= 8;
    }
    return ((value >> left) + 1) >> 1;
}

uint8_t fixed_leading_zeros(uint32_t x) {
    uint8_t zeros = 0;
    while (x < UINT32_C(0x01000000)) {  // whole bytes first: they are cheap to shift
        x <<= 8;
        zeros = (uint8_t)(zeros + 8);
    }
    while (x < UINT32_C(0x80000000)) {
        x <<= 1;
        ++zeros;
    }
    return zeros;
}
