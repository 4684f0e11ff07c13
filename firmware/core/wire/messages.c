// SPDX-License-Identifier: MIT
// Messages to content bytes and back. Generated from schema.toml by
// protocol/generate.py.
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

message_layout message_hello_layout[46] = {
    MESSAGE_HELLO,
    FIELD(1, 1, 1),    // protocol_version
    FIELD(2, 1, 4),    // schema_fingerprint
    FIELD(3, 16, 1),   // firmware
    FIELD(4, 1, 1),    // board
    FIELD(5, 8, 1),    // probe_id
    FIELD(6, 1, 1),    // sensor
    FIELD(7, 2, 1),    // who_am_i
    FIELD(8, 3, 1),    // mag_adjust
    FIELD(9, 1, 1),    // self_test
    FIELD(10, 1, 2),   // sample_rate
    FIELD(11, 1, 2),   // pose_rate
    FIELD(12, 1, 2),   // raw_rate
    FIELD(13, 1, 4),   // acc_lsb
    FIELD(14, 1, 4),   // gyr_lsb
    FIELD(15, 1, 4),   // mag_lsb
    FIELD(16, 1, 2),   // boot_count
    FIELD(17, 1, 1),   // reset_cause
    FIELD(18, 1, 1),   // filter
    FIELD(19, 1, 4),   // reset_address
    FIELD(113, 1, 4),  // params_digest
    FIELD(114, 3, 2),  // own_field
    FIELD(115, 1, 2),  // own_sigma
    0,
};

uint8_t message_hello_encode(const struct message_hello *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content) {
    return encode(message_hello_layout, message, sequence, time_us, content);
}

enum message_result message_hello_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_hello *out) {
    return decode(message_hello_layout, content, length, MESSAGE_HELLO_SIZE, header,
                  out);
}

bool message_hello_take(const uint8_t *content, uint8_t length,
                        struct message_hello *out) {
    if (length != MESSAGE_HELLO_SIZE || content[0] != MESSAGE_HELLO ||
        content[9] != 1 || content[11] != 2 || content[16] != 3 || content[33] != 4 ||
        content[35] != 5 || content[44] != 6 || content[46] != 7 || content[49] != 8 ||
        content[53] != 9 || content[55] != 10 || content[58] != 11 ||
        content[61] != 12 || content[64] != 13 || content[69] != 14 ||
        content[74] != 15 || content[79] != 16 || content[82] != 17 ||
        content[84] != 18 || content[86] != 19 || content[91] != 113 ||
        content[96] != 114 || content[103] != 115) {
        return false;
    }
    memcpy(&out->protocol_version, content + 10, 1);
    memcpy(&out->schema_fingerprint, content + 12, 4);
    memcpy(out->firmware, content + 17, 16);
    memcpy(&out->board, content + 34, 1);
    memcpy(out->probe_id, content + 36, 8);
    memcpy(&out->sensor, content + 45, 1);
    memcpy(out->who_am_i, content + 47, 2);
    memcpy(out->mag_adjust, content + 50, 3);
    memcpy(&out->self_test, content + 54, 1);
    memcpy(&out->sample_rate, content + 56, 2);
    memcpy(&out->pose_rate, content + 59, 2);
    memcpy(&out->raw_rate, content + 62, 2);
    memcpy(&out->acc_lsb, content + 65, 4);
    memcpy(&out->gyr_lsb, content + 70, 4);
    memcpy(&out->mag_lsb, content + 75, 4);
    memcpy(&out->boot_count, content + 80, 2);
    memcpy(&out->reset_cause, content + 83, 1);
    memcpy(&out->filter, content + 85, 1);
    memcpy(&out->reset_address, content + 87, 4);
    memcpy(&out->params_digest, content + 92, 4);
    memcpy(out->own_field, content + 97, 6);
    memcpy(&out->own_sigma, content + 104, 2);
    return true;
}

