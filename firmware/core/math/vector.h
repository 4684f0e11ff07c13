// SPDX-License-Identifier: MIT
// Three numbers of one format, which the name of the variable tells.
#ifndef VECTOR_H
#define VECTOR_H

#include "core/math/fixed.h"

// The components by name, or by number in a loop.
struct vector {
    union {
        struct {
            int32_t x, y, z;
        };
        int32_t axis[3];
    };
};

// |v|^2 / 2^30: a q2_30 vector gives q2_30. Needs the result below 2^31.
int32_t vector_square_q30(const struct vector *v);

// |v|^2 / 2^32, within 3 steps below; fits for every v.
uint32_t vector_square_q32(const struct vector *v);

// Makes v a unit vector, q2_30, within 7e-8. Returns the length that it had, in its
// format, within 7e-8 of it and a step, held at INT32_MAX. A zero vector stays as it
// is, and only its length is 0. No component may be INT32_MIN.
int32_t vector_normalise(struct vector *v);

// v * gain, gain q2_30; v keeps its format. `out` may be v, here and below.
void vector_scale(const struct vector *v, q2_30_t gain, struct vector *out);

// a - b; no component may leave 32 bits.
void vector_subtract(const struct vector *a, const struct vector *b,
                     struct vector *out);

// Each component held within +-limit.
void vector_clamp(const struct vector *v, int32_t limit, struct vector *out);

// True where a component's magnitude is above the limit.
bool vector_exceeds(const struct vector *v, int32_t limit);

// a . b and a x b over 2^30, of vectors the product of whose norms over 2^30 is below
// 2^31. `out` may be neither.
int32_t vector_dot(const struct vector *a, const struct vector *b);
void vector_cross(const struct vector *a, const struct vector *b, struct vector *out);

#endif
