// SPDX-License-Identifier: MIT
// Second-order Butterworth low-pass; see lowpass.h.
#include "core/fusion/lowpass.h"

// Of 16 bits in the 32 that a step calculates with: |input| stays below 1e9.
enum { SHORT_BITS = 15 };
#define SHORT_STEP INT32_C(32768)

void lowpass_axis_step(struct lowpass_axis *axis,
                       const IN_FLASH struct lowpass_gain *gain, int32_t input,
                       uint8_t count) {
    const int32_t error = input - axis->level;
    if (count <= gain->settle) {
        // The first sample has work enough: the AVR divides in 640 cycles.
        fixed_add(count == 1 ? error : error / count, &axis->level);
        return;
    }
    const int32_t middle = fixed_mul_q30(
        axis->band + fixed_mul_q30(error, gain->integrator), gain->feedback);
    axis->level += 2 * fixed_mul_q30(middle, gain->integrator);
    axis->band = 2 * middle - axis->band;
}

void lowpass_short_step(struct lowpass_short *axis,
                        const IN_FLASH struct lowpass_gain *gain, int16_t input,
                        uint8_t count) {
    struct lowpass_axis fine = {axis->band * SHORT_STEP, axis->level * SHORT_STEP};
    lowpass_axis_step(&fine, gain, input * SHORT_STEP, count);
    axis->band = (int16_t)fixed_scale_down(fine.band, SHORT_BITS);
    axis->level = (int16_t)fixed_scale_down(fine.level, SHORT_BITS);
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