message_layout message_raw_layout[12] = {
    MESSAGE_RAW,
    FIELD(20, 3, 2),  // acc
    FIELD(21, 3, 2),  // gyr
    FIELD(22, 3, 2),  // mag
    FIELD(23, 1, 2),  // temperature
    FIELD(24, 1, 1),  // sample_flags
    0,
};

uint8_t message_raw_encode(const struct message_raw *message, uint32_t sequence,
                           uint32_t time_us, uint8_t *content) {
    return encode(message_raw_layout, message, sequence, time_us, content);
}

enum message_result message_raw_decode(const uint8_t *content, uint8_t length,
                                       struct message_header *header,
                                       struct message_raw *out) {
    return decode(message_raw_layout, content, length, MESSAGE_RAW_SIZE, header, out);
}

bool message_raw_take(const uint8_t *content, uint8_t length, struct message_raw *out) {
    if (length != MESSAGE_RAW_SIZE || content[0] != MESSAGE_RAW || content[9] != 20 ||
        content[16] != 21 || content[23] != 22 || content[30] != 23 ||
        content[33] != 24) {
        return false;
    }
    memcpy(out->acc, content + 10, 6);
    memcpy(out->gyr, content + 17, 6);
    memcpy(out->mag, content + 24, 6);
    memcpy(&out->temperature, content + 31, 2);
    memcpy(&out->sample_flags, content + 34, 1);
    return true;
}

message_layout message_pose_layout[14] = {
    MESSAGE_POSE,
    FIELD(30, 4, 4),  // q
    FIELD(31, 3, 4),  // position
    FIELD(32, 3, 2),  // normal
    FIELD(33, 1, 2),  // tilt_sigma
    FIELD(34, 1, 2),  // heading_sigma
    FIELD(35, 1, 2),  // pose_flags
    0,
};

uint8_t message_pose_encode(const struct message_pose *message, uint32_t sequence,
                            uint32_t time_us, uint8_t *content) {
    return encode(message_pose_layout, message, sequence, time_us, content);
}

enum message_result message_pose_decode(const uint8_t *content, uint8_t length,
                                        struct message_header *header,
                                        struct message_pose *out) {
    return decode(message_pose_layout, content, length, MESSAGE_POSE_SIZE, header, out);
}

bool message_pose_take(const uint8_t *content, uint8_t length,
                       struct message_pose *out) {
    if (length != MESSAGE_POSE_SIZE || content[0] != MESSAGE_POSE || content[9] != 30 ||
        content[26] != 31 || content[39] != 32 || content[46] != 33 ||
        content[49] != 34 || content[52] != 35) {
        return false;
    }
    memcpy(out->q, content + 10, 16);
    memcpy(out->position, content + 27, 12);
    memcpy(out->normal, content + 40, 6);
    memcpy(&out->tilt_sigma, content + 47, 2);
    memcpy(&out->heading_sigma, content + 50, 2);
    memcpy(&out->pose_flags, content + 53, 2);
    return true;
}

message_layout message_event_layout[8] = {
    MESSAGE_EVENT,
    FIELD(40, 1, 1),  // event
    FIELD(41, 1, 1),  // cause
    FIELD(42, 1, 4),  // detail
    0,
};

uint8_t message_event_encode(const struct message_event *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content) {
    return encode(message_event_layout, message, sequence, time_us, content);
}

enum message_result message_event_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_event *out) {
    return decode(message_event_layout, content, length, MESSAGE_EVENT_SIZE, header,
                  out);
}

bool message_event_take(const uint8_t *content, uint8_t length,
                        struct message_event *out) {
    if (length != MESSAGE_EVENT_SIZE || content[0] != MESSAGE_EVENT ||
        content[9] != 40 || content[11] != 41 || content[13] != 42) {
        return false;
    }
    memcpy(&out->event, content + 10, 1);
    memcpy(&out->cause, content + 12, 1);
    memcpy(&out->detail, content + 14, 4);
    return true;
}

