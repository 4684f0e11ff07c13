// SPDX-License-Identifier: MIT
// Bytes in the order in which they came, up to a number.
#ifndef SIM_CHIPS_RN41_RING_H
#define SIM_CHIPS_RN41_RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ring {
    uint8_t *bytes;
    size_t room, head, count;
};

// False where it is full.
static inline bool ring_put(struct ring *ring, uint8_t byte) {
    if (ring->count == ring->room) {
        return false;
    }
    ring->bytes[(ring->head + ring->count) % ring->room] = byte;
    ring->count++;
    return true;
}

// False where it is empty.
static inline bool ring_take(struct ring *ring, uint8_t *byte) {
    if (ring->count == 0) {
        return false;
    }
    *byte = ring->bytes[ring->head];
    ring->head = (ring->head + 1) % ring->room;
    ring->count--;
    return true;
}

#endif
