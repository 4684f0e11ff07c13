// SPDX-License-Identifier: MIT
// The probe's states and messages; see probe.h.
#include "core/probe/probe.h"

#include <stddef.h>
#include <string.h>

enum {
    ENTROPY_READINGS = 64,
    WAITS_MAX = 10,  // steps in a row that what is not urgent waits
};

#define SECOND_US UINT32_C(1000000)
// The messages of each second are apart: never two at once.
#define EQUIPMENT_PHASE_US UINT32_C(250000)
#define HELLO_PHASE_US UINT32_C(500000)
#define REFUSAL_PERIOD_US UINT32_C(5000000)

// Milliseconds of two seconds as a fraction of 2^16, floored.
#define PHASE_MS(ms) ((uint16_t)(UINT32_C(65536) * (ms) / 2000))

// A build for a board without a card, or anything else beside sensor, wire and button.
#ifdef PROBE_WIRE_ONLY
enum { IS_WIRE_ONLY = true };
#else
enum { IS_WIRE_ONLY = false };
#endif

// Each message's buffers are on the stack only while it is made, not all at once.
#define NOINLINE __attribute__((noinline))

// Frames the content at bytes + 1, in place; the frame's length.
static uint8_t frame(uint8_t *bytes, uint8_t length) {
    const uint16_t seed = bytes[1] == MESSAGE_HELLO ? FRAME_HELLO_SEED : SCHEMA_SEED;
    return frame_encode(seed, bytes, length);
}

// Hands the content at bytes + 1 to the wire. The sequence number is spent either way,
// so that a message which found no room leaves a visible hole.
static void send(struct probe *probe, uint8_t *bytes, uint8_t length) {
    const uint8_t size = frame(bytes, length);
    ++probe->sequence;
    if (probe->port->send(bytes, size)) {
        ++probe->status.messages_sent;
    } else {
        ++probe->status.messages_dropped;
    }
}

// The log that is kept at present, or NULL.
static struct probe_log *log_of(const struct probe *probe) {
    if (IS_WIRE_ONLY || probe->port->log == NULL || !probe->port->log->is_on) {
        return NULL;
    }
    return probe->port->log;
}

// The same as send().
static void keep(struct probe_log *log, uint8_t *bytes, uint8_t length) {
    const uint8_t size = frame(bytes, length);
    ++log->sequence;
    if (log->keep(bytes, size)) {
        ++log->kept;
    } else {
        ++log->dropped;
    }
}

NOINLINE void probe_tell(struct probe *probe, enum event event, enum cause cause,
                         int32_t detail, uint32_t now_us) {
    uint8_t bytes[MESSAGE_EVENT_SIZE + FRAME_AROUND];
    const struct message_event message = {(uint8_t)event, (uint8_t)cause, detail};
    send(probe, bytes,
         message_event_encode(&message, probe->sequence, now_us, bytes + 1));
    struct probe_log *const log = log_of(probe);
    if (log != NULL) {
        keep(log, bytes,
             message_event_encode(&message, log->sequence, now_us, bytes + 1));
    }
}

// What fuses, or will once there is a sensor: an enum filter.
static uint8_t filter_of(const struct probe *probe) {
    return (uint8_t)(probe->identity != NULL ? attitude_kind(&probe->tracker.attitude)
                                             : ATTITUDE_DEFAULT);
}

static void make_hello(const struct probe *probe, struct message_hello *out) {
    const struct sensor_identity *identity = probe->identity;
    *out = (struct message_hello){
        .protocol_version = PROTOCOL_VERSION,
        .schema_fingerprint = SCHEMA_FINGERPRINT,
        .board = probe->board.kind,
        .pose_rate = probe->settings.pose_rate_hz,
        .raw_rate = probe->settings.raw_rate_hz,
        .boot_count = probe->settings.boot_count,
        .reset_cause = probe->board.reset_cause,
        .filter = filter_of(probe),
        .reset_address = probe->board.reset_address,
    };
    for (uint8_t i = 0; i < sizeof out->firmware && probe->board.firmware[i]; ++i) {
        out->firmware[i] = probe->board.firmware[i];
    }
    memcpy(out->probe_id, probe->settings.probe_id, sizeof out->probe_id);
    if (identity != NULL) {
        out->sensor = identity->kind;
        memcpy(out->who_am_i, identity->who_am_i, sizeof out->who_am_i);
        memcpy(out->mag_adjust, identity->mag_adjust, sizeof out->mag_adjust);
        out->self_test = identity->self_test;
        out->sample_rate = identity->rate_hz;
        out->acc_lsb = identity->acc_lsb_nm_s2;
        out->gyr_lsb = identity->gyr_lsb_nrad_s;
        out->mag_lsb = identity->mag_lsb_pt;
    }
}

