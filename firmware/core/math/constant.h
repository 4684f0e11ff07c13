// SPDX-License-Identifier: MIT
// Fixed-point constants, written as the numbers that they are: Q30(0.35) is 0.35 as
// q2_30, rounded to nearest. The compiler computes them; no float is left in the image.
//
// The same bits on every compiler: on the AVR a double has 24 bits, so a number is
// first taken as six decimal digits, which those are enough for, and the rest is
// integers. What has more digits is rounded to six. Needs 0 <= value < 1e6 and a result
// below 2^62; a number below 1e-8 keeps fewer digits.
#ifndef CONSTANT_H
#define CONSTANT_H

#include <stdint.h>

// The power of ten that makes six digits before the point of it.
#define Q_TENS(value)                                                                  \
    ((value) >= 1e5    ? INT64_C(1)                                                    \
     : (value) >= 1e4  ? INT64_C(10)                                                   \
     : (value) >= 1e3  ? INT64_C(100)                                                  \
     : (value) >= 1e2  ? INT64_C(1000)                                                 \
     : (value) >= 1e1  ? INT64_C(10000)                                                \
     : (value) >= 1e0  ? INT64_C(100000)                                               \
     : (value) >= 1e-1 ? INT64_C(1000000)                                              \
     : (value) >= 1e-2 ? INT64_C(10000000)                                             \
     : (value) >= 1e-3 ? INT64_C(100000000)                                            \
     : (value) >= 1e-4 ? INT64_C(1000000000)                                           \
     : (value) >= 1e-5 ? INT64_C(10000000000)                                          \
     : (value) >= 1e-6 ? INT64_C(100000000000)                                         \
     : (value) >= 1e-7 ? INT64_C(1000000000000)                                        \
                       : INT64_C(10000000000000))

// The digits of `value`; a constant may be a float if the compiler's options say so.
#define Q_REAL __typeof__(1.0)
#define Q_DIGITS(value) ((int64_t)(2 * ((value) * (Q_REAL)Q_TENS(value)) + 1) / 2)

// round(value * 2^bits)
#define Q_OF(value, bits)                                                              \
    ((Q_DIGITS(value) * (INT64_C(1) << (bits)) + Q_TENS(value) / 2) / Q_TENS(value))

// round(value * factor * 2^bits), of a factor as an integer with more bits than that.
#define Q_TIMES(value, bits, factor, factor_bits)                                      \
    ((Q_DIGITS(value) * (factor) / Q_TENS(value) +                                     \
      (INT64_C(1) << ((factor_bits) - (bits)-1))) >>                                   \
     ((factor_bits) - (bits)))

#define GRAVITY_M_S2 9.80665  // standard gravity

#define SQUARE(value) ((value) * (value))
#define ROUNDED(value) ((int32_t)Q_OF(value, 0))
#define Q13(value) ((int32_t)Q_OF(value, 13))
#define Q14(value) ((int32_t)Q_OF(value, 14))
#define Q15(value) ((int32_t)Q_OF(value, 15))
#define Q16(value) ((int32_t)Q_OF(value, 16))
#define Q17(value) ((int32_t)Q_OF(value, 17))
#define Q18(value) ((int32_t)Q_OF(value, 18))
#define Q19(value) ((int32_t)Q_OF(value, 19))
#define Q21(value) ((int32_t)Q_OF(value, 21))
#define Q25(value) ((int32_t)Q_OF(value, 25))
#define Q30(value) ((int32_t)Q_OF(value, 30))
#define Q35(value) ((int32_t)Q_OF(value, 35))
#define Q32_UNSIGNED(value) ((uint32_t)Q_OF(value, 32))

// Degrees (or deg/s) as radians and the other way round, and the same of squares. The
// factors: pi / 180 as 2^-44ths, its square as 2^-50ths, 180 / pi as 2^-32ths, its
// square as 2^-26ths.
#define Q_RAD(degrees, bits)                                                           \
    ((int32_t)Q_TIMES(degrees, bits, INT64_C(307041569098), 44))
#define Q_RAD2(square, bits) ((int32_t)Q_TIMES(square, bits, INT64_C(342968724560), 50))
#define Q_DEG(radians, bits)                                                           \
    ((int32_t)Q_TIMES(radians, bits, INT64_C(246083499208), 32))
#define Q_DEG2(square, bits) ((int32_t)Q_TIMES(square, bits, INT64_C(220305404881), 26))

#endif
