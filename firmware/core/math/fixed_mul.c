// SPDX-License-Identifier: MIT
// Products, limits, ratios and roots, and what is made of them for vectors, quaternions
// and matrices, in portable C. A board whose processor has registers of 8 bits brings
// its own file in place of this one, equal to the last bit.
#include "core/math/matrix.h"

#ifndef NARROW
#define NARROW(value) ((int32_t)(value))  // tests refuse here what does not fit
#endif

int32_t fixed_mul_q30(int32_t a, int32_t b) {
    const int64_t product = (int64_t)a * b;
    return NARROW((product + (INT64_C(1) << 29)) >> 30);
}

int32_t fixed_mul_at(const int32_t *a, const int32_t *b) {
    return fixed_mul_q30(*a, *b);
}

int32_t fixed_square_q30(int32_t a) {
    return fixed_mul_q30(a, a);
}

int32_t fixed_mul_q14(int32_t value, q2_14_t element) {
    return fixed_mul_q30(value, element * INT32_C(65536));
}

void fixed_add_product(int32_t value, q2_14_t element, int32_t *sum) {
    *sum += fixed_mul_q14(value, element);
}

int32_t fixed_times(int32_t value, uint16_t factor) {
    return NARROW((int64_t)value * factor);
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

int32_t fixed_clamp(int32_t value, int32_t limit) {
    return value > limit ? limit : value < -limit ? -limit : value;
}

int32_t fixed_clamp_high(int32_t value, int16_t limit_high) {
    return fixed_clamp(value, limit_high * INT32_C(65536));
}

void fixed_add(int32_t step, int32_t *sum) {
    *sum += step;
}

void fixed_subtract(int32_t step, int32_t *sum) {
    *sum -= step;
}

void fixed_add_clamped(int32_t step, int32_t limit, int32_t *sum) {
    *sum = fixed_clamp(*sum + step, limit);
}

void fixed_add_clamped_high(int32_t step, int16_t limit_high, int32_t *sum) {
    *sum = fixed_clamp_high(*sum + step, limit_high);
}

q2_30_t fixed_ratio(uint32_t numerator, uint32_t denominator) {
    // Long division, a bit a round; remainder < denominator <= 2^31 before each
    // doubling, so that it never leaves 32 bits.
    uint32_t quotient = 0;
    uint32_t remainder = numerator;
    if (remainder >= denominator) {
        remainder -= denominator;
        quotient = 1;
    }
    for (uint8_t bit = 0; bit < 30; ++bit) {
        remainder <<= 1;
        quotient <<= 1;
        if (remainder >= denominator) {
            remainder -= denominator;
            quotient |= 1;
        }
    }
    return (q2_30_t)quotient;
}

q2_30_t fixed_rsqrt(uint32_t x) {
    // A line within 8.7 % on [1/4, 1), then Newton's y(3 - xy^2)/2: the relative error
    // goes 8.7e-2, 1.2e-2, 2e-4, 6e-8. y is q2_30 and at most 2, held below 2^31.
    uint32_t y = UINT32_C(2289217568) - fixed_umul_q32(x, UINT32_C(1306743800));
    for (uint8_t round = 0; round < 3; ++round) {
        if (y > INT32_MAX) {
            y = INT32_MAX;
        }
        const uint32_t y2 = fixed_umul_q32(y, y);  // y^2 / 4 as a fraction of 2^30
        const uint32_t xy2 = fixed_umul_q32(x, y2);
        // (3 - xy^2) / 2 as q2_30: xy2 holds x y^2 in 2^28ths.
        const uint32_t factor = UINT32_C(1610612736) - 2 * xy2;
        y = 4 * fixed_umul_q32(y, factor);
    }
    return y > INT32_MAX ? INT32_MAX : (q2_30_t)y;
}

uint16_t fixed_sqrt(uint32_t x) {
    uint32_t root = 0;
    uint32_t remainder = x;
    uint32_t bit = UINT32_C(1) << 30;
    while (bit > x) {
        bit >>= 2;
    }
    for (; bit != 0; bit >>= 2) {
        if (remainder >= root + bit) {
            remainder -= root + bit;
            root = (root >> 1) + bit;
        } else {
            root >>= 1;
        }
    }
    return (uint16_t)root;
}

int32_t vector_square_q30(const struct vector *v) {
    return vector_dot(v, v);
}

int32_t vector_dot(const struct vector *a, const struct vector *b) {
    int32_t sum = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        sum += fixed_mul_q30(a->axis[axis], b->axis[axis]);
    }
    return sum;
}

