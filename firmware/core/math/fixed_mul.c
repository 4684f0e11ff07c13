// SPDX-License-Identifier: MIT
// The products of fixed.h and quat.h in portable C. A board whose processor lacks a
// wide multiply brings its own file in place of this one, equal to the last bit.
#include "core/math/quat.h"

#ifndef NARROW
#define NARROW(value) ((int32_t)(value))  // tests refuse here what does not fit
#endif

int32_t fixed_mul_q30(int32_t a, int32_t b) {
    const int64_t product = (int64_t)a * b;
    return NARROW((product + (INT64_C(1) << 29)) >> 30);
}

int32_t fixed_mul_q32(int32_t a, int32_t b) {
    const int64_t product = (int64_t)a * b;
    return NARROW((product + (INT64_C(1) << 31)) >> 32);
}

uint32_t fixed_umul_q32(uint32_t a, uint32_t b) {
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

int32_t fixed_dot3_q14(const int32_t v[3], const int16_t m[3]) {
    const int64_t sum =
        (int64_t)v[0] * m[0] + (int64_t)v[1] * m[1] + (int64_t)v[2] * m[2];
    return NARROW((sum + (1 << 13)) >> 14);
}

// A product as sums take it, in 64ths of a step: floored, and without what its bytes
// add whose places add up to less than two. Less than 3 of them short.
static int64_t term(int32_t a, int32_t b) {
    const uint32_t low = (uint32_t)(a & 0xFF) * (uint32_t)(b & 0xFFFF) +
                         (uint32_t)(a & 0xFF00) * (uint32_t)(b & 0xFF);
    return ((int64_t)a * b - low) >> 24;
}

// round(sum / 2^bits)
static int32_t rounded(int64_t sum, uint8_t bits) {
    return NARROW((sum + (1 << (bits - 1))) >> bits);
}

void quat_multiply(const struct quat *a, const struct quat *b, struct quat *out) {
    const int64_t w =
        term(a->w, b->w) - term(a->x, b->x) - term(a->y, b->y) - term(a->z, b->z);
    const int64_t x =
        term(a->w, b->x) + term(a->x, b->w) + term(a->y, b->z) - term(a->z, b->y);
    const int64_t y =
        term(a->w, b->y) + term(a->y, b->w) + term(a->z, b->x) - term(a->x, b->z);
    const int64_t z =
        term(a->w, b->z) + term(a->z, b->w) + term(a->x, b->y) - term(a->y, b->x);
    *out = (struct quat){rounded(w, 6), rounded(x, 6), rounded(y, 6), rounded(z, 6)};
}

void quat_rotate(const struct quat *q, const struct vector *v, struct vector *out) {
    // v + w t + u x t with u the vector part and t = 2 u x v; |t| <= 2 |v| < 2^31.
    const struct vector t = {.x = rounded(term(q->y, v->z) - term(q->z, v->y), 5),
                             .y = rounded(term(q->z, v->x) - term(q->x, v->z), 5),
                             .z = rounded(term(q->x, v->y) - term(q->y, v->x), 5)};
    const int64_t x = term(q->w, t.x) + term(q->y, t.z) - term(q->z, t.y);
    const int64_t y = term(q->w, t.y) + term(q->z, t.x) - term(q->x, t.z);
    const int64_t z = term(q->w, t.z) + term(q->x, t.y) - term(q->y, t.x);
    *out = (struct vector){.x = v->x + rounded(x, 6),
                           .y = v->y + rounded(y, 6),
                           .z = v->z + rounded(z, 6)};
}
