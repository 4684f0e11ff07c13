// SPDX-License-Identifier: MIT
// Messages to content bytes and back. Generated from schema.toml by
// protocol/generate.py.
#include "messages.h"

#include <stdbool.h>
#include <string.h>

#include "frame.h"

// Values go to the wire as they lie in memory.
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the wire is little endian");
_Static_assert((int)MESSAGE_CONTENT_MAX <= (int)FRAME_CONTENT_MAX, "fits a frame");

enum { HEADER_SIZE = 9 };

static uint8_t *put_header(uint8_t *content, uint8_t id, uint32_t sequence,
                           uint32_t time_us) {
    content[0] = id;
    memcpy(content + 1, &sequence, sizeof sequence);
    memcpy(content + 5, &time_us, sizeof time_us);
    return content + HEADER_SIZE;
}

static uint8_t *put(uint8_t *at, uint8_t tag, const void *value, uint8_t size) {
    at[0] = tag;
    memcpy(at + 1, value, size);
    return at + 1 + size;
}

static const uint8_t *get_header(const uint8_t *content,
                                 struct message_header *header) {
    header->id = content[0];
    memcpy(&header->sequence, content + 1, sizeof header->sequence);
    memcpy(&header->time_us, content + 5, sizeof header->time_us);
    return content + HEADER_SIZE;
}

static const uint8_t *get(const uint8_t *at, void *value, uint8_t size) {
    memcpy(value, at + 1, size);
    return at + 1 + size;
}

// A walk over content, field by field, up to the first that is not in its place.
struct walk {
    const uint8_t *at;
    uint8_t left;
    uint8_t expected;  // the tag that should stand at `at`; 0 while all is well
    enum message_result result;
};

static void walk_header(struct walk *walk, const uint8_t *content, uint8_t length,
                        uint8_t id) {
    walk->at = content;
    walk->left = 0;
    walk->expected = 0;
    walk->result = MESSAGE_OK;
    if (length < HEADER_SIZE) {
        walk->result = MESSAGE_WRONG_LENGTH;
    } else if (content[0] != id) {
        walk->result = MESSAGE_WRONG_ID;
    } else {
        walk->at += HEADER_SIZE;
        walk->left = (uint8_t)(length - HEADER_SIZE);
    }
}

static void walk_field(struct walk *walk, uint8_t tag, uint8_t size) {
    if (walk->expected != 0) {
        return;
    }
    if (walk->left <= size || walk->at[0] != tag) {
        walk->expected = tag;
        return;
    }
    walk->at += 1 + size;
    walk->left = (uint8_t)(walk->left - 1 - size);
}

// The tag at which the walk stopped, 0 at the end of the content.
static uint8_t walk_tag(const struct walk *walk) {
    return walk->left > 0 ? walk->at[0] : 0;
}

// Names what stopped the walk. `is_ours`: the tag found there is of this message;
// `is_short`: the content is shorter than the whole message.
static enum message_result walk_end(const struct walk *walk, bool is_ours,
                                    bool is_short) {
    if (walk->result != MESSAGE_OK) {
        return walk->result;
    }
    if (walk->left == 0) {
        return walk->expected == 0 ? MESSAGE_OK : MESSAGE_MISSING_FIELD;
    }
    if (!is_ours) {
        return MESSAGE_UNKNOWN_FIELD;
    }
    if (walk->expected == 0 || walk->at[0] < walk->expected) {
        return MESSAGE_DOUBLED_FIELD;
    }
    if (walk->at[0] == walk->expected) {
        return MESSAGE_WRONG_LENGTH;
    }
    return is_short ? MESSAGE_MISSING_FIELD : MESSAGE_OUT_OF_ORDER;
}

uint8_t message_hello_encode(const struct message_hello *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_HELLO, sequence, time_us);
    at = put(at, 1, &message->protocol_version, sizeof message->protocol_version);
    at = put(at, 2, &message->schema_fingerprint, sizeof message->schema_fingerprint);
    at = put(at, 3, message->firmware, sizeof message->firmware);
    at = put(at, 4, &message->board, sizeof message->board);
    at = put(at, 5, message->probe_id, sizeof message->probe_id);
    at = put(at, 6, &message->sensor, sizeof message->sensor);
    at = put(at, 7, message->who_am_i, sizeof message->who_am_i);
    at = put(at, 8, message->mag_adjust, sizeof message->mag_adjust);
    at = put(at, 9, &message->self_test, sizeof message->self_test);
    at = put(at, 10, &message->sample_rate, sizeof message->sample_rate);
    at = put(at, 11, &message->pose_rate, sizeof message->pose_rate);
    at = put(at, 12, &message->raw_rate, sizeof message->raw_rate);
    at = put(at, 13, &message->acc_lsb, sizeof message->acc_lsb);
    at = put(at, 14, &message->gyr_lsb, sizeof message->gyr_lsb);
    at = put(at, 15, &message->mag_lsb, sizeof message->mag_lsb);
    at = put(at, 16, &message->boot_count, sizeof message->boot_count);
    at = put(at, 17, &message->reset_cause, sizeof message->reset_cause);
    at = put(at, 18, &message->filter, sizeof message->filter);
    return (uint8_t)(at - content);
}

