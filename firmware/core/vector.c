// SPDX-License-Identifier: MIT
// Norms and products of vectors; see vector.h for formats and bounds.
#include "vector.h"

int32_t vector_square_q30(const struct vector *v) {
    return fixed_mul_q30(v->x, v->x) + fixed_mul_q30(v->y, v->y) +
           fixed_mul_q30(v->z, v->z);
}

uint32_t vector_square_q32(const struct vector *v) {
    const uint32_t x = fixed_magnitude(v->x);
    const uint32_t y = fixed_magnitude(v->y);
    const uint32_t z = fixed_magnitude(v->z);
    return fixed_umul_q32(x, x) + fixed_umul_q32(y, y) + fixed_umul_q32(z, z);
}

bool vector_normalise(const struct vector *v, struct vector *unit, int32_t *norm) {
    const uint32_t bits =
        fixed_magnitude(v->x) | fixed_magnitude(v->y) | fixed_magnitude(v->z);
    if (bits == 0) {
        return false;
    }
    // Scaled up so that the largest component is in [2^30, 2^31): s = |v|^2 / 2^32 is
    // then in [2^28, 3 * 2^30), and `fraction`, s or 4 s, in [2^30, 2^32).
    const uint8_t up = (uint8_t)(fixed_leading_zeros(bits) - 1);
    const struct vector scaled = {fixed_scale_up(v->x, up), fixed_scale_up(v->y, up),
                                  fixed_scale_up(v->z, up)};
    const uint32_t s = vector_square_q32(&scaled);
    const bool is_low = s < UINT32_C(0x40000000);
    const uint32_t fraction = is_low ? s * 4 : s;
    const q2_30_t inverse = fixed_rsqrt(fraction);
    // v / |v| = v / 2^32 / sqrt(s / 2^32), and sqrt(fraction) is 2 sqrt(s) where low.
    unit->x = fixed_mul_q32(scaled.x, inverse);
    unit->y = fixed_mul_q32(scaled.y, inverse);
    unit->z = fixed_mul_q32(scaled.z, inverse);
    if (is_low) {
        unit->x *= 2;
        unit->y *= 2;
        unit->z *= 2;
    }
    // |v| = 2^32 sqrt(s / 2^32), here as a quarter of it, or half where low.
    const uint32_t length = fixed_umul_q32(fraction, (uint32_t)inverse);
    const uint8_t quarter = is_low ? 1 : 2;
    if (up > quarter) {
        *norm = fixed_scale_down((int32_t)length, (uint8_t)(up - quarter));
    } else {
        *norm = fixed_scale_up_sat(length, (uint8_t)(quarter - up));
    }
    return true;
}

void vector_scale(const struct vector *v, q2_30_t gain, struct vector *out) {
    out->x = fixed_mul_q30(v->x, gain);
    out->y = fixed_mul_q30(v->y, gain);
    out->z = fixed_mul_q30(v->z, gain);
}

void vector_subtract(const struct vector *a, const struct vector *b,
                     struct vector *out) {
    out->x = a->x - b->x;
    out->y = a->y - b->y;
    out->z = a->z - b->z;
}

void vector_clamp(const struct vector *v, int32_t limit, struct vector *out) {
    out->x = fixed_clamp(v->x, limit);
    out->y = fixed_clamp(v->y, limit);
    out->z = fixed_clamp(v->z, limit);
}

bool vector_exceeds(const struct vector *v, int32_t limit) {
    return fixed_magnitude(v->x) > (uint32_t)limit ||
           fixed_magnitude(v->y) > (uint32_t)limit ||
           fixed_magnitude(v->z) > (uint32_t)limit;
}
