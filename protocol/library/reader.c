// SPDX-License-Identifier: MIT
// The part of libimuprobe that is no firmware: see reader.h.
enum { GAP_MAX = 10000 };  // of a sequence, half a minute of all messages

void imuprobe_begin(struct imuprobe_reader *reader) {
    memset(reader, 0, sizeof *reader);
    frame_decoder_init(&reader->decoder, SCHEMA_SEED, MESSAGE_HELLO, reader->bytes,
                       sizeof reader->bytes);
}

static bool decode_any(const uint8_t *content, uint8_t length,
                       struct imuprobe_message *out) {
    struct message_header *header = &out->header;
    switch (content[0]) {
    case MESSAGE_HELLO:
        return message_hello_decode(content, length, header, &out->hello) == MESSAGE_OK;
    case MESSAGE_RAW:
        return message_raw_decode(content, length, header, &out->raw) == MESSAGE_OK;
    case MESSAGE_POSE:
        return message_pose_decode(content, length, header, &out->pose) == MESSAGE_OK;
    case MESSAGE_EVENT:
        return message_event_decode(content, length, header, &out->event) == MESSAGE_OK;
    case MESSAGE_STATUS:
        return message_status_decode(content, length, header, &out->status) ==
               MESSAGE_OK;
    case MESSAGE_EQUIPMENT:
        return message_equipment_decode(content, length, header, &out->equipment) ==
               MESSAGE_OK;
    case MESSAGE_PARAMS:
        return message_params_decode(content, length, header, &out->params) ==
               MESSAGE_OK;
    case MESSAGE_STROKE:
        return message_stroke_decode(content, length, header, &out->stroke) ==
               MESSAGE_OK;
    case MESSAGE_SELF_TEST:
        return message_self_test_decode(content, length, header, &out->self_test) ==
               MESSAGE_OK;
    case MESSAGE_REPLY:
        return message_reply_decode(content, length, header, &out->reply) == MESSAGE_OK;
    default:
        return false;
    }
}

// Counts what is missing before this message, or leaves it out.
static enum imuprobe_got account(struct imuprobe_reader *reader,
                                 const struct imuprobe_message *message) {
    const uint32_t sequence = message->header.sequence;
    const bool is_hello = message->header.id == MESSAGE_HELLO;
    const bool is_new = is_hello && reader->boot != message->hello.boot_count;
    if (!reader->has_hello || is_new || (is_hello && sequence == 0)) {
        if (!is_hello) {
            return IMUPROBE_NOTHING;
        }
        reader->restarts += reader->has_hello;
        reader->has_hello = true;
        reader->boot = message->hello.boot_count;
    } else {
        const uint32_t ahead = sequence - reader->next;
        if (ahead > UINT32_MAX / 2) {
            ++reader->late;
            return IMUPROBE_LATE;
        }
        // A damaged number passes the CRC once in 65536 times.
        if (ahead > GAP_MAX && sequence - reader->suspect > GAP_MAX) {
            reader->suspect = sequence;
            ++reader->corrupt;
            return IMUPROBE_CORRUPT;
        }
        reader->lost += ahead;
    }
    reader->next = sequence + 1;
    return IMUPROBE_MESSAGE;
}

// Content of this length, from 1 on; 0: the frame is damaged.
static enum imuprobe_got take(struct imuprobe_reader *reader, uint8_t length,
                              struct imuprobe_message *out) {
    struct imuprobe_message message;
    memset(&message, 0, sizeof message);
    if (length == 0 || !decode_any(reader->bytes, length, &message)) {
        // Of a probe that is just being joined nothing is known.
        reader->corrupt += reader->has_hello;
        return reader->has_hello ? IMUPROBE_CORRUPT : IMUPROBE_NOTHING;
    }
    if (message.header.id == MESSAGE_HELLO) {
        reader->schema = message.hello.schema_fingerprint;
        if (reader->schema != SCHEMA_FINGERPRINT) {
            reader->has_hello = false;
            return IMUPROBE_OTHER_SCHEMA;
        }
    }
    const enum imuprobe_got got = account(reader, &message);
    if (got == IMUPROBE_MESSAGE) {
        ++reader->messages;
        *out = message;
    }
    return got;
}

enum imuprobe_got imuprobe_read(struct imuprobe_reader *reader, uint8_t byte,
                                struct imuprobe_message *out) {
    uint8_t length = 0;
    const enum frame_result result = frame_decode(&reader->decoder, byte, &length);
    return result == FRAME_PENDING ? IMUPROBE_NOTHING : take(reader, length, out);
}

uint8_t imuprobe_command(struct imuprobe_reader *reader, uint8_t command,
                         int32_t argument, int32_t other, uint8_t *bytes) {
    const struct message_command message = {
        .command = command,
        .token = (uint16_t)++reader->commands,
        .arguments = {argument, other},
    };
    bytes[0] = 0;  // ends what noise may have begun
    const uint8_t length =
        message_command_encode(&message, reader->commands, 0, bytes + 2);
    return (uint8_t)(1 + frame_encode(SCHEMA_SEED, bytes + 1, length));
}
