// SPDX-License-Identifier: MIT
// Second-order Butterworth low-pass as two trapezoidal integrators, which needs no more
// precision than its input has. Until it has settled, the mean of its input.
#ifndef LOWPASS_H
#define LOWPASS_H

#include "core/math/constant.h"
#include "core/math/in_flash.h"
#include "core/math/vector.h"

struct lowpass_axis {
    int32_t band, level;  // level: the output, in the format of the input
};

// The same of three axes: the output is a vector.
struct lowpass {
    struct vector level, band;
};

enum { LOWPASS_SHORTS = 6 };

// Six of the same in 16 bits, for what needs no more than 1e-3 of its range, with a
// step of 0.1 s and a time constant of 3 s. The output stays within 16 steps of that of
// 32 bits.
struct lowpass_short {
    int16_t level[LOWPASS_SHORTS], band[LOWPASS_SHORTS];
};

// The gains for a step of T and a time constant of tau.
struct lowpass_gain {
    q2_30_t integrator;  // g = tan(T / (sqrt(2) tau))
    q2_30_t feedback;    // 1 / (1 + g (g + sqrt(2)))
    uint8_t settle;      // steps in tau
};

// The same at compile time, both in seconds: the tangent's series, to 1e-9 for a step
// of at most a tenth of tau.
#define LOWPASS_GAIN(step, tau)                                                        \
    {                                                                                  \
        Q30(LOWPASS_INTEGRATOR(step, tau)), Q30(LOWPASS_FEEDBACK(step, tau)),          \
            ROUNDED((tau) / (step))                                                    \
    }
#define LOWPASS_SQRT_2 1.414214
#define LOWPASS_TAN(x) ((x) * (1 + (x) * (x) / 3 * (1 + (x) * (x)*0.4)))
#define LOWPASS_INTEGRATOR(step, tau) LOWPASS_TAN((step) / (LOWPASS_SQRT_2 * (tau)))
#define LOWPASS_FEEDBACK(step, tau)                                                    \
    (1 / (1 + LOWPASS_INTEGRATOR(step, tau) *                                          \
                  (LOWPASS_INTEGRATOR(step, tau) + LOWPASS_SQRT_2)))

#define LOWPASS_INPUT_MAX INT32_C(1000000000)

// Takes the `count`th input, counted from 1; any number above `settle` will do once it
// has settled. Needs |input| <= LOWPASS_INPUT_MAX; the states stay below 1.1 of the
// largest input.
void lowpass_axis_step(int32_t *level, int32_t *band,
                       const IN_FLASH struct lowpass_gain *gain, uint8_t count,
                       int32_t input);

// Needs |input| at most 25,000.
void lowpass_short_step(struct lowpass_short *filter,
                        const int16_t input[LOWPASS_SHORTS], uint8_t count);

// The same of three axes.
void lowpass_step(struct lowpass *filter, const IN_FLASH struct lowpass_gain *gain,
                  const struct vector *input, uint8_t count);

#endif
