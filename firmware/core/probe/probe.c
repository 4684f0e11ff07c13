// SPDX-License-Identifier: MIT
// The probe: its start, its samples, its steps, its light; see probe.h.
#include "core/probe/probe.h"

#include <stddef.h>
#include <string.h>

#include "core/drivers/ports_of.h"
#include "core/math/constant.h"
#include "core/probe/own_field.h"
#include "core/probe/probe_filter.h"
#include "core/probe/probe_params.h"
#include "core/probe/probe_stream.h"
#include "core/probe/send.h"

enum { ENTROPY_READINGS = 64 };

#define SECOND_US UINT32_C(1000000)
// The messages of each second are apart: never two at once.
#define EQUIPMENT_PHASE_US UINT32_C(250000)
#define HELLO_PHASE_US UINT32_C(500000)
#define REFUSAL_PERIOD_US UINT32_C(5000000)

// Milliseconds of two seconds as a fraction of 2^16, floored.
#define PHASE_MS(ms) ((uint16_t)(UINT32_C(65536) * (ms) / 2000))

static void make_id(struct probe *probe) {
    uint8_t *id = probe->settings.probe_id;
    if (PROBE_PORT(probe)->unique_id(id)) {
        return;
    }
    for (uint8_t i = 0; i < ENTROPY_READINGS; ++i) {
        // Little endian, as messages.c asserts of all our processors. The number makes
        // the parts of an id differ where all readings are equal.
        const uint16_t reading = (uint16_t)(PROBE_PORT(probe)->entropy() + i);
        uint8_t *const at = &id[2 * (i % 4)];
        uint16_t word;
        memcpy(&word, at, sizeof word);
        word = frame_crc(word, (const uint8_t *)&reading, sizeof reading);
        memcpy(at, &word, sizeof word);
    }
    id[0] |= 1;  // all zeros would mean that there is none
}

void probe_begin(struct probe *probe, const IN_FLASH struct probe_port *port,
                 uint32_t now_us) {
    memset(probe, 0, sizeof *probe);
    SET_PORT(probe, port);
    probe->now_us = now_us;
    probe->second_us = now_us;
    probe->status.temperature = STATUS_TEMPERATURE_NULL;
    frame_decoder_init(&probe->decoder, SCHEMA_SEED, MESSAGE_HELLO, probe->received,
                       sizeof probe->received);
    const enum settings_result loaded =
        settings_load(PROBE_PORT(probe)->memory, &probe->settings, &probe->writer);
    uint8_t id_bits = 0;
    for (uint8_t i = 0; i < sizeof probe->settings.probe_id; ++i) {
        id_bits |= probe->settings.probe_id[i];
    }
    if (id_bits == 0) {
        make_id(probe);
    }
    ++probe->settings.boot_count;
    settings_save(&probe->writer);
    probe_params_load(probe);
    own_field_begin(probe);
    send_hello(probe, TO_BOTH);
    probe_params_tell_all(probe);
    if (loaded != SETTINGS_OK) {
        send_event(probe, EVENT_SETTINGS_RESTORED, CAUSE_BOOT, loaded);
    }
}

void probe_equip(struct probe *probe, struct probe_log *log,
                 void (*equipment)(struct message_equipment *out)) {
    probe->log = log;
    probe->equipment = equipment;
}

void probe_sensor_ready(struct probe *probe, const struct sensor_identity *identity,
                        uint32_t now_us) {
    probe->now_us = now_us;
    if (probe->identity == NULL) {
        (void)pose_begin(&probe->tracker, &probe->params.calibration, identity,
                         ATTITUDE_DEFAULT);
        own_field_use(probe);
        probe_filter_use_tip(probe);
    }
    if (probe->is_faulty) {
        ++probe->status.bus_recoveries;
        send_event(probe, EVENT_BUS_RECOVERED, CAUSE_NONE,
                   probe->status.bus_recoveries);
    }
    probe->identity = identity;
    probe->is_faulty = false;
    send_hello(probe, TO_BOTH);
    probe_params_tell_all(probe);
}

