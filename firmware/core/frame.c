// SPDX-License-Identifier: MIT
// Content to bytes on the wire and back, without a table: RAM is dear on the AVR, and a
// byte's CRC is a few shifts.
#include "frame.h"

// One step of the CRC for eight bits at once: x^16 = x^12 + x^5 + 1, so that each bit
// of `top`, the eight that leave, comes back at three places. The four that would leave
// again by the x^12 are folded in first.
static uint16_t crc_add(uint16_t crc, uint8_t byte) {
    uint8_t top = (uint8_t)((crc >> 8) ^ byte);
    top = (uint8_t)(top ^ (top >> 4));
    const uint8_t high = (uint8_t)((uint8_t)crc ^ (uint8_t)(top << 4) ^ (top >> 3));
    const uint8_t low = (uint8_t)((uint8_t)(top << 5) ^ top);
    return (uint16_t)(((uint16_t)high << 8) | low);
}

uint16_t frame_crc(uint16_t seed, const uint8_t *bytes, uint8_t length) {
    uint16_t crc = seed;
    for (uint8_t i = 0; i < length; i++) {
        crc = crc_add(crc, bytes[i]);
    }
    return crc;
}

uint8_t frame_encode(uint16_t seed, const uint8_t *content, uint8_t length,
                     uint8_t *out) {
    const uint16_t crc = frame_crc(seed, content, length);
    const uint8_t crc_bytes[FRAME_CRC] = {(uint8_t)crc, (uint8_t)(crc >> 8)};
    const uint8_t total = (uint8_t)(length + FRAME_CRC);
    // A code is the distance to the next one; content is too short for a code of 0xFF,
    // the one that stands for no zero. Content at out + 1 is read before it is written.
    uint8_t code_at = 0;
    uint8_t at = 1;
    for (uint8_t i = 0; i < total; i++) {
        const uint8_t byte = i < length ? content[i] : crc_bytes[i - length];
        if (byte == 0) {
            out[code_at] = (uint8_t)(at - code_at);
            code_at = at;
        } else {
            out[at] = byte;
        }
        at++;
    }
    out[code_at] = (uint8_t)(at - code_at);
    out[at] = 0;
    return (uint8_t)(at + 1);
}

void frame_decoder_init(struct frame_decoder *decoder, uint16_t seed,
                        uint8_t hello_id) {
    *decoder = (struct frame_decoder){.seed = seed, .hello_id = hello_id};
}

static void append(struct frame_decoder *decoder, uint8_t byte) {
    if (decoder->length == sizeof decoder->bytes) {
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
    const uint8_t *crc = decoder->bytes + content_length;
    const uint16_t seed =
        decoder->bytes[0] == decoder->hello_id ? FRAME_HELLO_SEED : decoder->seed;
    const uint16_t expected = frame_crc(seed, decoder->bytes, content_length);
    if (crc[0] != (uint8_t)expected || crc[1] != (uint8_t)(expected >> 8)) {
        return FRAME_BAD_CRC;
    }
    return FRAME_OK;
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
        append(decoder, byte);
        decoder->remaining--;
        return FRAME_PENDING;
    }
    if (decoder->code != 0) {
        append(decoder, 0);  // the zero that the code before stands for
    }
    decoder->code = byte;
    decoder->remaining = (uint8_t)(byte - 1);
    return FRAME_PENDING;
}
