// SPDX-License-Identifier: MIT
// The probe's messages, one by one; see send.h.
#include "core/probe/send.h"

#include <stddef.h>
#include <string.h>

#include "core/drivers/ports_of.h"

// Each message's buffers are on the stack only while it is made, not all at once.
#define NOINLINE __attribute__((noinline))

// The open ones of these outlets.
static uint8_t open_of(const struct probe *probe, uint8_t outlets) {
    const bool has_log = TO_CARD != 0 && probe->log != NULL;
    return has_log && probe->log->is_on ? outlets : outlets & TO_WIRE;
}

NOINLINE static void put_copy(struct outlet *outlet, const uint8_t *bytes,
                              uint8_t length) {
    uint8_t copy[MESSAGE_CONTENT_MAX + FRAME_AROUND];
    memcpy(copy + 1, bytes + 1, length);
    outlet_put(outlet, copy, length);
}

// Encodes a message behind the first of `bytes`, and hands it to its outlets, which
// number it.
NOINLINE static void put(struct probe *probe, uint8_t outlets, message_layout *layout,
                         const void *message, uint8_t *bytes) {
    const uint8_t open = open_of(probe, outlets);
    const uint8_t length = message_fill(layout, message, bytes + 1);
    memcpy(bytes + 1 + MESSAGE_TIME_AT, &probe->now_us, sizeof probe->now_us);
    if ((open & TO_CARD) != 0) {
        put_copy(&probe->log->outlet, bytes, length);
    }
    if (TO_CARD == 0 || (open & TO_WIRE) != 0) {
        outlet_put(PROBE_PORT(probe)->wire, bytes, length);
    }
}

NOINLINE void send_event(struct probe *probe, enum event event, enum cause cause,
                         int32_t detail) {
    uint8_t bytes[MESSAGE_EVENT_SIZE + FRAME_AROUND];
    const struct message_event message = {(uint8_t)event, (uint8_t)cause, detail};
    put(probe, TO_BOTH, message_event_layout, &message, bytes);
}

#define OFFSET(type, member) offsetof(struct type, member)
_Static_assert(OFFSET(message_hello, self_test) - OFFSET(message_hello, sensor) ==
                       OFFSET(sensor_identity, self_test) &&
                   OFFSET(message_hello, mag_lsb) - OFFSET(message_hello, acc_lsb) ==
                       OFFSET(sensor_identity, mag_lsb_pt) -
                           OFFSET(sensor_identity, acc_lsb_nm_s2),
               "these parts of an identity lie as in a hello");

#ifdef POSE_WITHOUT_OWN_FIELD
#define tell_own_field(probe, out) ((void)(probe))
#else
static void tell_own_field(const struct probe *probe, struct message_hello *out) {
    const struct own_field *const own = &probe->settings.own_field;
    memcpy(out->own_field, own->axis, sizeof own->axis);
    out->own_sigma = own->sigma;
}
#endif

NOINLINE static void make_hello(const struct probe *probe, struct message_hello *out) {
    const struct sensor_identity *identity = probe->identity;
    memset(out, 0, sizeof *out);
    out->protocol_version = PROTOCOL_VERSION;
    out->schema_fingerprint = SCHEMA_FINGERPRINT;
    out->pose_rate = probe->settings.pose_rate_hz;
    out->raw_rate = probe->settings.raw_rate_hz;
    out->boot_count = probe->settings.boot_count;
    out->filter = probe_state_filter(probe);
    out->params_digest = probe->store.bank.list.digest;
    tell_own_field(probe, out);
    PROBE_PORT(probe)->describe(out);
    memcpy(out->probe_id, probe->settings.probe_id, sizeof out->probe_id);
    if (identity != NULL) {
        memcpy(&out->sensor, identity, OFFSET(sensor_identity, self_test) + 1);
        out->sample_rate = identity->rate_hz;
        memcpy(&out->acc_lsb, &identity->acc_lsb_nm_s2, 3 * sizeof out->acc_lsb);
    }
}