NOINLINE static void keep_hello(const struct probe *probe, struct probe_log *log,
                                uint32_t now_us) {
    uint8_t bytes[MESSAGE_HELLO_SIZE + FRAME_AROUND];
    struct message_hello message;
    make_hello(probe, &message);
    keep(log, bytes, message_hello_encode(&message, log->sequence, now_us, bytes + 1));
}

NOINLINE void probe_say_hello(struct probe *probe, uint32_t now_us) {
    uint8_t bytes[MESSAGE_HELLO_SIZE + FRAME_AROUND];
    struct message_hello message;
    make_hello(probe, &message);
    send(probe, bytes,
         message_hello_encode(&message, probe->sequence, now_us, bytes + 1));
    struct probe_log *const log = log_of(probe);
    if (log != NULL) {
        keep_hello(probe, log, now_us);
    }
}

NOINLINE static void send_status(struct probe *probe, uint32_t now_us) {
    uint8_t bytes[MESSAGE_STATUS_SIZE + FRAME_AROUND];
    struct message_status *status = &probe->status;
    const uint16_t supply_mv = probe->port->supply_mv();
    status->state = (uint8_t)probe_state(probe);
    status->samples_ready = probe->port->samples_ready();
    status->cycles_mean = probe->samples > 0 ? probe->cycles_sum / probe->samples : 0;
    status->stack_free = probe->port->stack_free();
    status->supply = supply_mv > 0 ? supply_mv : STATUS_SUPPLY_NULL;
    ++status->messages_sent;  // itself
    const uint8_t length =
        message_status_encode(status, probe->sequence, now_us, bytes + 1);
    --status->messages_sent;
    send(probe, bytes, length);
    struct probe_log *const log = log_of(probe);
    if (log != NULL) {
        keep(log, bytes,
             message_status_encode(status, log->sequence, now_us, bytes + 1));
    }
    probe->samples = 0;
    probe->cycles_sum = 0;
    status->cycles_worst = 0;
}

NOINLINE static void send_equipment(struct probe *probe, uint32_t now_us) {
    uint8_t bytes[MESSAGE_EQUIPMENT_SIZE + FRAME_AROUND];
    struct message_equipment message = {.battery = EQUIPMENT_BATTERY_NULL};
    probe->port->equipment(&message);
    if (probe->port->log != NULL) {
        message.messages_logged = probe->port->log->kept;
        message.messages_unlogged = probe->port->log->dropped;
    }
    send(probe, bytes,
         message_equipment_encode(&message, probe->sequence, now_us, bytes + 1));
    struct probe_log *const log = log_of(probe);
    if (log != NULL) {
        keep(log, bytes,
             message_equipment_encode(&message, log->sequence, now_us, bytes + 1));
    }
}

static void make_id(struct probe *probe) {
    uint8_t *id = probe->settings.probe_id;
    if (probe->board.unique_id != NULL) {
        memcpy(id, probe->board.unique_id, sizeof probe->settings.probe_id);
        return;
    }
    uint16_t words[4] = {1, 2, 3, 4};
    for (uint8_t i = 0; i < ENTROPY_READINGS; ++i) {
        const uint16_t reading = probe->port->entropy();
        const uint8_t bytes[2] = {(uint8_t)(reading % 256), (uint8_t)(reading / 256)};
        words[i % 4] = frame_crc(words[i % 4], bytes, sizeof bytes);
    }
    words[0] |= 1;  // all zeros would mean that there is none
    memcpy(id, words, sizeof words);
}

