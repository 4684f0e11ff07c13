// SPDX-License-Identifier: MIT
// fixed_mul.c once more, but a product that leaves 32 bits ends the process: the
// conversion that loses it is not undefined, so no sanitizer would tell.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static int32_t narrow(int64_t value) {
    if (value > INT32_MAX || value < INT32_MIN) {
        fprintf(stderr, "a product leaves 32 bits: %lld\n", (long long)value);
        abort();
    }
    return (int32_t)value;
}

#define NARROW(value) narrow(value)

#include "core/math/fixed_mul.c"