message_layout message_status_layout[38] = {
    MESSAGE_STATUS,
    FIELD(50, 1, 4),  // uptime
    FIELD(51, 1, 1),  // state
    FIELD(52, 1, 4),  // samples_ready
    FIELD(53, 1, 4),  // samples_read
    FIELD(54, 1, 4),  // samples_fused
    FIELD(55, 1, 4),  // overruns
    FIELD(56, 1, 2),  // bus_faults
    FIELD(57, 1, 2),  // bus_recoveries
    FIELD(58, 1, 4),  // messages_sent
    FIELD(59, 1, 4),  // messages_dropped
    FIELD(60, 1, 2),  // commands_received
    FIELD(61, 1, 2),  // commands_bad
    FIELD(62, 1, 4),  // cycles_mean
    FIELD(63, 1, 4),  // cycles_worst
    FIELD(64, 1, 2),  // stack_free
    FIELD(65, 1, 2),  // supply
    FIELD(66, 1, 2),  // receive_lost
    FIELD(67, 1, 2),  // temperature
    0,
};

uint8_t message_status_encode(const struct message_status *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content) {
    return encode(message_status_layout, message, sequence, time_us, content);
}

enum message_result message_status_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_status *out) {
    return decode(message_status_layout, content, length, MESSAGE_STATUS_SIZE, header,
                  out);
}

bool message_status_take(const uint8_t *content, uint8_t length,
                         struct message_status *out) {
    if (length != MESSAGE_STATUS_SIZE || content[0] != MESSAGE_STATUS ||
        content[9] != 50 || content[14] != 51 || content[16] != 52 ||
        content[21] != 53 || content[26] != 54 || content[31] != 55 ||
        content[36] != 56 || content[39] != 57 || content[42] != 58 ||
        content[47] != 59 || content[52] != 60 || content[55] != 61 ||
        content[58] != 62 || content[63] != 63 || content[68] != 64 ||
        content[71] != 65 || content[74] != 66 || content[77] != 67) {
        return false;
    }
    memcpy(&out->uptime, content + 10, 4);
    memcpy(&out->state, content + 15, 1);
    memcpy(&out->samples_ready, content + 17, 4);
    memcpy(&out->samples_read, content + 22, 4);
    memcpy(&out->samples_fused, content + 27, 4);
    memcpy(&out->overruns, content + 32, 4);
    memcpy(&out->bus_faults, content + 37, 2);
    memcpy(&out->bus_recoveries, content + 40, 2);
    memcpy(&out->messages_sent, content + 43, 4);
    memcpy(&out->messages_dropped, content + 48, 4);
    memcpy(&out->commands_received, content + 53, 2);
    memcpy(&out->commands_bad, content + 56, 2);
    memcpy(&out->cycles_mean, content + 59, 4);
    memcpy(&out->cycles_worst, content + 64, 4);
    memcpy(&out->stack_free, content + 69, 2);
    memcpy(&out->supply, content + 72, 2);
    memcpy(&out->receive_lost, content + 75, 2);
    memcpy(&out->temperature, content + 78, 2);
    return true;
}

message_layout message_equipment_layout[28] = {
    MESSAGE_EQUIPMENT,
    FIELD(100, 1, 1),  // clock
    FIELD(101, 1, 2),  // battery
    FIELD(102, 1, 1),  // power
    FIELD(103, 1, 1),  // radio
    FIELD(104, 1, 2),  // radio_resets
    FIELD(105, 1, 1),  // card
    FIELD(106, 1, 4),  // card_block
    FIELD(107, 1, 4),  // card_blocks
    FIELD(108, 1, 2),  // card_faults
    FIELD(109, 1, 2),  // card_busy
    FIELD(110, 1, 2),  // recording
    FIELD(111, 1, 4),  // messages_logged
    FIELD(112, 1, 4),  // messages_unlogged
    0,
};

uint8_t message_equipment_encode(const struct message_equipment *message,
                                 uint32_t sequence, uint32_t time_us,
                                 uint8_t *content) {
    return encode(message_equipment_layout, message, sequence, time_us, content);
}

enum message_result message_equipment_decode(const uint8_t *content, uint8_t length,
                                             struct message_header *header,
                                             struct message_equipment *out) {
    return decode(message_equipment_layout, content, length, MESSAGE_EQUIPMENT_SIZE,
                  header, out);
}

