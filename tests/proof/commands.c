// SPDX-License-Identifier: MIT
// Any bytes at all from a host, in any state of the probe: the parser of commands, and
// the params that it changes. What else a command begins is nothing here.
#include "any.h"
#include "core/probe/commands.h"
#include "core/probe/own_field.h"
#include "core/probe/probe_filter.h"
#include "core/probe/probe_params.h"
#include "core/probe/probe_stream.h"
#include "core/probe/send.h"

static struct probe probe;

static uint8_t read_any(void *port, uint16_t offset) {
    (void)port;
    (void)offset;
    return any_u8();
}

static void write_any(void *port, uint16_t offset, uint8_t value) {
    (void)port;
    any_word = offset;
    any_byte = value;
}

static bool ready_any(void *port) {
    (void)port;
    return any_u8() != 0;
}

static const struct memory memory = {
    .read = read_any, .write = write_any, .is_ready = ready_any};
static struct sensor_identity identity;

void settings_save(struct settings_writer *writer) { (void)writer; }

void probe_stream(struct probe *of, bool is_streaming, enum cause cause) {
    of->is_streaming = is_streaming;
    any_byte = (uint8_t)cause;
}

void send_event(struct probe *of, enum event event, enum cause cause, int32_t detail) {
    (void)of;
    any_long = (uint32_t)event + (uint32_t)cause + (uint32_t)detail;
}

void send_hello(struct probe *of, uint8_t outlets) {
    (void)of;
    any_byte = outlets;
}

void send_reply(struct probe *of) { any_byte = of->reply.result; }
void own_field_forget(struct probe *of) { (void)of; }
void probe_filter_restart(struct probe *of, int32_t filter) {
    (void)of;
    any_long = (uint32_t)filter;
}
void probe_params_tell_all(struct probe *of) { (void)of; }
void pose_set_origin(struct pose_tracker *tracker, enum pose_origin origin) {
    (void)tracker;
    any_byte = (uint8_t)origin;
}
bool attitude_has(int32_t kind) { return (any_u8() & kind) != 0; }
enum filter attitude_kind(const struct attitude *attitude) {
    (void)attitude;
    return (enum filter)any_u8();
}

void receive(void) {
    // As a probe begins, with whatever memory holds, and one byte more.
    any_fill(&probe.settings, sizeof probe.settings);
    any_byte = params_store_open(&probe.store, &memory, &probe.params);
    identity.rate_hz = any_u16();
    probe.identity = any_u8() != 0 ? &identity : NULL;
    probe.tracker.has_sample = any_u8() != 0;
    frame_decoder_init(&probe.decoder, SCHEMA_SEED, MESSAGE_HELLO, probe.received,
                       sizeof probe.received);
    any_fill(probe.received, sizeof probe.received);
    probe.decoder.length = any_up_to(sizeof probe.received);
    probe.decoder.code = any_u8();
    probe.decoder.remaining = any_u8();
    probe.decoder.error = any_up_to(-FRAME_TOO_SHORT);
    probe.reply.replied_token = any_u8();
    commands_receive(&probe, any_u8(), any_u32());
    //@ assert probe.decoder.length <= sizeof(probe.received);
}