enum message_result message_hello_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_hello *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_HELLO);
    walk_field(&walk, 1, sizeof out->protocol_version);
    walk_field(&walk, 2, sizeof out->schema_fingerprint);
    walk_field(&walk, 3, sizeof out->firmware);
    walk_field(&walk, 4, sizeof out->board);
    walk_field(&walk, 5, sizeof out->probe_id);
    walk_field(&walk, 6, sizeof out->sensor);
    walk_field(&walk, 7, sizeof out->who_am_i);
    walk_field(&walk, 8, sizeof out->mag_adjust);
    walk_field(&walk, 9, sizeof out->self_test);
    walk_field(&walk, 10, sizeof out->sample_rate);
    walk_field(&walk, 11, sizeof out->pose_rate);
    walk_field(&walk, 12, sizeof out->raw_rate);
    walk_field(&walk, 13, sizeof out->acc_lsb);
    walk_field(&walk, 14, sizeof out->gyr_lsb);
    walk_field(&walk, 15, sizeof out->mag_lsb);
    walk_field(&walk, 16, sizeof out->boot_count);
    walk_field(&walk, 17, sizeof out->reset_cause);
    walk_field(&walk, 18, sizeof out->filter);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 1 && tag <= 18;
    if (walk.expected == 0 && !is_ours) {
        walk.left = 0;  // what later versions add
    }
    const enum message_result result = walk_end(&walk, is_ours, length < 86);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, &out->protocol_version, sizeof out->protocol_version);
    at = get(at, &out->schema_fingerprint, sizeof out->schema_fingerprint);
    at = get(at, out->firmware, sizeof out->firmware);
    at = get(at, &out->board, sizeof out->board);
    at = get(at, out->probe_id, sizeof out->probe_id);
    at = get(at, &out->sensor, sizeof out->sensor);
    at = get(at, out->who_am_i, sizeof out->who_am_i);
    at = get(at, out->mag_adjust, sizeof out->mag_adjust);
    at = get(at, &out->self_test, sizeof out->self_test);
    at = get(at, &out->sample_rate, sizeof out->sample_rate);
    at = get(at, &out->pose_rate, sizeof out->pose_rate);
    at = get(at, &out->raw_rate, sizeof out->raw_rate);
    at = get(at, &out->acc_lsb, sizeof out->acc_lsb);
    at = get(at, &out->gyr_lsb, sizeof out->gyr_lsb);
    at = get(at, &out->mag_lsb, sizeof out->mag_lsb);
    at = get(at, &out->boot_count, sizeof out->boot_count);
    at = get(at, &out->reset_cause, sizeof out->reset_cause);
    (void)get(at, &out->filter, sizeof out->filter);
    return MESSAGE_OK;
}

uint8_t message_raw_encode(const struct message_raw *message, uint32_t sequence,
                           uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_RAW, sequence, time_us);
    at = put(at, 20, message->acc, sizeof message->acc);
    at = put(at, 21, message->gyr, sizeof message->gyr);
    at = put(at, 22, message->mag, sizeof message->mag);
    at = put(at, 23, &message->temperature, sizeof message->temperature);
    at = put(at, 24, &message->sample_flags, sizeof message->sample_flags);
    return (uint8_t)(at - content);
}

enum message_result message_raw_decode(const uint8_t *content, uint8_t length,
                                       struct message_header *header,
                                       struct message_raw *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_RAW);
    walk_field(&walk, 20, sizeof out->acc);
    walk_field(&walk, 21, sizeof out->gyr);
    walk_field(&walk, 22, sizeof out->mag);
    walk_field(&walk, 23, sizeof out->temperature);
    walk_field(&walk, 24, sizeof out->sample_flags);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 20 && tag <= 24;
    const enum message_result result = walk_end(&walk, is_ours, length < 35);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, out->acc, sizeof out->acc);
    at = get(at, out->gyr, sizeof out->gyr);
    at = get(at, out->mag, sizeof out->mag);
    at = get(at, &out->temperature, sizeof out->temperature);
    (void)get(at, &out->sample_flags, sizeof out->sample_flags);
    return MESSAGE_OK;
}

