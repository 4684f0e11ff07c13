// SPDX-License-Identifier: MIT
// Bounce out of levels; see button.h.
#include "core/drivers/button.h"

enum button_event button_step(struct button *button, bool is_down, uint32_t now_us) {
    uint32_t elapsed_us = now_us - button->stepped_us;
    button->stepped_us = now_us;
    if (is_down == button->is_down || is_down != button->level) {
        button->level = is_down;
        button->stable_us = 0;
        return BUTTON_NONE;
    }
    if (elapsed_us > BUTTON_STEP_MAX_US) {
        elapsed_us = BUTTON_STEP_MAX_US;
    }
    // Below 50 ms before, at most 10 ms more: no overflow.
    button->stable_us = (uint16_t)(button->stable_us + elapsed_us);
    if (button->stable_us < BUTTON_STABLE_US) {
        return BUTTON_NONE;
    }
    button->is_down = is_down;
    return is_down ? BUTTON_PRESSED : BUTTON_RELEASED;
}