// Behind the header (9 bytes) and a tag for each field. On the AVR, whose structs have
// no gaps, the assertion tells when there are more.
enum { HELLO_BEFORE = 32 };
_Static_assert(
    HELLO_BEFORE + sizeof(struct message_hello) > MESSAGE_HELLO_SIZE,
    "HELLO_BEFORE is too small: a hello's encoding would overtake its fields");

// The message is encoded where it is: the stack is short.
union hello_buffer {
    uint8_t bytes[MESSAGE_HELLO_SIZE + FRAME_AROUND];
    struct {
        uint8_t before[HELLO_BEFORE];
        struct message_hello message;
    };
};

NOINLINE void send_hello(struct probe *probe, uint8_t outlets) {
    union hello_buffer buffer;
    make_hello(probe, &buffer.message);
    put(probe, outlets, message_hello_layout, &buffer.message, buffer.bytes);
}

_Static_assert(OFFSET(message_status, bus_recoveries) -
                           OFFSET(message_status, samples_read) ==
                       OFFSET(probe_counts, bus_recoveries) &&
                   OFFSET(message_status, commands_bad) -
                           OFFSET(message_status, commands_received) ==
                       OFFSET(probe_counts, commands_bad) -
                           OFFSET(probe_counts, commands_received),
               "these counts lie as in a status");

NOINLINE static void make_status(const struct probe *probe,
                                 struct message_status *out) {
    const struct probe_counts *counts = &probe->status;
    const struct outlet *wire = PROBE_PORT(probe)->wire;
    PROBE_PORT(probe)->measure(out);
    out->uptime = counts->uptime;
    out->state = (uint8_t)probe_state(probe);
    memcpy(&out->samples_read, counts, OFFSET(probe_counts, commands_received));
    memcpy(&out->commands_received, &counts->commands_received,
           2 * sizeof counts->commands_received);
    out->cycles_mean = probe->samples > 0 ? probe->cycles_sum / probe->samples : 0;
    out->cycles_worst = counts->cycles_worst;
    out->temperature = counts->temperature;
    out->messages_sent = wire->sequence - wire->dropped + 1;  // itself
    out->messages_dropped = wire->dropped;
}

// As of a hello.
enum { STATUS_BEFORE = 28 };
_Static_assert(
    STATUS_BEFORE + sizeof(struct message_status) > MESSAGE_STATUS_SIZE,
    "STATUS_BEFORE is too small: a status's encoding would overtake its fields");

union status_buffer {
    uint8_t bytes[MESSAGE_STATUS_SIZE + FRAME_AROUND];
    struct {
        uint8_t before[STATUS_BEFORE];
        struct message_status message;
    };
};

NOINLINE void send_status(struct probe *probe) {
    union status_buffer buffer;
    make_status(probe, &buffer.message);
    put(probe, TO_BOTH, message_status_layout, &buffer.message, buffer.bytes);
    probe->samples = 0;
    probe->cycles_sum = 0;
    probe->status.cycles_worst = 0;
}

NOINLINE void send_equipment(struct probe *probe) {
    uint8_t bytes[MESSAGE_EQUIPMENT_SIZE + FRAME_AROUND];
    struct message_equipment message = {.battery = EQUIPMENT_BATTERY_NULL};
    probe->equipment(&message);
    if (probe->log != NULL) {
        const struct probe_log *log = probe->log;
        const struct outlet *card = &log->outlet;
        message.messages_unlogged = card->dropped;
        message.messages_logged = log->earlier + card->sequence - card->dropped;
    }
    put(probe, TO_BOTH, message_equipment_layout, &message, bytes);
}

NOINLINE void send_reply(struct probe *probe) {
    uint8_t bytes[MESSAGE_REPLY_SIZE + FRAME_AROUND];
    put(probe, TO_WIRE, message_reply_layout, &probe->reply, bytes);
}