uint8_t message_pose_encode(const struct message_pose *message, uint32_t sequence,
                            uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_POSE, sequence, time_us);
    at = put(at, 30, message->q, sizeof message->q);
    at = put(at, 31, message->position, sizeof message->position);
    at = put(at, 32, message->normal, sizeof message->normal);
    at = put(at, 33, &message->tilt_sigma, sizeof message->tilt_sigma);
    at = put(at, 34, &message->heading_sigma, sizeof message->heading_sigma);
    at = put(at, 35, &message->pose_flags, sizeof message->pose_flags);
    return (uint8_t)(at - content);
}

enum message_result message_pose_decode(const uint8_t *content, uint8_t length,
                                        struct message_header *header,
                                        struct message_pose *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_POSE);
    walk_field(&walk, 30, sizeof out->q);
    walk_field(&walk, 31, sizeof out->position);
    walk_field(&walk, 32, sizeof out->normal);
    walk_field(&walk, 33, sizeof out->tilt_sigma);
    walk_field(&walk, 34, sizeof out->heading_sigma);
    walk_field(&walk, 35, sizeof out->pose_flags);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 30 && tag <= 35;
    const enum message_result result = walk_end(&walk, is_ours, length < 55);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, out->q, sizeof out->q);
    at = get(at, out->position, sizeof out->position);
    at = get(at, out->normal, sizeof out->normal);
    at = get(at, &out->tilt_sigma, sizeof out->tilt_sigma);
    at = get(at, &out->heading_sigma, sizeof out->heading_sigma);
    (void)get(at, &out->pose_flags, sizeof out->pose_flags);
    return MESSAGE_OK;
}

uint8_t message_event_encode(const struct message_event *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_EVENT, sequence, time_us);
    at = put(at, 40, &message->event, sizeof message->event);
    at = put(at, 41, &message->cause, sizeof message->cause);
    at = put(at, 42, &message->detail, sizeof message->detail);
    return (uint8_t)(at - content);
}

enum message_result message_event_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_event *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_EVENT);
    walk_field(&walk, 40, sizeof out->event);
    walk_field(&walk, 41, sizeof out->cause);
    walk_field(&walk, 42, sizeof out->detail);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 40 && tag <= 42;
    const enum message_result result = walk_end(&walk, is_ours, length < 18);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, &out->event, sizeof out->event);
    at = get(at, &out->cause, sizeof out->cause);
    (void)get(at, &out->detail, sizeof out->detail);
    return MESSAGE_OK;
}

uint8_t message_status_encode(const struct message_status *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_STATUS, sequence, time_us);
    at = put(at, 50, &message->uptime, sizeof message->uptime);
    at = put(at, 51, &message->state, sizeof message->state);
    at = put(at, 52, &message->samples_ready, sizeof message->samples_ready);
    at = put(at, 53, &message->samples_read, sizeof message->samples_read);
    at = put(at, 54, &message->samples_fused, sizeof message->samples_fused);
    at = put(at, 55, &message->overruns, sizeof message->overruns);
    at = put(at, 56, &message->bus_faults, sizeof message->bus_faults);
    at = put(at, 57, &message->bus_recoveries, sizeof message->bus_recoveries);
    at = put(at, 58, &message->messages_sent, sizeof message->messages_sent);
    at = put(at, 59, &message->messages_dropped, sizeof message->messages_dropped);
    at = put(at, 60, &message->commands_received, sizeof message->commands_received);
    at = put(at, 61, &message->commands_bad, sizeof message->commands_bad);
    at = put(at, 62, &message->cycles_mean, sizeof message->cycles_mean);
    at = put(at, 63, &message->cycles_worst, sizeof message->cycles_worst);
    at = put(at, 64, &message->stack_free, sizeof message->stack_free);
    at = put(at, 65, &message->supply, sizeof message->supply);
    return (uint8_t)(at - content);
}

