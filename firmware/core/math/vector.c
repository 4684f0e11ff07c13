// SPDX-License-Identifier: MIT
// Norms and products of vectors; see vector.h for formats and bounds. Loops over
// the axes take a third of the AVR's flash that x, y and z one by one would.
#include "core/math/vector.h"

_Static_assert(sizeof(struct vector) == 3 * sizeof(int32_t),
               "x, y, z and the axes are the same bytes");

int32_t vector_normalise(struct vector *v) {
    uint32_t bits = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        bits |= fixed_magnitude(v->axis[axis]);
    }
    if (bits == 0) {
        return 0;
    }
    // Scaled up so that the largest component is in [2^30, 2^31): s = |v|^2 / 2^32 is
    // then in [2^28, 3 * 2^30), and `fraction`, s or 4 s, in [2^30, 2^32).
    int16_t up = (int16_t)(fixed_leading_zeros(bits) - 1);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        v->axis[axis] = fixed_scale_up(v->axis[axis], (uint8_t)up);
    }
    uint32_t fraction = vector_square_q32(v);
    const bool is_low = fraction < UINT32_C(0x40000000);
    if (is_low) {
        fraction = (uint32_t)fixed_scale_up((int32_t)fraction, 2);
        ++up;
    }
    // v / |v| = v / 2^32 / sqrt(s / 2^32), and sqrt(fraction) is 2 sqrt(s) where low.
    const q2_30_t inverse = fixed_rsqrt(fraction);
    q2_30_t gain = fixed_half_floor(inverse);
    if (!is_low) {
        gain = fixed_half_floor(gain);
    }
    vector_scale(v, gain, v);
    // |v| = 2^32 sqrt(s / 2^32), here as a quarter of it at its scale.
    const uint32_t length = fixed_umul_q32(fraction, (uint32_t)inverse);
    return up > 2 ? fixed_scale_down((int32_t)length, (uint8_t)(up - 2))
                  : fixed_scale_up_sat(length, (uint8_t)(2 - up));
}

bool vector_exceeds(const struct vector *v, int32_t limit) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        if (fixed_magnitude(v->axis[axis]) > (uint32_t)limit) {
            return true;
        }
    }
    return false;
}