void probe_begin(struct probe *probe, const struct probe_port *port,
                 const struct probe_board *board, uint32_t now_us) {
    memset(probe, 0, sizeof *probe);
    probe->port = port;
    probe->board = *board;
    probe->second_us = now_us;
    frame_decoder_init(&probe->decoder, SCHEMA_SEED, MESSAGE_HELLO, probe->received,
                       sizeof probe->received);
    const enum settings_result loaded =
        settings_load(port->storage, &probe->settings, &probe->writer);
    uint8_t id_bits = 0;
    for (uint8_t i = 0; i < sizeof probe->settings.probe_id; ++i) {
        id_bits |= probe->settings.probe_id[i];
    }
    if (id_bits == 0) {
        make_id(probe);
    }
    ++probe->settings.boot_count;
    settings_save(&probe->writer);
    probe_say_hello(probe, now_us);
    if (loaded != SETTINGS_OK) {
        probe_tell(probe, EVENT_SETTINGS_RESTORED, CAUSE_BOOT, loaded, now_us);
    }
}

void probe_sensor_ready(struct probe *probe, const struct sensor_identity *identity,
                        uint32_t now_us) {
    if (probe->identity == NULL) {
        (void)pose_begin(&probe->tracker, &probe->settings.calibration, identity,
                         ATTITUDE_DEFAULT);
    }
    if (probe->is_faulty) {
        ++probe->status.bus_recoveries;
        probe_tell(probe, EVENT_BUS_RECOVERED, CAUSE_NONE, probe->status.bus_recoveries,
                   now_us);
    }
    probe->identity = identity;
    probe->is_faulty = false;
    probe_say_hello(probe, now_us);
}

void probe_sensor_failed(struct probe *probe, enum event event, enum cause cause,
                         int32_t detail, bool is_over, uint32_t now_us) {
    ++probe->status.bus_faults;
    probe_tell(probe, event, cause, detail, now_us);
    if (is_over) {
        probe->is_faulty = true;
    }
}

void probe_overrun(struct probe *probe, uint16_t missed, uint32_t now_us) {
    probe->status.overruns += missed;
    probe_tell(probe, EVENT_OVERRUN, CAUSE_LATE, missed, now_us);
}

static void make_raw(const struct sample *sample, struct message_raw *out) {
    *out = (struct message_raw){
        .acc = {sample->acc.x, sample->acc.y, sample->acc.z},
        .gyr = {sample->gyr.x, sample->gyr.y, sample->gyr.z},
        .mag = {RAW_MAG_NULL, RAW_MAG_NULL, RAW_MAG_NULL},
        .temperature = sample->temperature_cdeg,
        .sample_flags = (uint8_t)((sample->mag_overflow ? SAMPLE_MAG_OVERFLOW : 0) |
                                  (sample->acc_clipped ? SAMPLE_ACC_CLIPPED : 0) |
                                  (sample->gyr_clipped ? SAMPLE_GYR_CLIPPED : 0) |
                                  (sample->has_gap ? SAMPLE_GAP : 0)),
    };
    if (sample->has_mag) {
        out->mag[0] = sample->mag.x;
        out->mag[1] = sample->mag.y;
        out->mag[2] = sample->mag.z;
    }
}

NOINLINE static void send_raw(struct probe *probe, const struct sample *sample) {
    uint8_t bytes[MESSAGE_RAW_SIZE + FRAME_AROUND];
    struct message_raw message;
    make_raw(sample, &message);
    send(probe, bytes,
         message_raw_encode(&message, probe->sequence, sample->time_us, bytes + 1));
}

NOINLINE static void keep_raw(struct probe_log *log, const struct sample *sample) {
    uint8_t bytes[MESSAGE_RAW_SIZE + FRAME_AROUND];
    struct message_raw message;
    make_raw(sample, &message);
    keep(log, bytes,
         message_raw_encode(&message, log->sequence, sample->time_us, bytes + 1));
}

NOINLINE static void send_pose(struct probe *probe, const struct message_pose *message,
                               uint32_t time_us) {
    uint8_t bytes[MESSAGE_POSE_SIZE + FRAME_AROUND];
    send(probe, bytes,
         message_pose_encode(message, probe->sequence, time_us, bytes + 1));
}

