// SPDX-License-Identifier: MIT
// Second-order Butterworth low-pass; see lowpass.h.
#include "core/fusion/lowpass.h"

#include "core/fusion/fuse_params.h"

// As the force is low-passed: the gains of lowpass.h as 2^16ths, 1 less the feedback.
enum {
    SHORT_INTEGRATOR = Q16(LOWPASS_INTEGRATOR(FUSE_WINDOW_S, FUSE_LEVEL_TAU_S)),
    SHORT_LOSS = Q16(1 - LOWPASS_FEEDBACK(FUSE_WINDOW_S, FUSE_LEVEL_TAU_S)),
    SHORT_SETTLE = FUSE_WINDOWS(FUSE_LEVEL_TAU_S),
};

void lowpass_axis_step(int32_t *level, int32_t *band,
                       const IN_FLASH struct lowpass_gain *gain, uint8_t count,
                       int32_t input) {
    const int32_t error = input - *level;
    if (count <= gain->settle) {
        // The first sample has work enough: the AVR divides in 640 cycles.
        fixed_add(count == 1 ? error : fixed_divide(error, count), level);
        return;
    }
    const int32_t middle =
        fixed_mul_q30(*band + fixed_mul_q30(error, gain->integrator), gain->feedback);
    fixed_add(2 * fixed_mul_q30(middle, gain->integrator), level);
    *band = 2 * middle - *band;
}

static void short_step(int16_t *level, int16_t *band, int16_t input, uint8_t count) {
    const int32_t error = (int32_t)input - *level;
    if (count <= SHORT_SETTLE) {
        *level = (int16_t)(*level + fixed_divide(error, count));
        return;
    }
    // As lowpass_axis_step, with 8 bits more than the states have: all but the lowest
    // of what 32 bits hold.
    uint32_t middle =
        (uint32_t)*band * 65536 + (uint32_t)(error * SHORT_INTEGRATOR + 128);
    middle &= ~UINT32_C(255);
    middle -= (uint32_t)((int16_t)fixed_high_half(middle) * (int32_t)SHORT_LOSS) &
              ~UINT32_C(255);
    const int32_t step = (int16_t)fixed_high_half(middle) * (int32_t)SHORT_INTEGRATOR;
    *level = (int16_t)(*level + (int16_t)fixed_high_half((uint32_t)(2 * step + 32768)));
    *band = (int16_t)((int16_t)fixed_high_half(2 * middle + 32768) - *band);
}

void lowpass_short_step(struct lowpass_short *filter,
                        const int16_t input[LOWPASS_SHORTS], uint8_t count) {
    for (uint8_t i = 0; i < LOWPASS_SHORTS; ++i) {
        short_step(&filter->level[i], &filter->band[i], input[i], count);
    }
}

void lowpass_step(struct lowpass *filter, const IN_FLASH struct lowpass_gain *gain,
                  const struct vector *input, uint8_t count) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        lowpass_axis_step(&filter->level.axis[axis], &filter->band.axis[axis], gain,
                          count, input->axis[axis]);
    }
}