void probe_sensor_failed(struct probe *probe, enum event event, enum cause cause,
                         int32_t detail, bool is_over, uint32_t now_us) {
    ++probe->status.bus_faults;
    probe->now_us = now_us;
    send_event(probe, event, cause, detail);
    if (is_over) {
        probe->is_faulty = true;
    }
}

void probe_overrun(struct probe *probe, uint16_t missed, uint32_t now_us) {
    probe->status.overruns += missed;
    probe->now_us = now_us;
    send_event(probe, EVENT_OVERRUN, CAUSE_LATE, missed);
}

// True `rate_hz` times in `of_hz` calls, evenly; always where that is more. The setting
// of a rate may come from before the sensor was known. Not inline: two copies would
// take more of the AVR's flash.
__attribute__((noinline)) static bool is_due(uint16_t *phase, uint16_t rate_hz,
                                             uint16_t of_hz) {
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

// The wire gets what is due of a stream, the card each sample's.
static uint8_t outlets_of(const struct probe *probe, uint8_t stream, bool is_due) {
    const bool is_sent =
        probe->is_streaming && is_due && (probe->settings.streams & stream) != 0;
    return is_sent ? TO_BOTH : TO_CARD;
}

void probe_sample(struct probe *probe, const struct sample *sample) {
    const uint16_t rate_hz = probe->identity->rate_hz;
    probe->now_us = sample->time_us;
    ++probe->status.samples_read;
    probe->status.temperature = sample->temperature_cdeg;
    const enum pose_result result = pose_step(&probe->tracker, sample);
    ++probe->status.samples_fused;
    if (result == POSE_CALIBRATED) {
        send_event(probe, EVENT_CALIBRATION_DONE, CAUSE_NONE, CALIBRATOR_SAMPLES);
    } else if (result == POSE_MOVED &&
               (!probe->has_told_refusal ||
                probe->now_us - probe->refused_us >= REFUSAL_PERIOD_US)) {
        probe->has_told_refusal = true;
        probe->refused_us = probe->now_us;
        send_event(probe, EVENT_CALIBRATION_REFUSED, CAUSE_MOTION,
                   probe->tracker.calibrator.span_counts);
    }
    // The phases run on while nothing streams, so that the instants of a rate's
    // messages do not depend on when the button was pressed.
    const bool raw_is_due =
        is_due(&probe->raw_phase, probe->settings.raw_rate_hz, rate_hz);
    const bool pose_is_due =
        is_due(&probe->pose_phase, probe->settings.pose_rate_hz, rate_hz);
    send_raw(probe, outlets_of(probe, STREAM_RAW, raw_is_due), sample);
    send_pose(probe, outlets_of(probe, STREAM_POSE, pose_is_due));
    send_stroke(probe, outlets_of(probe, STREAM_POSE, true));
}

void probe_tell(struct probe *probe, enum event event, enum cause cause, int32_t detail,
                uint32_t now_us) {
    probe->now_us = now_us;
    send_event(probe, event, cause, detail);
}

void probe_say_hello(struct probe *probe, uint32_t now_us) {
    probe->now_us = now_us;
    send_hello(probe, TO_BOTH);
}

void probe_log(struct probe *probe, bool is_on, uint32_t now_us) {
    struct probe_log *const log = probe->log;
    log->is_on = is_on;
    if (is_on) {
        log->earlier += log->outlet.sequence;
        log->outlet.sequence = 0;
        probe->now_us = now_us;
        send_hello(probe, TO_CARD);
        probe_params_tell_all(probe);
    }
}

void probe_worked(struct probe *probe, uint32_t cycles) {
    probe->cycles_sum += cycles;
    ++probe->samples;
    if (cycles > probe->status.cycles_worst) {
        probe->status.cycles_worst = cycles;
    }
}

void probe_set_streaming(struct probe *probe, bool is_streaming, enum cause cause,
                         uint32_t now_us) {
    probe->now_us = now_us;
    probe_stream(probe, is_streaming, cause);
}

#ifdef POSE_WITHOUT_STROKES
#define hold(probe, is_held) false
#else
// The button is held for a stroke, or no longer. True where it was held for so long
// that a stroke has begun, or was refused: then its release is no click.
static bool hold(struct probe *probe, bool is_held) {
    if (probe->identity == NULL) {
        return false;
    }
    const struct stroke *stroke = &probe->tracker.stroke;
    const bool is_stroke = stroke->is_held && stroke->countdown == 0;
    pose_hold(&probe->tracker, is_held);
    return is_stroke && probe->params.button_does == BUTTON_DOES_STROKE;
}
#endif

static void follow_button(struct probe *probe, bool is_down) {
    switch (button_step(&probe->button, is_down, probe->now_us)) {
    case BUTTON_PRESSED:
        send_event(probe, EVENT_BUTTON_PRESSED, CAUSE_BUTTON, 0);
        (void)hold(probe, true);
        break;
    case BUTTON_RELEASED:
        send_event(probe, EVENT_BUTTON_RELEASED, CAUSE_BUTTON, 0);
        if (!hold(probe, false) && probe->params.button_does != BUTTON_DOES_TELL) {
            probe_stream(probe, !probe->is_streaming, CAUSE_BUTTON);
        }
        break;
    default:
        break;
    }
}

// Work for the memory, of which only one runs at a time.
static void use_memory(struct probe *probe) {
    const IN_FLASH struct memory *const memory = MEMORY_PORT(PROBE_PORT(probe)->memory);
    if (!memory->is_ready(memory->port)) {
        return;
    }
    switch (settings_step(&probe->writer, &probe->settings)) {
    case MEMORY_FAILED:
        send_event(probe, EVENT_SETTINGS_FAILED, CAUSE_NONE,
                   probe->writer.bank.writer.last);
        break;
    case MEMORY_OK:
        probe_params_step(probe);
        break;
    default:
        break;
    }
}

void probe_step(struct probe *probe, bool is_button_down, uint32_t now_us) {
    probe->now_us = now_us;
    follow_button(probe, is_button_down);
    // One message or write at a time.
    const uint32_t elapsed_us = now_us - probe->second_us;
    if (elapsed_us >= SECOND_US) {
        probe->second_us += SECOND_US;
        ++probe->status.uptime;
        probe->said = 0;
#ifndef POSE_WITHOUT_STROKES
        probe->blinks = (uint8_t)(probe->blinks - (probe->blinks > 0));
#endif
        send_status(probe);
        own_field_look(probe);
    } else if (!PROBE_IS_WIRE_ONLY && probe->equipment != NULL && probe->said == 0 &&
               elapsed_us >= EQUIPMENT_PHASE_US) {
        probe->said = 1;
        send_equipment(probe);
    } else if (probe->said < 2 && elapsed_us >= HELLO_PHASE_US) {
        probe->said = 2;
        send_hello(probe, TO_BOTH);
        probe_params_tell_one(probe);
    } else {
        use_memory(probe);
    }
}

bool probe_led(const struct probe *probe, uint32_t now_us) {
    // Phase within two seconds, as a fraction of 2^16. One step is added, so that no
    // whole millisecond rounds down.
    const uint16_t phase =
        (uint16_t)(fixed_umul_q32(now_us, Q32_UNSIGNED(65536 / 2e6)) + 1);
#ifndef POSE_WITHOUT_STROKES
    if (probe->blinks > 0) {
        return (uint16_t)(phase * 20u) < PHASE_MS(1000);
    }
#endif
    switch (probe_state(probe)) {
    case STATE_STREAMING:
        return true;
    case STATE_CALIBRATING:
        return (uint16_t)(phase * 10u) < PHASE_MS(1000);
    case STATE_FAULT: {
        const uint16_t in_a_second = (uint16_t)(phase * 2u);
        return in_a_second < PHASE_MS(160) ||
               (in_a_second >= PHASE_MS(400) && in_a_second < PHASE_MS(560));
    }
    default:
        return phase < PHASE_MS(50);
    }
}
