// SPDX-License-Identifier: MIT
// Fixed-point numbers, any in the ranges that fixed.h asks for.
#include "any.h"
#include "core/math/fixed.h"

static int32_t any_i32(void) { return (int32_t)any_u32(); }

static int32_t any_within(int32_t most) {
    const int32_t value = any_i32();
    return value < -most ? -most : value > most ? most : value;
}

void clamps(void) {
    const int32_t limit = any_i32();
    if (limit >= 0) {
        any_long = (uint32_t)fixed_clamp(any_i32(), limit);
        int32_t sum = any_within(INT32_MAX / 2);
        fixed_add_clamped(any_within(INT32_MAX / 2), limit, &sum);
    }
    const int16_t high = (int16_t)any_u16();
    if (high >= 0) {
        any_long = (uint32_t)fixed_clamp_high(any_i32(), high);
        int32_t sum = any_within(INT32_MAX / 2);
        fixed_add_clamped_high(any_within(INT32_MAX / 2), high, &sum);
    }
}

void sums(void) {
    int32_t sum = any_within(INT32_MAX / 2);
    fixed_add(any_within(INT32_MAX / 2), &sum);
    sum = any_within(INT32_MAX / 2);
    fixed_subtract(any_within(INT32_MAX / 2), &sum);
    any_long = turn32_add(any_i32(), any_i32());
}

void halves(void) {
    any_long = (uint32_t)fixed_half_floor(any_i32());
    any_long = (uint32_t)fixed_byte_floor(any_i32());
    any_long = fixed_high_half(any_u32());
    any_long = fixed_magnitude(any_i32());
    const uint8_t divisor = any_u8();
    if (divisor != 0) {
        any_long = (uint32_t)fixed_divide(any_i32(), divisor);
    }
}

void products(void) {
    const int32_t one = Q2_30_ONE;
    any_long = (uint32_t)fixed_mul_q30(any_i32(), any_within(one));
    any_long = (uint32_t)fixed_square_q30(any_within(one));
    any_long = (uint32_t)fixed_mul_q32(any_i32(), any_i32());
    any_long = fixed_umul_q32(any_u32(), any_u32());
    any_long = (uint32_t)fixed_mul_q14(any_within(INT32_MAX / 4), (int16_t)any_u16());
    any_long = (uint32_t)fixed_times(any_within(32767), any_u16());
    int32_t sum = any_within(INT32_MAX / 4);
    fixed_add_product(any_within(INT32_MAX / 16), (int16_t)any_u16(), &sum);
}

void scales(void) {
    //@ loop unroll 32;
    for (uint8_t bits = 1; bits < 32; bits++) {
        const int32_t value = any_i32();
        if (value < INT32_MAX) {
            any_long = (uint32_t)fixed_scale_down(value, bits);
        }
        any_long = (uint32_t)fixed_scale_up_sat(any_u32(), bits);
        any_long = (uint32_t)fixed_scale_up(any_within(INT32_MAX >> bits), bits);
    }
}

void roots(void) {
    const uint32_t x = any_u32();
    any_long = fixed_sqrt(x);
    if (x != 0) {
        any_long = fixed_leading_zeros(x);
    }
    if (x >= UINT32_C(1) << 30) {
        any_long = (uint32_t)fixed_rsqrt(x);
    }
    const int32_t below = any_i32();
    if (below >= 0) {
        any_long = (uint32_t)fixed_exp_neg(below);
    }
    const uint32_t denominator = any_u32();
    if (denominator >= 1 && denominator <= UINT32_C(1) << 31) {
        const uint32_t numerator = any_u32();
        if (numerator / 2 < denominator) {
            any_long = (uint32_t)fixed_ratio(numerator, denominator);
        }
    }
}

void angles(void) {
    q2_30_t sine, cosine;
    fixed_sincos(any_i32(), &sine, &cosine);
    any_long = (uint32_t)sine + (uint32_t)cosine;
    any_long = (uint32_t)fixed_atan2(any_i32(), any_i32());
}