NOINLINE void send_params(struct probe *probe, enum bank_side side, uint8_t at) {
    uint8_t bytes[MESSAGE_PARAMS_SIZE + FRAME_AROUND];
    const struct params_store *store = &probe->store;
    const struct bank_list *list =
        side == BANK_CURRENT ? &store->bank.list : &store->asked;
    struct message_params message = {
        .set_digest = list->digest,
        .set_length = list->length,
        .part_offset = at,
    };
    params_store_part(store, side, list->length, at, message.part);
    put(probe, TO_BOTH, message_params_layout, &message, bytes);
}

NOINLINE void send_self_test(struct probe *probe) {
    uint8_t bytes[MESSAGE_SELF_TEST_SIZE + FRAME_AROUND];
    put(probe, TO_BOTH, message_self_test_layout, probe->identity->answers, bytes);
}

_Static_assert(OFFSET(message_raw, acc) == 0 &&
                   OFFSET(message_raw, sample_flags) ==
                       OFFSET(sample, has_mag) - OFFSET(sample, acc),
               "a sample's numbers lie as in its message");

static void make_raw(const struct sample *sample, struct message_raw *out) {
    uint8_t flags = 0;
    memcpy(out, &sample->acc, OFFSET(message_raw, sample_flags));
    for (uint8_t axis = 0; axis < 3 && !sample->has_mag; ++axis) {
        out->mag[axis] = RAW_MAG_NULL;
    }
    if (sample->mag_overflow) {
        flags |= SAMPLE_MAG_OVERFLOW;
    }
    if (sample->acc_clipped) {
        flags |= SAMPLE_ACC_CLIPPED;
    }
    if (sample->gyr_clipped) {
        flags |= SAMPLE_GYR_CLIPPED;
    }
    if (sample->has_gap) {
        flags |= SAMPLE_GAP;
    }
    out->sample_flags = flags;
}

NOINLINE void send_raw(struct probe *probe, uint8_t outlets,
                       const struct sample *sample) {
    if (open_of(probe, outlets) == 0) {
        return;
    }
    uint8_t bytes[MESSAGE_RAW_SIZE + FRAME_AROUND];
    struct message_raw message;
    make_raw(sample, &message);
    put(probe, outlets, message_raw_layout, &message, bytes);
}

NOINLINE static void put_pose(struct probe *probe, uint8_t outlet,
                              const struct message_pose *message) {
    uint8_t bytes[MESSAGE_POSE_SIZE + FRAME_AROUND];
    put(probe, outlet, message_pose_layout, message, bytes);
}

// Clipped and gap are of all samples since the last pose, which is another on the card
// than on the wire.
NOINLINE void send_pose(struct probe *probe, uint8_t outlets) {
    const uint8_t open = open_of(probe, outlets);
    struct probe_log *const log = TO_CARD != 0 ? probe->log : NULL;
    if (open == 0) {
        return;
    }
    struct message_pose message;
    pose_read(&probe->tracker, &message);
    if ((open & TO_CARD) != 0) {
        put_pose(probe, TO_CARD, &message);
        log->unsent_flags |= message.pose_flags & (POSE_CLIPPED | POSE_GAP);
    }
    if ((open & TO_WIRE) == 0) {
        return;
    }
    if (log != NULL) {
        message.pose_flags |= log->unsent_flags;
        log->unsent_flags = 0;
    }
    put_pose(probe, TO_WIRE, &message);
}

#ifndef POSE_WITHOUT_STROKES
enum { BLINKS = 2 };  // for one to two seconds

NOINLINE void send_stroke(struct probe *probe, uint8_t outlets) {
    uint8_t bytes[MESSAGE_STROKE_SIZE + FRAME_AROUND];
    struct message_stroke message;
    if (!pose_read_stroke(&probe->tracker, &message)) {
        return;
    }
    // What a press has brought is told, whatever streams.
    if (message.end != STROKE_END_RUNNING &&
        probe->params.button_does == BUTTON_DOES_STROKE) {
        outlets = TO_BOTH;
        probe->blinks = message.end > STROKE_END_BUTTON ? BLINKS : 0;
    }
    if (open_of(probe, outlets) != 0) {
        put(probe, outlets, message_stroke_layout, &message, bytes);
    }
}
#endif