uint32_t vector_square_q32(const struct vector *v) {
    uint32_t sum = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const uint32_t size = fixed_magnitude(v->axis[axis]);
        sum += fixed_umul_q32(size, size);
    }
    return sum;
}

void vector_subtract(const struct vector *a, const struct vector *b,
                     struct vector *out) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = a->axis[axis] - b->axis[axis];
    }
}

void vector_scale(const struct vector *v, q2_30_t gain, struct vector *out) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = fixed_mul_q30(v->axis[axis], gain);
    }
}

void vector_clamp(const struct vector *v, int32_t limit, struct vector *out) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = fixed_clamp(v->axis[axis], limit);
    }
}

void vector_cross(const struct vector *a, const struct vector *b, struct vector *out) {
    out->x = fixed_mul_q30(a->y, b->z) - fixed_mul_q30(a->z, b->y);
    out->y = fixed_mul_q30(a->z, b->x) - fixed_mul_q30(a->x, b->z);
    out->z = fixed_mul_q30(a->x, b->y) - fixed_mul_q30(a->y, b->x);
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

// A component as q1_15, 1 and -1 held a step short of them.
static int16_t coarse(q2_30_t value) {
    const int16_t rounded =
        (int16_t)fixed_high_half((uint32_t)value * 2 + UINT32_C(32768));
    if (rounded == INT16_MIN) {
        return value < 0 ? (int16_t)-INT16_MAX : INT16_MAX;
    }
    return rounded;
}

// Twice a b + c d of q1_15 as q2_14. Of a unit quaternion it is at most 2, and modulo 4
// even 2 is enough for what it is taken from.
static q2_14_t twice(int16_t a, int16_t b, int16_t c, int16_t d) {
    const int32_t sum = (int32_t)a * b + (int32_t)c * d;
    return (q2_14_t)fixed_high_half((uint32_t)sum * 2 + UINT32_C(32768));
}

void matrix_from_quat(const struct quat *q, struct matrix *out) {
    enum { ONE = 16384 };
    const int16_t w = coarse(q->w);
    const int16_t x = coarse(q->x);
    const int16_t y = coarse(q->y);
    const int16_t z = coarse(q->z);
    const int16_t minus_w = (int16_t)-w;
    out->row[0][0] = (q2_14_t)(ONE - twice(y, y, z, z));
    out->row[0][1] = twice(x, y, minus_w, z);
    out->row[0][2] = twice(x, z, w, y);
    out->row[1][0] = twice(x, y, w, z);
    out->row[1][1] = (q2_14_t)(ONE - twice(x, x, z, z));
    out->row[1][2] = twice(y, z, minus_w, x);
    out->row[2][0] = twice(x, z, minus_w, y);
    out->row[2][1] = twice(y, z, w, x);
    out->row[2][2] = (q2_14_t)(ONE - twice(x, x, y, y));
}

void matrix_turn(const struct matrix *matrix, const int32_t v[3], int32_t out[3]) {
    const int32_t x = fixed_dot3_q14(v, matrix->row[0]);
    const int32_t y = fixed_dot3_q14(v, matrix->row[1]);
    out[2] = fixed_dot3_q14(v, matrix->row[2]);
    out[1] = y;
    out[0] = x;
}
