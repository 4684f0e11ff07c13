// SPDX-License-Identifier: MIT
// Content to bytes on the wire and back, without a table: RAM is dear on the AVR, and a
// byte's CRC is a few shifts.
#include "core/wire/frame.h"

#include <string.h>

uint16_t frame_crc(uint16_t seed, const uint8_t *bytes, uint8_t length) {
    uint8_t high = (uint8_t)(seed >> 8);
    uint8_t low = (uint8_t)seed;
    // Eight bits at once: x^16 = x^12 + x^5 + 1, so that each bit of `top`, the eight
    // that leave, comes back at three places. The four that would leave again by the
    // x^12 are folded in first.
    for (; length > 0; length--) {
        uint8_t top = (uint8_t)(high ^ *bytes++);
        top = (uint8_t)(top ^ (top >> 4));
        const uint16_t by_5 = (uint16_t)(top * 32u);  // a multiplication on the AVR
        high = (uint8_t)(low ^ (uint8_t)(top << 4) ^ (uint8_t)(by_5 >> 8));
        low = (uint8_t)((uint8_t)by_5 ^ top);
    }
    return (uint16_t)((uint16_t)high << 8 | low);
}

uint8_t frame_encode(uint16_t seed, uint8_t *bytes, uint8_t length) {
    uint8_t *at = bytes + 1;
    const uint16_t crc = frame_crc(seed, at, length);
    memcpy(at + length, &crc, sizeof crc);
    // A code is the distance to the next, which takes the place of a zero; content is
    // too short for a code of 0xFF, the one that stands for no zero.
    uint8_t *code = bytes;
    for (uint8_t left = (uint8_t)(length + FRAME_CRC); left > 0; left--) {
        if (*at == 0) {
            *code = (uint8_t)(at - code);
            code = at;
        }
        at++;
    }
    *code = (uint8_t)(at - code);
    *at = 0;
    return (uint8_t)(length + FRAME_AROUND);
}

void frame_decoder_init(struct frame_decoder *decoder, uint16_t seed, uint8_t hello_id,
                        uint8_t *bytes, uint8_t room) {
    *decoder = (struct frame_decoder){.seed = seed, .hello_id = hello_id, .room = room};
    decoder->bytes = bytes;
}

static void append(struct frame_decoder *decoder, uint8_t byte) {
    if (decoder->length == decoder->room) {
        decoder->error = (uint8_t)-FRAME_TOO_LONG;
        return;
    }
    decoder->bytes[decoder->length] = byte;
    decoder->length++;
}

// What the delimiter ends; a frame has begun.
static enum frame_result judge(const struct frame_decoder *decoder) {
    if (decoder->error != 0) {
        return (enum frame_result)(-(int8_t)decoder->error);
    }
    if (decoder->remaining > 0) {
        return FRAME_BAD_COBS;
    }
    if (decoder->length <= FRAME_CRC) {
        return FRAME_TOO_SHORT;
    }
    const uint8_t content_length = (uint8_t)(decoder->length - FRAME_CRC);
    uint16_t told;  // little endian, as messages.c asserts of all our processors
    memcpy(&told, decoder->bytes + content_length, sizeof told);
    const uint16_t seed =
        decoder->bytes[0] == decoder->hello_id ? FRAME_HELLO_SEED : decoder->seed;
    const uint16_t expected = frame_crc(seed, decoder->bytes, content_length);
    return told == expected ? FRAME_OK : FRAME_BAD_CRC;
}

enum frame_result frame_decode(struct frame_decoder *decoder, uint8_t byte,
                               uint8_t *content_length) {
    if (byte == 0) {
        const enum frame_result result =
            decoder->code == 0 ? FRAME_PENDING : judge(decoder);
        if (result == FRAME_OK) {
            *content_length = (uint8_t)(decoder->length - FRAME_CRC);
        }
        decoder->length = 0;
        decoder->code = 0;
        decoder->remaining = 0;
        decoder->error = 0;
        return result;
    }
    if (decoder->remaining > 0) {
        decoder->remaining--;
    } else {
        const uint8_t before = decoder->code;
        decoder->code = byte;
        decoder->remaining = (uint8_t)(byte - 1);
        if (before == 0) {
            return FRAME_PENDING;
        }
        byte = 0;  // which the code before stands for
    }
    append(decoder, byte);
    return FRAME_PENDING;
}