NOINLINE static void keep_pose(struct probe_log *log,
                               const struct message_pose *message, uint32_t time_us) {
    uint8_t bytes[MESSAGE_POSE_SIZE + FRAME_AROUND];
    keep(log, bytes, message_pose_encode(message, log->sequence, time_us, bytes + 1));
}

// Reads the pose, for the log where one is kept and for the wire where it is due there.
// What a pose says of all samples since the last one, each of the two has its own.
NOINLINE static void read_pose(struct probe *probe, bool is_due, uint32_t time_us) {
    struct probe_log *const log = log_of(probe);
    if (!is_due && log == NULL) {
        return;
    }
    struct message_pose message;
    pose_read(&probe->tracker, &message);
    if (log != NULL) {
        keep_pose(log, &message, time_us);
        log->unsent_flags |= message.pose_flags & (POSE_CLIPPED | POSE_GAP);
    }
    if (!is_due) {
        return;
    }
    if (!IS_WIRE_ONLY && probe->port->log != NULL) {
        message.pose_flags |= probe->port->log->unsent_flags;
        probe->port->log->unsent_flags = 0;
    }
    send_pose(probe, &message, time_us);
}

// True `rate_hz` times in `of_hz` calls, evenly; always where that is more. The setting
// of a rate may come from before the sensor was known.
static bool is_due(uint16_t *phase, uint16_t rate_hz, uint16_t of_hz) {
    if (rate_hz >= of_hz) {
        return true;
    }
    *phase = (uint16_t)(*phase + rate_hz);
    if (*phase < of_hz) {
        return false;
    }
    *phase = (uint16_t)(*phase - of_hz);
    return true;
}

void probe_sample(struct probe *probe, const struct sample *sample) {
    const uint16_t rate_hz = probe->identity->rate_hz;
    ++probe->status.samples_read;
    const enum pose_result result = pose_step(&probe->tracker, sample);
    ++probe->status.samples_fused;
    if (result == POSE_CALIBRATED) {
        probe_tell(probe, EVENT_CALIBRATION_DONE, CAUSE_NONE, CALIBRATOR_SAMPLES,
                   sample->time_us);
    } else if (result == POSE_MOVED &&
               (!probe->has_told_refusal ||
                sample->time_us - probe->refused_us >= REFUSAL_PERIOD_US)) {
        probe->has_told_refusal = true;
        probe->refused_us = sample->time_us;
        probe_tell(probe, EVENT_CALIBRATION_REFUSED, CAUSE_MOTION,
                   probe->tracker.calibrator.span_counts, sample->time_us);
    }
    // The phases run on while nothing streams, so that the instants of a rate's
    // messages do not depend on when the button was pressed.
    const bool raw_is_due =
        is_due(&probe->raw_phase, probe->settings.raw_rate_hz, rate_hz);
    const bool pose_is_due =
        is_due(&probe->pose_phase, probe->settings.pose_rate_hz, rate_hz);
    probe->is_heavy = probe->is_streaming && pose_is_due && sample->has_mag;
    if (probe->is_streaming && raw_is_due &&
        (probe->settings.streams & STREAM_RAW) != 0) {
        send_raw(probe, sample);
    }
    struct probe_log *const log = log_of(probe);
    if (log != NULL) {
        keep_raw(log, sample);
    }
    read_pose(probe,
              probe->is_streaming && pose_is_due &&
                  (probe->settings.streams & STREAM_POSE) != 0,
              sample->time_us);
}

void probe_log(struct probe *probe, bool is_on, uint32_t now_us) {
    struct probe_log *const log = probe->port->log;
    log->is_on = is_on;
    if (is_on) {
        log->sequence = 0;
        keep_hello(probe, log, now_us);
    }
}

void probe_worked(struct probe *probe, uint32_t cycles) {
    probe->cycles_sum += cycles;
    ++probe->samples;
    if (cycles > probe->status.cycles_worst) {
        probe->status.cycles_worst = cycles;
    }
}