bool message_equipment_take(const uint8_t *content, uint8_t length,
                            struct message_equipment *out) {
    if (length != MESSAGE_EQUIPMENT_SIZE || content[0] != MESSAGE_EQUIPMENT ||
        content[9] != 100 || content[11] != 101 || content[14] != 102 ||
        content[16] != 103 || content[18] != 104 || content[21] != 105 ||
        content[23] != 106 || content[28] != 107 || content[33] != 108 ||
        content[36] != 109 || content[39] != 110 || content[42] != 111 ||
        content[47] != 112) {
        return false;
    }
    memcpy(&out->clock, content + 10, 1);
    memcpy(&out->battery, content + 12, 2);
    memcpy(&out->power, content + 15, 1);
    memcpy(&out->radio, content + 17, 1);
    memcpy(&out->radio_resets, content + 19, 2);
    memcpy(&out->card, content + 22, 1);
    memcpy(&out->card_block, content + 24, 4);
    memcpy(&out->card_blocks, content + 29, 4);
    memcpy(&out->card_faults, content + 34, 2);
    memcpy(&out->card_busy, content + 37, 2);
    memcpy(&out->recording, content + 40, 2);
    memcpy(&out->messages_logged, content + 43, 4);
    memcpy(&out->messages_unlogged, content + 48, 4);
    return true;
}

message_layout message_params_layout[10] = {
    MESSAGE_PARAMS,
    FIELD(120, 1, 4),   // set_digest
    FIELD(121, 1, 2),   // set_length
    FIELD(122, 1, 2),   // part_offset
    FIELD(123, 28, 1),  // part
    0,
};

uint8_t message_params_encode(const struct message_params *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content) {
    return encode(message_params_layout, message, sequence, time_us, content);
}

enum message_result message_params_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_params *out) {
    return decode(message_params_layout, content, length, MESSAGE_PARAMS_SIZE, header,
                  out);
}

bool message_params_take(const uint8_t *content, uint8_t length,
                         struct message_params *out) {
    if (length != MESSAGE_PARAMS_SIZE || content[0] != MESSAGE_PARAMS ||
        content[9] != 120 || content[14] != 121 || content[17] != 122 ||
        content[20] != 123) {
        return false;
    }
    memcpy(&out->set_digest, content + 10, 4);
    memcpy(&out->set_length, content + 15, 2);
    memcpy(&out->part_offset, content + 18, 2);
    memcpy(out->part, content + 21, 28);
    return true;
}

message_layout message_stroke_layout[18] = {
    MESSAGE_STROKE,
    FIELD(130, 1, 2),  // stroke
    FIELD(131, 1, 1),  // end
    FIELD(132, 1, 1),  // windows
    FIELD(133, 3, 4),  // displacement
    FIELD(134, 2, 2),  // displacement_sigma
    FIELD(135, 3, 4),  // path
    FIELD(136, 2, 2),  // path_sigma
    FIELD(137, 1, 2),  // stroke_flags
    0,
};

uint8_t message_stroke_encode(const struct message_stroke *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content) {
    return encode(message_stroke_layout, message, sequence, time_us, content);
}

enum message_result message_stroke_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_stroke *out) {
    return decode(message_stroke_layout, content, length, MESSAGE_STROKE_SIZE, header,
                  out);
}

bool message_stroke_take(const uint8_t *content, uint8_t length,
                         struct message_stroke *out) {
    if (length != MESSAGE_STROKE_SIZE || content[0] != MESSAGE_STROKE ||
        content[9] != 130 || content[12] != 131 || content[14] != 132 ||
        content[16] != 133 || content[29] != 134 || content[34] != 135 ||
        content[47] != 136 || content[52] != 137) {
        return false;
    }
    memcpy(&out->stroke, content + 10, 2);
    memcpy(&out->end, content + 13, 1);
    memcpy(&out->windows, content + 15, 1);
    memcpy(out->displacement, content + 17, 12);
    memcpy(out->displacement_sigma, content + 30, 4);
    memcpy(out->path, content + 35, 12);
    memcpy(out->path_sigma, content + 48, 4);
    memcpy(&out->stroke_flags, content + 53, 2);
    return true;
}

