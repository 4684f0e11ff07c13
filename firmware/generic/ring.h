// SPDX-License-Identifier: MIT
// A ring of bytes to be sent, written by the main loop and emptied by interrupts. Its
// head and tail are 0 to size - 1; equal, it is empty, so that one byte stays free.
//
// The file that includes this says how wide they are: `ring_index`, unsigned.
#ifndef RING_H
#define RING_H

#include <string.h>

// Bytes that can be written.
static inline ring_index ring_room(ring_index size, ring_index head, ring_index tail) {
    return (ring_index)(tail - head - 1 + (tail > head ? 0 : size));
}

// Writes `length` bytes for which there is room and returns the head behind them.
static inline ring_index ring_write(uint8_t *ring, ring_index size, ring_index head,
                                    const uint8_t *bytes, uint8_t length) {
    const ring_index to_end = (ring_index)(size - head);
    if (length < to_end) {
        memcpy(ring + head, bytes, length);
        return (ring_index)(head + length);
    }
    memcpy(ring + head, bytes, to_end);
    const ring_index rest = (ring_index)(length - to_end);
    memcpy(ring, bytes + to_end, rest);
    return rest;
}

#endif
