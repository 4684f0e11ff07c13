// SPDX-License-Identifier: MIT
// Fixed-point numbers: every multiplication, shift, rounding and saturation of them.
//
// qM_N_t has M integer bits, the sign included, and N fraction bits.
//
// | type      | range        | LSB           | used for                               |
// |-----------|--------------|---------------|----------------------------------------|
// | q2_30_t   | +-2          | 9.3e-10       | unit vectors, quaternions, rotation a  |
// |           |              |               | step in rad, gains, variances in rad2  |
// | q7_25_t   | +-64 rad/s   | 3.0e-8 rad/s  | angular rate                           |
// | q11_21_t  | +-1024 m/s2  | 4.8e-7 m/s2   | specific force                         |
// | q14_18_t  | +-8192       | 3.8e-6        | magnetic field in uT, (rad/s)^2        |
// | q18_14_t  | +-131072     | 6.1e-5        | sensor counts, less their bias or not  |
// | q2_14_t   | +-2          | 6.1e-5        | elements of calibration matrices       |
// | q13_19_t  | +-4096       | 1.9e-6        | covariance of fields, uT2              |
// | q11_21_t  | +-1024       | 4.8e-7        | covariance of bias, scales and heading |
// | turn32_t  | +-half turn  | 1.5e-9 rad    | angles that wrap where they overflow   |
//
// Products round to nearest, ties towards +infinity; `_floor` says otherwise.
#ifndef FIXED_H
#define FIXED_H

#include <stdbool.h>
#include <stdint.h>

_Static_assert((-1 >> 1) == -1, "right shifts of negatives must be arithmetic");

typedef int32_t q2_30_t;
typedef int32_t q7_25_t;
typedef int32_t q11_21_t;
typedef int32_t q14_18_t;
typedef int32_t q18_14_t;
typedef int16_t q2_14_t;
typedef int32_t q13_19_t;
typedef int32_t turn32_t;

#define Q2_30_ONE INT32_C(1073741824)

// round(a * b / 2^30). Keeps the format of one factor where the other is q2_30.
// The product over 2^30 must fit 32 bits.
int32_t fixed_mul_q30(int32_t a, int32_t b);

// The same of numbers in memory, which takes less of the AVR's flash.
int32_t fixed_mul_at(const int32_t *a, const int32_t *b);

// The same of a number and itself.
int32_t fixed_square_q30(int32_t a);

// round(value * element / 2^14): keeps the format of `value`.
int32_t fixed_mul_q14(int32_t value, q2_14_t element);

// *sum += fixed_mul_q14(value, element); the sum must fit. Zeros cost little.
void fixed_add_product(int32_t value, q2_14_t element, int32_t *sum);

// round(a * b / 2^32); always fits.
int32_t fixed_mul_q32(int32_t a, int32_t b);

// round((v0 m0 + v1 m1 + v2 m2) / 2^14): a row of a q2_14 matrix times a vector. The
// result must fit 32 bits.
int32_t fixed_dot3_q14(const int32_t v[3], const int16_t m[3]);

// The high word of the unsigned product, floored.
uint32_t fixed_umul_q32(uint32_t a, uint32_t b);

// `value`, held within +-limit.
int32_t fixed_clamp(int32_t value, int32_t limit);

// The same of a limit whose lower half is 0: FIXED_HIGH(limit) is what the AVR loads.
int32_t fixed_clamp_high(int32_t value, int16_t limit_high);

// The upper half of a positive constant, whose lower half must be 0, as a test checks:
// what Q30() and the like make is too much for a static assertion.
#define FIXED_HIGH(constant) ((int16_t)((constant) / 65536))

// *sum += step; the sum must fit. A call takes less of the AVR's flash than a sum of 32
// bits in memory, the least where `step` is what a function returned.
void fixed_add(int32_t step, int32_t *sum);

// *sum -= step.
void fixed_subtract(int32_t step, int32_t *sum);

// fixed_add(), and the sum held within +-limit.
void fixed_add_clamped(int32_t step, int32_t limit, int32_t *sum);
void fixed_add_clamped_high(int32_t step, int16_t limit_high, int32_t *sum);

// value * factor; the result must fit.
int32_t fixed_times(int32_t value, uint16_t factor);

// value / divisor, rounded towards zero; divisor is not 0.
int32_t fixed_divide(int32_t value, uint8_t divisor);

// |value|; the most negative number gives 2^31.
uint32_t fixed_magnitude(int32_t value);

// value * 2^bits; the result must fit.
int32_t fixed_scale_up(int32_t value, uint8_t bits);

// value * 2^bits, held at INT32_MAX.
int32_t fixed_scale_up_sat(uint32_t value, uint8_t bits);

// round(value / 2^bits), bits 1 to 31; of one bit, value must be below INT32_MAX.
int32_t fixed_scale_down(int32_t value, uint8_t bits);

// The upper 16 of 32 bits.
static inline uint16_t fixed_high_half(uint32_t value) {
    return (uint16_t)(value >> 16);
}

// value / 2, rounded down: exact where one bit of headroom is wanted.
static inline int32_t fixed_half_floor(int32_t value) {
    return value >> 1;
}

// value / 256, rounded down: moves bytes only.
static inline int32_t fixed_byte_floor(int32_t value) {
    return value >> 8;
}

// Angles wrap: the sum is taken modulo one turn.
static inline turn32_t turn32_add(turn32_t a, turn32_t b) {
    return (turn32_t)((uint32_t)a + (uint32_t)b);
}

// numerator / denominator as q2_30, floored. Needs numerator < 2 * denominator and
// denominator in 1..2^31; both in any one format.
q2_30_t fixed_ratio(uint32_t numerator, uint32_t denominator);

// 1 / sqrt(x / 2^32) as q2_30, for x in [2^30, 2^32): the result is in (1, 2], 2 held
// at its last step below. Error below 1e-7.
q2_30_t fixed_rsqrt(uint32_t x);

// sqrt(x), floored.
uint16_t fixed_sqrt(uint32_t x);

// exp(-x) of x in q11_21 that is not negative, within 4e-7.
q2_30_t fixed_exp_neg(int32_t x);

// Leading zero bits of a number that is not zero.
uint8_t fixed_leading_zeros(uint32_t x);

// The angle of the point (x, y) from the x axis towards the y axis; 0 at the origin.
// Error below 3e-6 rad.
turn32_t fixed_atan2(int32_t y, int32_t x);

// Sine and cosine of an angle, within 5e-9.
void fixed_sincos(turn32_t angle, q2_30_t *sine, q2_30_t *cosine);

#endif
