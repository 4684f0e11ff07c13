// SPDX-License-Identifier: MIT

// Reads a probe: bytes in; messages, and the account of what was lost, out. No
// allocation, no float, no I/O; one reader for each port.
//
//     struct imuprobe_reader reader;
//     struct imuprobe_message message;
//     imuprobe_begin(&reader);
//     for each byte:
//         if (imuprobe_read(&reader, byte, &message) == IMUPROBE_MESSAGE &&
//             message.header.id == IMUPROBE_MESSAGE_POSE) { ... message.pose.q[0] ... }

#ifdef __cplusplus
extern "C" {
#endif

// A message of a probe; `header.id` says which of the union it is.
struct imuprobe_message {
    struct message_header header;
    union {
        struct message_hello hello;
        struct message_raw raw;
        struct message_pose pose;
        struct message_event event;
        struct message_status status;
        struct message_equipment equipment;
        struct message_params params;
        struct message_stroke stroke;
        struct message_self_test self_test;
        struct message_reply reply;
    };
};

struct imuprobe_reader {
    uint32_t messages;  // that were good
    uint32_t lost;      // gaps in sequence numbers, since the first hello
    uint32_t corrupt;   // frames that are damaged, or no message of this schema; the
                        // ranges of values are not judged
    uint32_t late;      // repeated or out of order, and left out
    uint32_t restarts;  // of the probe
    uint32_t schema;    // of its last hello: IMUPROBE_SCHEMA_FINGERPRINT, or another
    uint32_t next;      // the sequence number that is expected
    uint32_t suspect;   // a number far ahead, which the next message confirms or not
    uint32_t commands;  // that were written
    uint16_t boot;      // boot_count of its last hello
    bool has_hello;     // and `next` is known
    struct frame_decoder decoder;
    uint8_t bytes[FRAME_CONTENT_MAX + FRAME_CRC];
};

enum imuprobe_got {
    IMUPROBE_NOTHING = 0,  // no message ends with this byte
    IMUPROBE_MESSAGE = 1,
    IMUPROBE_CORRUPT = -1,       // a frame was damaged, and counted
    IMUPROBE_LATE = -2,          // a message was left out, and counted
    IMUPROBE_OTHER_SCHEMA = -3,  // a hello of another schema: use the library of it
};

enum { IMUPROBE_COMMAND_MAX = 1 + MESSAGE_COMMAND_SIZE + FRAME_AROUND };

void imuprobe_begin(struct imuprobe_reader *reader);

// Takes the next byte of the port. Only with IMUPROBE_MESSAGE is `out` written.
// Messages before the first hello are left out: their schema is not known.
enum imuprobe_got imuprobe_read(struct imuprobe_reader *reader, uint8_t byte,
                                struct imuprobe_message *out);

// Writes a command (enum command, its arguments by PROTOCOL.md) to `bytes`, which has
// IMUPROBE_COMMAND_MAX, and returns how many to send. The reply has the token
// `reader->commands`, as 16 bits.
uint8_t imuprobe_command(struct imuprobe_reader *reader, uint8_t command,
                         int32_t argument, int32_t other, uint8_t *bytes);

#ifdef __cplusplus
}
#endif
