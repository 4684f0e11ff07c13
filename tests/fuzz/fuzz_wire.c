// SPDX-License-Identifier: MIT
// Any bytes off the wire: the frame decoder and the message decoders take them or
// refuse them, and what they take is encoded to the same bytes again.
#include <string.h>

#include "core/wire/frame.h"
#include "core/wire/messages.h"
#include "fuzz.h"

// A content either is refused, with nothing written, or comes back from what was read
// of it. Of hello alone a later version may add fields, which are left out.
#define TRY(name, ID)                                                                  \
    static void try_##name(const uint8_t *content, uint8_t length) {                   \
        struct message_##name message;                                                 \
        struct message_##name before;                                                  \
        struct message_header header;                                                  \
        uint8_t again[MESSAGE_CONTENT_MAX];                                            \
        memset(&message, 0xA5, sizeof message);                                        \
        before = message;                                                              \
        const enum message_result result =                                             \
            message_##name##_decode(content, length, &header, &message);               \
        if (result != MESSAGE_OK) {                                                    \
            CHECK(memcmp(&message, &before, sizeof message) == 0);                     \
            return;                                                                    \
        }                                                                              \
        const uint8_t count =                                                          \
            message_##name##_encode(&message, header.sequence, header.time_us, again); \
        CHECK(header.id == (ID) && content[0] == (ID));                                \
        CHECK((ID) == MESSAGE_HELLO ? count <= length : count == length);              \
        CHECK(memcmp(content, again, count) == 0);                                     \
    }

TRY(hello, MESSAGE_HELLO)
TRY(raw, MESSAGE_RAW)
TRY(pose, MESSAGE_POSE)
TRY(event, MESSAGE_EVENT)
TRY(status, MESSAGE_STATUS)
TRY(command, MESSAGE_COMMAND)
TRY(reply, MESSAGE_REPLY)

static void try_all(const uint8_t *bytes, uint8_t length) {
    // On the heap and no longer than it is: a byte beyond would be seen.
    uint8_t *content = malloc(length == 0 ? 1 : length);
    for (uint8_t i = 0; i < length; ++i) {
        content[i] = bytes[i];
    }
    try_hello(content, length);
    try_raw(content, length);
    try_pose(content, length);
    try_event(content, length);
    try_status(content, length);
    try_command(content, length);
    try_reply(content, length);
    free(content);
}

// Bytes as they come, into as much room as there happens to be.
static void take_stream(struct input input) {
    const uint8_t room = (uint8_t)(FRAME_CRC + input_u8(&input) % FRAME_CONTENT_MAX);
    uint8_t *bytes = malloc(room);
    struct frame_decoder decoder;
    frame_decoder_init(&decoder, SCHEMA_SEED, MESSAGE_HELLO, bytes, room);
    while (input.next < input.end) {
        uint8_t length = 0xA5;
        const enum frame_result result =
            frame_decode(&decoder, input_u8(&input), &length);
        if (result != FRAME_OK) {
            CHECK(length == 0xA5);
            continue;
        }
        CHECK(length >= 1 && length <= room - FRAME_CRC);
        try_all(bytes, length);
    }
    free(bytes);
}

// A content becomes a frame that is taken back; with one byte of it changed, which the
// CRC must see as a burst of 8 bits, nothing is taken. Only where the change moves no
// zero and does not touch the id, which picks the seed.
static void frame_and_take(const uint8_t *content, uint8_t length, uint8_t at,
                           uint8_t change) {
    const uint16_t seed = content[0] == MESSAGE_HELLO ? FRAME_HELLO_SEED : SCHEMA_SEED;
    uint8_t frame[FRAME_CONTENT_MAX + FRAME_AROUND];
    uint8_t bytes[FRAME_CONTENT_MAX + FRAME_CRC];
    memcpy(frame + 1, content, length);
    const uint8_t count = frame_encode(seed, frame, length);
    CHECK(count == length + FRAME_AROUND);
    struct frame_decoder decoder;
    frame_decoder_init(&decoder, SCHEMA_SEED, MESSAGE_HELLO, bytes, sizeof bytes);
    for (uint8_t i = 0; i < count; ++i) {
        uint8_t found = 0;
        const bool is_last = i + 1 == count;
        CHECK((frame[i] == 0) == is_last);
        const enum frame_result result = frame_decode(&decoder, frame[i], &found);
        CHECK(result == (is_last ? FRAME_OK : FRAME_PENDING));
        CHECK(!is_last || (found == length && memcmp(bytes, content, length) == 0));
    }
    if (at == 0 || at >= length || change == 0 || content[at] == 0 ||
        content[at] == change) {
        return;
    }
    frame[1 + at] ^= change;
    for (uint8_t i = 0; i < count; ++i) {
        uint8_t found;
        const enum frame_result result = frame_decode(&decoder, frame[i], &found);
        CHECK(result == (i + 1 == count ? FRAME_BAD_CRC : FRAME_PENDING));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct input input = {data, data + size};
    take_stream(input);
    const uint8_t at = input_u8(&input);
    const uint8_t change = input_u8(&input);
    const size_t left = (size_t)(input.end - input.next);
    const uint8_t length = left > FRAME_CONTENT_MAX ? FRAME_CONTENT_MAX : (uint8_t)left;
    try_all(input.next, length);
    if (length > 0) {
        frame_and_take(input.next, length, at, change);
    }
    return 0;
}
