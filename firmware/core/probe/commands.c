// SPDX-License-Identifier: MIT
// Commands of a host; see commands.h.
#include "core/probe/commands.h"

#include <stddef.h>
#include <string.h>

#include "core/probe/own_field.h"
#include "core/probe/probe_filter.h"
#include "core/probe/probe_params.h"
#include "core/probe/probe_stream.h"
#include "core/probe/send.h"

static enum result set_rate(struct probe *probe, int32_t value[2]) {
    uint16_t *rate_hz =
        value[0] == 1 ? &probe->settings.raw_rate_hz : &probe->settings.pose_rate_hz;
    const int32_t wanted = value[1];
    const uint16_t limit_hz =
        probe->identity != NULL ? probe->identity->rate_hz : SETTINGS_RATE_MAX_HZ;
    value[1] = *rate_hz;
    if ((uint32_t)value[0] > 1 || (uint32_t)wanted - 1 >= limit_hz) {
        return RESULT_BAD_ARGUMENT;
    }
    *rate_hz = (uint16_t)wanted;
    value[1] = wanted;
    settings_save(&probe->writer);
    return RESULT_OK;
}

static enum result set_fields(struct probe *probe, int32_t value[2]) {
    const int32_t wanted = value[0];
    value[0] = probe->settings.streams;
    if ((uint32_t)wanted - 1 >= (STREAM_POSE | STREAM_RAW)) {
        return RESULT_BAD_ARGUMENT;
    }
    probe->settings.streams = (uint8_t)wanted;
    value[0] = wanted;
    settings_save(&probe->writer);
    return RESULT_OK;
}

static enum result set_origin(struct probe *probe, const int32_t value[2]) {
    if ((uint32_t)value[0] > POSE_ORIGIN_NONE) {
        return RESULT_BAD_ARGUMENT;
    }
    if (probe->identity == NULL || !probe->tracker.has_sample) {
        return RESULT_NOT_READY;
    }
    pose_set_origin(&probe->tracker, (enum pose_origin)value[0]);
    send_event(probe, EVENT_TARED, CAUSE_COMMAND, value[0]);
    return RESULT_OK;
}

static enum result restart(struct probe *probe, int32_t value[2]) {
    const int32_t in_use = probe_state_filter(probe);
    const int32_t wanted = value[0] == FILTER_NONE ? in_use : value[0];
    value[0] = in_use;
    if (!attitude_has(wanted)) {
        return RESULT_BAD_ARGUMENT;
    }
    if (probe->identity == NULL) {
        return RESULT_NOT_READY;
    }
    if (value[1] != 0) {
        own_field_forget(probe);
    }
    probe_filter_restart(probe, wanted);
    value[0] = wanted;
    return RESULT_OK;
}

__attribute__((noinline)) static enum result carry_out(struct probe *probe) {
    int32_t *value = probe->reply.value;
    switch (probe->reply.replied_command) {
    case COMMAND_START:
        probe_stream(probe, true, CAUSE_COMMAND);
        return RESULT_OK;
    case COMMAND_STOP:
        probe_stream(probe, false, CAUSE_COMMAND);
        return RESULT_OK;
    case COMMAND_RATE:
        return set_rate(probe, value);
    case COMMAND_FIELDS:
        return set_fields(probe, value);
    case COMMAND_HELLO:
        send_hello(probe, TO_BOTH);
        return RESULT_OK;
    case COMMAND_TARE:
        return set_origin(probe, value);
    case COMMAND_RESET:
        probe->wants_reset = true;
        return RESULT_OK;
    case COMMAND_RESTART:
        return restart(probe, value);
    case COMMAND_TIME:
        return RESULT_OK;
    case COMMAND_PARAMS_WRITE:
        return params_store_write(&probe->store, value[0], value[1]);
    case COMMAND_PARAMS_APPLY:
        return params_store_apply(&probe->store, value);
    case COMMAND_PARAMS_TELL:
        probe_params_tell_all(probe);
        return RESULT_OK;
    default:
        return RESULT_UNKNOWN_COMMAND;
    }
}

void commands_receive(struct probe *probe, uint8_t byte, uint32_t now_us) {
    struct message_command command;
    uint8_t length;
    const enum frame_result framed = frame_decode(&probe->decoder, byte, &length);
    if (framed == FRAME_PENDING) {
        return;
    }
    if (framed != FRAME_OK ||
        !message_command_take(probe->received, length, &command)) {
        ++probe->status.commands_bad;
        return;
    }
    ++probe->status.commands_received;
    probe->now_us = now_us;
    // A command whose reply was lost comes again with its token: it gets the reply, and
    // is not carried out twice.
    struct message_reply *const reply = &probe->reply;
    reply->replied_command = command.command;
    if (command.token == 0 || command.token != reply->replied_token) {
        reply->replied_token = command.token;
        memcpy(reply->value, command.arguments, sizeof reply->value);
        reply->result = (uint8_t)carry_out(probe);
    }
    send_reply(probe);
}
