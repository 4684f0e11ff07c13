// SPDX-License-Identifier: MIT
// Exponential and angles in fixed point; see fixed.h for formats and bounds.
#include "core/math/fixed.h"

q2_30_t fixed_exp_neg(int32_t x) {
    // 2^-y with y = x log2(e) = x + 0.442695 x, below 1478, floored to 2^-21. 2^-f of
    // its fraction f is a polynomial within 5.5e-8, and the whole part halves it.
    const uint32_t y = (uint32_t)x + fixed_umul_q32((uint32_t)x, UINT32_C(1901360723));
    const uint32_t whole = y >> 21;
    if (whole > 30) {
        return 0;
    }
    const q2_30_t f = (q2_30_t)((y & UINT32_C(0x1FFFFF)) << 9);
    q2_30_t power = -1017428;
    power = 9890102 + fixed_mul_q30(power, f);
    power = -59377501 + fixed_mul_q30(power, f);
    power = 257890763 + fixed_mul_q30(power, f);
    power = -744256846 + fixed_mul_q30(power, f);
    power = 1073741765 + fixed_mul_q30(power, f);
    return whole > 0 ? fixed_scale_down(power, (uint8_t)whole) : power;
}

// atan of a ratio in [0, 1], in quarter turns: a polynomial within 1.7e-6 rad.
static q2_30_t atan_quarter_turns(q2_30_t ratio) {
    const q2_30_t square = fixed_mul_q30(ratio, ratio);
    q2_30_t sum = -8010781;
    sum = 35987870 + fixed_mul_q30(sum, square);
    sum = -79585073 + fixed_mul_q30(sum, square);
    sum = 132297470 + fixed_mul_q30(sum, square);
    sum = -227369414 + fixed_mul_q30(sum, square);
    sum = 683549703 + fixed_mul_q30(sum, square);
    return fixed_mul_q30(sum, ratio);
}

turn32_t fixed_atan2(int32_t y, int32_t x) {
    const uint32_t abs_y = fixed_magnitude(y);
    const uint32_t abs_x = fixed_magnitude(x);
    if (abs_x == 0 && abs_y == 0) {
        return 0;
    }
    uint32_t angle = abs_y <= abs_x
                         ? (uint32_t)atan_quarter_turns(fixed_ratio(abs_y, abs_x))
                         : UINT32_C(0x40000000) -
                               (uint32_t)atan_quarter_turns(fixed_ratio(abs_x, abs_y));
    if (x < 0) {
        angle = UINT32_C(0x80000000) - angle;
    }
    return (turn32_t)(y < 0 ? 0u - angle : angle);
}

void fixed_sincos(turn32_t angle, q2_30_t *sine, q2_30_t *cosine) {
    // The nearest quarter turn, and what is left of it: u in [-1/2, 1/2) quarter turns.
    const uint32_t shifted = (uint32_t)angle + UINT32_C(0x20000000);
    const uint8_t quadrant = (uint8_t)(shifted >> 30);
    const q2_30_t u = (q2_30_t)(shifted & UINT32_C(0x3FFFFFFF)) - INT32_C(0x20000000);
    const q2_30_t square = fixed_mul_q30(u, u);
    q2_30_t s = 169635;
    s = -5026337 + fixed_mul_q30(s, square);
    s = 85569234 + fixed_mul_q30(s, square);
    s = -693598665 + fixed_mul_q30(s, square);
    s = 1686629713 + fixed_mul_q30(s, square);
    s = fixed_mul_q30(s, u);
    q2_30_t c = 970267;
    c = -22398331 + fixed_mul_q30(c, square);
    c = 272375234 + fixed_mul_q30(c, square);
    c = -1324675869 + fixed_mul_q30(c, square);
    c = Q2_30_ONE + fixed_mul_q30(c, square);
    switch (quadrant) {
    case 0:
        *sine = s;
        *cosine = c;
        break;
    case 1:
        *sine = c;
        *cosine = -s;
        break;
    case 2:
        *sine = -s;
        *cosine = -c;
        break;
    default:
        *sine = -c;
        *cosine = s;
        break;
    }
}
