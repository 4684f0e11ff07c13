// SPDX-License-Identifier: MIT
// Any bytes at all, as they come from a wire: what frame.c does with them.
#include "any.h"
#include "core/wire/frame.h"

static uint8_t room[FRAME_CONTENT_MAX + FRAME_CRC];

// One byte, in any state in which the decoder may be: nothing is decoded beyond the
// room, and what follows is such a state again.
void decode(void) {
    //@ loop unroll 123;
    for (uint8_t decoded = 0; decoded <= sizeof room; decoded++) {
        struct frame_decoder decoder;
        uint8_t length = 0;
        any_fill(room, sizeof room);
        frame_decoder_init(&decoder, any_u16(), any_u8(), room, sizeof room);
        decoder.length = decoded;
        decoder.code = any_u8();
        decoder.remaining = any_u8();
        decoder.error = any_up_to(-FRAME_TOO_SHORT);
        const enum frame_result result = frame_decode(&decoder, any_u8(), &length);
        //@ assert decoder.length <= 122 && decoder.error <= 4;
        //@ assert -4 <= result <= 1;
        //@ assert length <= 120;
    }
}

void crc(void) {
    uint8_t bytes[FRAME_CONTENT_MAX];
    any_fill(bytes, sizeof bytes);
    //@ loop unroll 121;
    for (uint8_t length = 0; length <= FRAME_CONTENT_MAX; length++) {
        any_u16_use(frame_crc(any_u16(), bytes, length));
    }
}

void encode(void) {
    uint8_t bytes[FRAME_CONTENT_MAX + FRAME_AROUND];
    //@ loop unroll 121;
    for (uint8_t length = 1; length <= FRAME_CONTENT_MAX; length++) {
        any_fill(bytes, sizeof bytes);
        any_use(bytes, frame_encode(any_u16(), bytes, length));
    }
}
