// SPDX-License-Identifier: MIT
// A push button behind contact bounce: levels in, one event a change out.
#ifndef BUTTON_H
#define BUTTON_H

#include <stdbool.h>
#include <stdint.h>

enum {
    BUTTON_STABLE_US = 50000,  // a change counts once its level has stood this long
    // At most this much of it between two steps: what nobody watched may have bounced.
    BUTTON_STEP_MAX_US = 10000,
};

enum button_event {
    BUTTON_NONE = 0,
    BUTTON_PRESSED = 1,
    BUTTON_RELEASED = 2,  // always after a press: a click is complete
};

// All zeros: up. A button held down at boot is therefore a press 50 ms later, so that
// a jammed one shows.
struct button {
    uint32_t stepped_us;  // time of the last step
    uint16_t stable_us;   // for how long `level` has stood
    bool level;           // as last seen; true is down
    bool is_down;         // as last reported
};

// Takes the pin's level at `now_us` (wraps) and says what it means. Call it every 10 ms
// or oftener; less often only makes an event later.
enum button_event button_step(struct button *button, bool is_down, uint32_t now_us);

#endif
