// SPDX-License-Identifier: MIT
// A way out for messages: the wire, or the card. Each numbers and counts its own
// messages, so that its losses show as sequence gaps.
#ifndef OUTLET_H
#define OUTLET_H

#include <stdbool.h>
#include <stdint.h>

struct outlet {
    // Takes all `length` bytes of a frame or, where there is no room, none.
    bool (*put)(const uint8_t *bytes, uint8_t length);
    uint32_t sequence;  // number of the next message, the first is 0
    uint32_t dropped;   // messages that found no room
};

// Numbers the message whose content is the `length` bytes at bytes + 1, frames it in
// place, and hands it over. The number is spent either way, so that a message that
// found no room leaves a visible hole.
void outlet_put(struct outlet *outlet, uint8_t *bytes, uint8_t length);

#endif