static void set_streaming(struct probe *probe, bool is_streaming, enum cause cause,
                          uint32_t now_us) {
    if (probe->is_streaming == is_streaming) {
        return;
    }
    probe->is_streaming = is_streaming;
    probe_tell(probe, is_streaming ? EVENT_STREAM_STARTED : EVENT_STREAM_STOPPED, cause,
               0, now_us);
}

void probe_stop(struct probe *probe, enum cause cause, uint32_t now_us) {
    set_streaming(probe, false, cause, now_us);
}

static enum result set_rate(struct probe *probe, int32_t value[2]) {
    uint16_t *rate_hz =
        value[0] == 1 ? &probe->settings.raw_rate_hz : &probe->settings.pose_rate_hz;
    const int32_t wanted = value[1];
    value[1] = *rate_hz;
    if (value[0] < 0 || value[0] > 1 || wanted < 1 || wanted > SETTINGS_RATE_MAX_HZ ||
        (probe->identity != NULL && wanted > probe->identity->rate_hz)) {
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
    if (wanted < 1 || wanted > (STREAM_POSE | STREAM_RAW)) {
        return RESULT_BAD_ARGUMENT;
    }
    probe->settings.streams = (uint8_t)wanted;
    value[0] = wanted;
    settings_save(&probe->writer);
    return RESULT_OK;
}

static enum result set_origin(struct probe *probe, const int32_t value[2],
                              uint32_t now_us) {
    if (value[0] < POSE_ORIGIN_FULL || value[0] > POSE_ORIGIN_NONE) {
        return RESULT_BAD_ARGUMENT;
    }
    if (probe->identity == NULL || !probe->tracker.has_sample) {
        return RESULT_NOT_READY;
    }
    pose_set_origin(&probe->tracker, (enum pose_origin)value[0]);
    probe_tell(probe, EVENT_TARED, CAUSE_COMMAND, value[0], now_us);
    return RESULT_OK;
}

static enum result restart(struct probe *probe, int32_t value[2], uint32_t now_us) {
    const int32_t wanted = value[0] == FILTER_NONE ? filter_of(probe) : value[0];
    value[0] = filter_of(probe);
    if (!attitude_has(wanted)) {
        return RESULT_BAD_ARGUMENT;
    }
    if (probe->identity == NULL) {
        return RESULT_NOT_READY;
    }
    (void)pose_begin(&probe->tracker, &probe->settings.calibration, probe->identity,
                     wanted);
    value[0] = wanted;
    probe_tell(probe, EVENT_RESTARTED, CAUSE_COMMAND, wanted, now_us);
    return RESULT_OK;
}

static enum result carry_out(struct probe *probe, const struct message_command *command,
                             uint32_t now_us) {
    int32_t *value = probe->last_value;
    value[0] = command->arguments[0];
    value[1] = command->arguments[1];
    switch (command->command) {
    case COMMAND_START:
        set_streaming(probe, true, CAUSE_COMMAND, now_us);
        return RESULT_OK;
    case COMMAND_STOP:
        set_streaming(probe, false, CAUSE_COMMAND, now_us);
        return RESULT_OK;
    case COMMAND_RATE:
        return set_rate(probe, value);
    case COMMAND_FIELDS:
        return set_fields(probe, value);
    case COMMAND_HELLO:
        probe_say_hello(probe, now_us);
        return RESULT_OK;
    case COMMAND_TARE:
        return set_origin(probe, value, now_us);
    case COMMAND_RESET:
        probe->wants_reset = true;
        return RESULT_OK;
    case COMMAND_RESTART:
        return restart(probe, value, now_us);
    case COMMAND_TIME:
        return RESULT_OK;
    default:
        return RESULT_UNKNOWN_COMMAND;
    }
}

NOINLINE static void send_reply(struct probe *probe,
                                const struct message_command *command,
                                uint32_t now_us) {
    uint8_t bytes[MESSAGE_REPLY_SIZE + FRAME_AROUND];
    const struct message_reply message = {
        .replied_command = command->command,
        .replied_token = command->token,
        .result = probe->last_result,
        .value = {probe->last_value[0], probe->last_value[1]},
    };
    send(probe, bytes,
         message_reply_encode(&message, probe->sequence, now_us, bytes + 1));
}

void probe_receive(struct probe *probe, uint8_t byte, uint32_t now_us) {
    struct message_header header;
    struct message_command command;
    uint8_t length;
    const enum frame_result framed = frame_decode(&probe->decoder, byte, &length);
    if (framed == FRAME_PENDING) {
        return;
    }
    if (framed != FRAME_OK || message_command_decode(probe->received, length, &header,
                                                     &command) != MESSAGE_OK) {
        ++probe->status.commands_bad;
        return;
    }
    ++probe->status.commands_received;
    // A command whose reply was lost comes again with its token: it gets the reply, and
    // is not carried out twice.
    if (command.token == 0 || command.token != probe->last_token) {
        probe->last_result = (uint8_t)carry_out(probe, &command, now_us);
        probe->last_token = command.token;
    }
    send_reply(probe, &command, now_us);
}

static void follow_button(struct probe *probe, bool is_down, uint32_t now_us) {
    switch (button_step(&probe->button, is_down, now_us)) {
    case BUTTON_PRESSED:
        probe_tell(probe, EVENT_BUTTON_PRESSED, CAUSE_BUTTON, 0, now_us);
        break;
    case BUTTON_RELEASED:
        probe_tell(probe, EVENT_BUTTON_RELEASED, CAUSE_BUTTON, 0, now_us);
        set_streaming(probe, !probe->is_streaming, CAUSE_BUTTON, now_us);
        break;
    default:
        break;
    }
}

static void save_settings(struct probe *probe, uint32_t now_us) {
    if (settings_step(&probe->writer, probe->port->storage, &probe->settings) ==
        SETTINGS_FAILED) {
        probe_tell(probe, EVENT_SETTINGS_FAILED, CAUSE_NONE, probe->writer.offset,
                   now_us);
    }
}

void probe_step(struct probe *probe, bool is_button_down, uint32_t now_us) {
    follow_button(probe, is_button_down, now_us);
    // What is not urgent waits a little for a sample that was less work, and goes one
    // at a time.
    if (probe->is_heavy && probe->waits < WAITS_MAX) {
        ++probe->waits;
        return;
    }
    probe->waits = 0;
    const uint32_t elapsed_us = now_us - probe->second_us;
    if (elapsed_us >= SECOND_US) {
        probe->second_us += SECOND_US;
        ++probe->status.uptime;
        probe->said = 0;
        send_status(probe, now_us);
    } else if (!IS_WIRE_ONLY && probe->port->equipment != NULL && probe->said == 0 &&
               elapsed_us >= EQUIPMENT_PHASE_US) {
        probe->said = 1;
        send_equipment(probe, now_us);
    } else if (probe->said < 2 && elapsed_us >= HELLO_PHASE_US) {
        probe->said = 2;
        probe_say_hello(probe, now_us);
    } else {
        save_settings(probe, now_us);
    }
}

enum state probe_state(const struct probe *probe) {
    if (probe->is_faulty) {
        return STATE_FAULT;
    }
    if (probe->is_streaming) {
        return STATE_STREAMING;
    }
    return probe->identity != NULL && probe->tracker.is_calibrated ? STATE_IDLE
                                                                   : STATE_CALIBRATING;
}

bool probe_led(const struct probe *probe, uint32_t now_us) {
    // Where in two seconds it is, as a fraction of 2^32: 2^32 / 2e6 is 2147 and
    // 2077252343 / 2^32. A step more, so that no whole millisecond falls below itself.
    const uint32_t phase =
        now_us * 2147 + fixed_umul_q32(now_us, UINT32_C(2077252343)) + 1;
    switch (probe_state(probe)) {
    case STATE_STREAMING:
        return true;
    case STATE_CALIBRATING:
        return fixed_high_half(phase * 10) < PHASE_MS(1000);
    case STATE_FAULT: {
        const uint16_t in_a_second = fixed_high_half(phase * 2);
        return in_a_second < PHASE_MS(160) ||
               (in_a_second >= PHASE_MS(400) && in_a_second < PHASE_MS(560));
    }
    default:
        return fixed_high_half(phase) < PHASE_MS(50);
    }
}
