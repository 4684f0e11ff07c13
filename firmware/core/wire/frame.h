// SPDX-License-Identifier: MIT
// Content to bytes on the wire and back: COBS, zero as delimiter, CRC-16 (polynomial
// 0x1021, most significant bit first, no reflection, no final xor; PROTOCOL.md).
#ifndef FRAME_H
#define FRAME_H

#include <stdint.h>

enum {
    FRAME_CONTENT_MAX = 120,  // id, sequence, time and fields
    FRAME_CRC = 2,
    FRAME_AROUND = 1 + FRAME_CRC + 1,  // COBS code before content; CRC, delimiter
};

enum frame_result {
    FRAME_OK = 0,
    FRAME_PENDING = 1,    // no frame ends with this byte
    FRAME_BAD_COBS = -1,  // the codes do not meet the delimiter
    FRAME_BAD_CRC = -2,
    FRAME_TOO_LONG = -3,
    FRAME_TOO_SHORT = -4,
};

// CRC of `length` bytes that follow those that gave `seed`.
uint16_t frame_crc(uint16_t seed, const uint8_t *bytes, uint8_t length);

// Frames the `length` bytes of content (1 to FRAME_CONTENT_MAX) at bytes + 1, where
// they are, and returns the frame's length, length + FRAME_AROUND, delimiter included.
uint8_t frame_encode(uint16_t seed, uint8_t *bytes, uint8_t length);

// A decoder picks the seed by the first byte of content: `hello_id` opens a frame
// whose CRC starts at FRAME_HELLO_SEED, all others start at `seed`.
enum { FRAME_HELLO_SEED = 0xFFFF };

struct frame_decoder {
    uint16_t seed;
    uint8_t hello_id;
    uint8_t length;     // content and CRC decoded so far
    uint8_t code;       // the COBS code in force, 0 at the start of a frame
    uint8_t remaining;  // bytes left of its block
    uint8_t error;      // negated enum frame_result that dooms this frame, or 0
    uint8_t room;
    uint8_t *bytes;
};

// `bytes` has `room` bytes, FRAME_CRC of them for the CRC; what needs more is too long.
// It must stay valid.
void frame_decoder_init(struct frame_decoder *decoder, uint16_t seed, uint8_t hello_id,
                        uint8_t *bytes, uint8_t room);

// Takes one received byte. FRAME_OK: the content is bytes[0..content_length), valid
// until the next call. Empty frames (zeros in a row) are FRAME_PENDING.
enum frame_result frame_decode(struct frame_decoder *decoder, uint8_t byte,
                               uint8_t *content_length);

#endif