enum message_result message_status_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_status *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_STATUS);
    walk_field(&walk, 50, sizeof out->uptime);
    walk_field(&walk, 51, sizeof out->state);
    walk_field(&walk, 52, sizeof out->samples_ready);
    walk_field(&walk, 53, sizeof out->samples_read);
    walk_field(&walk, 54, sizeof out->samples_fused);
    walk_field(&walk, 55, sizeof out->overruns);
    walk_field(&walk, 56, sizeof out->bus_faults);
    walk_field(&walk, 57, sizeof out->bus_recoveries);
    walk_field(&walk, 58, sizeof out->messages_sent);
    walk_field(&walk, 59, sizeof out->messages_dropped);
    walk_field(&walk, 60, sizeof out->commands_received);
    walk_field(&walk, 61, sizeof out->commands_bad);
    walk_field(&walk, 62, sizeof out->cycles_mean);
    walk_field(&walk, 63, sizeof out->cycles_worst);
    walk_field(&walk, 64, sizeof out->stack_free);
    walk_field(&walk, 65, sizeof out->supply);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 50 && tag <= 65;
    const enum message_result result = walk_end(&walk, is_ours, length < 74);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, &out->uptime, sizeof out->uptime);
    at = get(at, &out->state, sizeof out->state);
    at = get(at, &out->samples_ready, sizeof out->samples_ready);
    at = get(at, &out->samples_read, sizeof out->samples_read);
    at = get(at, &out->samples_fused, sizeof out->samples_fused);
    at = get(at, &out->overruns, sizeof out->overruns);
    at = get(at, &out->bus_faults, sizeof out->bus_faults);
    at = get(at, &out->bus_recoveries, sizeof out->bus_recoveries);
    at = get(at, &out->messages_sent, sizeof out->messages_sent);
    at = get(at, &out->messages_dropped, sizeof out->messages_dropped);
    at = get(at, &out->commands_received, sizeof out->commands_received);
    at = get(at, &out->commands_bad, sizeof out->commands_bad);
    at = get(at, &out->cycles_mean, sizeof out->cycles_mean);
    at = get(at, &out->cycles_worst, sizeof out->cycles_worst);
    at = get(at, &out->stack_free, sizeof out->stack_free);
    (void)get(at, &out->supply, sizeof out->supply);
    return MESSAGE_OK;
}

uint8_t message_command_encode(const struct message_command *message, uint32_t sequence,
                               uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_COMMAND, sequence, time_us);
    at = put(at, 70, &message->command, sizeof message->command);
    at = put(at, 71, &message->token, sizeof message->token);
    at = put(at, 72, message->arguments, sizeof message->arguments);
    return (uint8_t)(at - content);
}

enum message_result message_command_decode(const uint8_t *content, uint8_t length,
                                           struct message_header *header,
                                           struct message_command *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_COMMAND);
    walk_field(&walk, 70, sizeof out->command);
    walk_field(&walk, 71, sizeof out->token);
    walk_field(&walk, 72, sizeof out->arguments);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 70 && tag <= 72;
    const enum message_result result = walk_end(&walk, is_ours, length < 23);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, &out->command, sizeof out->command);
    at = get(at, &out->token, sizeof out->token);
    (void)get(at, out->arguments, sizeof out->arguments);
    return MESSAGE_OK;
}

uint8_t message_reply_encode(const struct message_reply *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content) {
    uint8_t *at = put_header(content, MESSAGE_REPLY, sequence, time_us);
    at = put(at, 80, &message->replied_command, sizeof message->replied_command);
    at = put(at, 81, &message->replied_token, sizeof message->replied_token);
    at = put(at, 82, &message->result, sizeof message->result);
    at = put(at, 83, message->value, sizeof message->value);
    return (uint8_t)(at - content);
}

enum message_result message_reply_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_reply *out) {
    struct walk walk;
    walk_header(&walk, content, length, MESSAGE_REPLY);
    walk_field(&walk, 80, sizeof out->replied_command);
    walk_field(&walk, 81, sizeof out->replied_token);
    walk_field(&walk, 82, sizeof out->result);
    walk_field(&walk, 83, sizeof out->value);
    const uint8_t tag = walk_tag(&walk);
    const bool is_ours = tag >= 80 && tag <= 83;
    const enum message_result result = walk_end(&walk, is_ours, length < 25);
    if (result != MESSAGE_OK) {
        return result;
    }
    const uint8_t *at = get_header(content, header);
    at = get(at, &out->replied_command, sizeof out->replied_command);
    at = get(at, &out->replied_token, sizeof out->replied_token);
    at = get(at, &out->result, sizeof out->result);
    (void)get(at, out->value, sizeof out->value);
    return MESSAGE_OK;
}