message_layout message_self_test_layout[12] = {
    MESSAGE_SELF_TEST,
    FIELD(140, 6, 2),  // before
    FIELD(141, 6, 2),  // stimulated
    FIELD(142, 6, 2),  // after
    FIELD(143, 6, 1),  // factory
    FIELD(144, 3, 2),  // mag_response
    0,
};

uint8_t message_self_test_encode(const struct message_self_test *message,
                                 uint32_t sequence, uint32_t time_us,
                                 uint8_t *content) {
    return encode(message_self_test_layout, message, sequence, time_us, content);
}

enum message_result message_self_test_decode(const uint8_t *content, uint8_t length,
                                             struct message_header *header,
                                             struct message_self_test *out) {
    return decode(message_self_test_layout, content, length, MESSAGE_SELF_TEST_SIZE,
                  header, out);
}

bool message_self_test_take(const uint8_t *content, uint8_t length,
                            struct message_self_test *out) {
    if (length != MESSAGE_SELF_TEST_SIZE || content[0] != MESSAGE_SELF_TEST ||
        content[9] != 140 || content[22] != 141 || content[35] != 142 ||
        content[48] != 143 || content[55] != 144) {
        return false;
    }
    memcpy(out->before, content + 10, 12);
    memcpy(out->stimulated, content + 23, 12);
    memcpy(out->after, content + 36, 12);
    memcpy(out->factory, content + 49, 6);
    memcpy(out->mag_response, content + 56, 6);
    return true;
}

message_layout message_command_layout[8] = {
    MESSAGE_COMMAND,
    FIELD(70, 1, 1),  // command
    FIELD(71, 1, 2),  // token
    FIELD(72, 2, 4),  // arguments
    0,
};

uint8_t message_command_encode(const struct message_command *message, uint32_t sequence,
                               uint32_t time_us, uint8_t *content) {
    return encode(message_command_layout, message, sequence, time_us, content);
}

enum message_result message_command_decode(const uint8_t *content, uint8_t length,
                                           struct message_header *header,
                                           struct message_command *out) {
    return decode(message_command_layout, content, length, MESSAGE_COMMAND_SIZE, header,
                  out);
}

bool message_command_take(const uint8_t *content, uint8_t length,
                          struct message_command *out) {
    if (length != MESSAGE_COMMAND_SIZE || content[0] != MESSAGE_COMMAND ||
        content[9] != 70 || content[11] != 71 || content[14] != 72) {
        return false;
    }
    memcpy(&out->command, content + 10, 1);
    memcpy(&out->token, content + 12, 2);
    memcpy(out->arguments, content + 15, 8);
    return true;
}

message_layout message_reply_layout[10] = {
    MESSAGE_REPLY,
    FIELD(80, 1, 1),  // replied_command
    FIELD(81, 1, 2),  // replied_token
    FIELD(82, 1, 1),  // result
    FIELD(83, 2, 4),  // value
    0,
};

uint8_t message_reply_encode(const struct message_reply *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content) {
    return encode(message_reply_layout, message, sequence, time_us, content);
}

enum message_result message_reply_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_reply *out) {
    return decode(message_reply_layout, content, length, MESSAGE_REPLY_SIZE, header,
                  out);
}

bool message_reply_take(const uint8_t *content, uint8_t length,
                        struct message_reply *out) {
    if (length != MESSAGE_REPLY_SIZE || content[0] != MESSAGE_REPLY ||
        content[9] != 80 || content[11] != 81 || content[14] != 82 ||
        content[16] != 83) {
        return false;
    }
    memcpy(&out->replied_command, content + 10, 1);
    memcpy(&out->replied_token, content + 12, 2);
    memcpy(&out->result, content + 15, 1);
    memcpy(out->value, content + 17, 8);
    return true;
}
