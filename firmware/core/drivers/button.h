// SPDX-License-Identifier: MIT
// Debounces a push button: pin levels in, one event for each change out.
#ifndef BUTTON_H
#define BUTTON_H

#include <stdbool.h>
#include <stdint.h>

enum {
    BUTTON_STABLE_US = 50000,  // a new level counts after it was stable for so long
    // A step adds at most this much to that time: between steps the pin may bounce.
    BUTTON_STEP_MAX_US = 10000,
};

enum button_event {
    BUTTON_NONE = 0,
    BUTTON_PRESSED = 1,
    BUTTON_RELEASED = 2,  // always after a press: this completes a click
};

// All zeros: the button is up. A button that is held down at boot therefore gives a
// press after 50 ms, which makes a jammed button visible.
struct button {
    uint32_t stepped_us;  // time of the last step
    uint16_t stable_us;   // how long `level` has been stable
    bool level;           // as last seen; true is down
    bool is_down;         // as last reported
};

// Takes the level of the pin at `now_us` (wraps) and returns the event, if any. Call it
// at least every 10 ms; calling it less often only delays events.
enum button_event button_step(struct button *button, bool is_down, uint32_t now_us);

#endif
