// SPDX-License-Identifier: MIT
// Encodes and decodes any message from a table of its fields. generate.py copies what
// follows the first blank line to the top of firmware/core/wire/messages.c.

#include "core/wire/messages.h"

#include <stdbool.h>
#include <string.h>

#include "core/wire/frame.h"

// Values go to the wire as they lie in memory.
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the wire is little endian");
_Static_assert((int)MESSAGE_CONTENT_MAX <= (int)FRAME_CONTENT_MAX, "fits a frame");

enum { HEADER_SIZE = 9 };

// A message's id, then for each field its tag, and its bytes and what they are aligned
// to, together. 0 ends it.
#define FIELD(tag, count, size) tag, (size) / 2 * 64 + (count) * (size)

// A field that a walk over the layout has come to, and where it lies in memory.
struct field {
    uint8_t tag, length, offset;
};

static struct field field_first(message_layout *at, uint8_t end) {
    const uint8_t size = at[1] / 64;
    const uint8_t unit = size == 2   ? _Alignof(uint32_t)
                         : size == 1 ? _Alignof(uint16_t)
                                     : 1;
    return (struct field){at[0], at[1] % 64, (uint8_t)((end + unit - 1) / unit * unit)};
}

uint8_t message_fill(message_layout *layout, const void *message, uint8_t *content) {
    uint8_t *to = content + HEADER_SIZE;
    message_layout *at = layout + 1;
    content[0] = layout[0];
    for (uint8_t end = 0; *at != 0; at += 2) {
        const struct field field = field_first(at, end);
        *to++ = field.tag;
        end = (uint8_t)(field.offset + field.length);
        for (uint8_t i = field.offset; i < end; ++i) {
            *to++ = ((const uint8_t *)message)[i];
        }
    }
    return (uint8_t)(to - content);
}

static uint8_t encode(message_layout *layout, const void *message, uint32_t sequence,
                      uint32_t time_us, uint8_t *content) {
    memcpy(content + MESSAGE_SEQUENCE_AT, &sequence, sizeof sequence);
    memcpy(content + MESSAGE_TIME_AT, &time_us, sizeof time_us);
    return message_fill(layout, message, content);
}

// Names what stands at `at` where the `expected` field does not, or 0 where none is
// left to come.
static enum message_result misplaced(message_layout *fields, const uint8_t *at,
                                     uint8_t left, uint8_t expected) {
    if (left == 0) {
        return MESSAGE_MISSING_FIELD;
    }
    bool is_ours = false;
    for (; *fields != 0; fields += 2) {
        is_ours |= *fields == *at;
    }
    if (!is_ours) {
        return MESSAGE_UNKNOWN_FIELD;
    }
    if (expected == 0 || *at < expected) {
        return MESSAGE_DOUBLED_FIELD;
    }
    return *at == expected ? MESSAGE_WRONG_LENGTH : MESSAGE_OUT_OF_ORDER;
}

static enum message_result decode(message_layout *fields, const uint8_t *content,
                                  uint8_t length, uint8_t size,
                                  struct message_header *header, void *out) {
    const uint8_t id = *fields++;
    if (length < HEADER_SIZE) {
        return MESSAGE_WRONG_LENGTH;
    }
    if (content[0] != id) {
        return MESSAGE_WRONG_ID;
    }
    const uint8_t *from = content + HEADER_SIZE;
    uint8_t left = (uint8_t)(length - HEADER_SIZE);
    message_layout *at = fields;
    for (; *at != 0; at += 2) {
        const struct field field = field_first(at, 0);
        if (left <= field.length || *from != field.tag) {
            break;
        }
        from += 1 + field.length;
        left = (uint8_t)(left - 1 - field.length);
    }
    if (*at != 0 || left > 0) {
        const enum message_result result = misplaced(fields, from, left, *at);
        // A hello may have at its end what later versions add.
        if (id != MESSAGE_HELLO || *at != 0 || result != MESSAGE_UNKNOWN_FIELD) {
            return result == MESSAGE_OUT_OF_ORDER && length < size
                       ? MESSAGE_MISSING_FIELD
                       : result;
        }
    }
    header->id = id;
    memcpy(&header->sequence, content + MESSAGE_SEQUENCE_AT, sizeof header->sequence);
    memcpy(&header->time_us, content + MESSAGE_TIME_AT, sizeof header->time_us);
    from = content + HEADER_SIZE;
    uint8_t end = 0;
    for (at = fields; *at != 0; at += 2) {
        const struct field field = field_first(at, end);
        memcpy((uint8_t *)out + field.offset, from + 1, field.length);
        from += 1 + field.length;
        end = (uint8_t)(field.offset + field.length);
    }
    return MESSAGE_OK;
}
