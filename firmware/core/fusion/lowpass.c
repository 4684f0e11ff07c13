// SPDX-License-Identifier: MIT
// Second-order Butterworth low-pass; see lowpass.h.
#include "core/fusion/lowpass.h"

// Of 3 s in steps of 0.1 s: the gains of lowpass.h as 2^16ths, 1 less the feedback.
enum { SHORT_INTEGRATOR = 1545, SHORT_LOSS = 2149, SHORT_SETTLE = 30 };

void lowpass_axis_step(struct lowpass_axis *axis,
                       const IN_FLASH struct lowpass_gain *gain, int32_t input,
                       uint8_t count) {
    const int32_t error = input - axis->level;
    if (count <= gain->settle) {
        // The first sample has work enough: the AVR divides in 640 cycles.
        fixed_add(count == 1 ? error : fixed_divide(error, count), &axis->level);
        return;
    }
    const int32_t middle = fixed_mul_q30(
        axis->band + fixed_mul_q30(error, gain->integrator), gain->feedback);
    fixed_add(2 * fixed_mul_q30(middle, gain->integrator), &axis->level);
    axis->band = 2 * middle - axis->band;
}

void lowpass_short_step(struct lowpass_short *axis, int16_t input, uint8_t count) {
    const int32_t error = (int32_t)input - axis->level;
    if (count <= SHORT_SETTLE) {
        axis->level = (int16_t)(axis->level + fixed_divide(error, count));
        return;
    }
    // As lowpass_axis_step, with 8 bits more than the states have.
    int32_t middle =
        axis->band * INT32_C(256) + fixed_byte_floor(error * SHORT_INTEGRATOR + 128);
    middle -= fixed_byte_floor((int32_t)(int16_t)fixed_byte_floor(middle) * SHORT_LOSS);
    const int32_t step = (int32_t)(int16_t)fixed_byte_floor(middle) * SHORT_INTEGRATOR;
    axis->level =
        (int16_t)(axis->level + (int16_t)fixed_high_half((uint32_t)(2 * step + 32768)));
    axis->band = (int16_t)(fixed_byte_floor(2 * middle + 128) - axis->band);
}

void lowpass_step(struct lowpass *filter, const IN_FLASH struct lowpass_gain *gain,
                  const struct vector *input, uint8_t count) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        lowpass_axis_step(&filter->axis[axis], gain, input->axis[axis], count);
    }
}

void lowpass_read(const struct lowpass *filter, struct vector *out) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = filter->axis[axis].level;
    }
}
