// SPDX-License-Identifier: MIT
// A probe's computation alone, for each processor in its emulator: the frames of a log
// come in over the wire, the poses that its samples give go out. Each frame is answered
// with one zero, be it a pose's delimiter: so the host knows when to send the next. One
// answers its first byte.
#include <string.h>

#include "board.h"
#include "core/drivers/delays.h"
#include "core/fusion/pose.h"
#include "core/params/store.h"
#include "core/probe/probe.h"
#include "core/wire/frame.h"
#include "core/wire/messages.h"

static struct frame_decoder decoder;
static uint8_t content[MESSAGE_CONTENT_MAX + FRAME_CRC];
static struct sensor_identity identity;
static uint8_t records[PARAMS_ROOM];  // of the params that were told last
static struct message_params told;    // whose they are
static struct params params;
static struct pose_tracker tracker;
#ifndef POSE_WITHOUT_OWN_FIELD
static struct own_field own;  // as the last hello told it
#endif
static bool has_sensor;
static bool has_sample;  // no further hello restarts it

static void send(const uint8_t *bytes, uint8_t length) {
    while (!board_send(bytes, length)) {
        board_watchdog_kick();
    }
}

static void take_params(uint8_t length) {
    struct message_header header;
    struct message_params part;
    if (message_params_decode(content, length, &header, &part) != MESSAGE_OK ||
        part.set_length > PARAMS_ROOM || part.part_offset >= part.set_length) {
        return;
    }
    const uint16_t left = (uint16_t)(part.set_length - part.part_offset);
    memcpy(records + part.part_offset, part.part,
           left < sizeof part.part ? left : sizeof part.part);
    told = part;
}

static uint8_t record_byte(void *port, uint16_t at) {
    (void)port;
    return records[at];
}

// The params of that digest. What can't be read leaves poses that differ.
static void put_in_force(uint32_t digest) {
    static const IN_FLASH struct memory memory = {.read = record_byte};
    const uint8_t length = (uint8_t)(digest == told.set_digest ? told.set_length : 0);
    uint8_t tag;
    if (params_read(&memory, 0, length, &params, &tag) != PARAMS_FINE) {
        calibration_clear(&params.calibration);
    }
}

static void use_tip(void) {
#ifndef POSE_WITHOUT_STROKES
    pose_set_tip(&tracker, &params.tip, params.button_does == BUTTON_DOES_STROKE);
#endif
}

static void keep_own(const struct message_hello *hello) {
#ifndef POSE_WITHOUT_OWN_FIELD
    memcpy(own.axis, hello->own_field, sizeof own.axis);
    own.sigma = hello->own_sigma;
#else
    (void)hello;
#endif
}

static void use_own(void) {
#ifndef POSE_WITHOUT_OWN_FIELD
    pose_use_own(&tracker, &own);
#endif
}

static void take_hello(uint8_t length) {
    struct message_header header;
    struct message_hello hello;
    if (message_hello_decode(content, length, &header, &hello) != MESSAGE_OK ||
        hello.sample_rate == 0) {
        return;
    }
    keep_own(&hello);
    if (has_sample) {
        return;
    }
    identity = (struct sensor_identity){
        .kind = hello.sensor,
        .who_am_i = {hello.who_am_i[0]},
        .rate_hz = hello.sample_rate,
        .gyr_lsb_nrad_s = hello.gyr_lsb,
        .acc_lsb_nm_s2 = hello.acc_lsb,
        .mag_lsb_pt = hello.mag_lsb,
    };
    if (!delays_of_kind(&identity)) {
        return;
    }
    put_in_force(hello.params_digest);
    has_sensor = pose_begin(&tracker, &params.calibration, &identity, hello.filter);
    use_own();
    use_tip();
}

static struct counts counts_of(const int16_t values[3]) {
    return (struct counts){.x = values[0], .y = values[1], .z = values[2]};
}

static void take_raw(uint8_t length) {
    struct message_header header;
    struct message_raw raw;
    if (message_raw_decode(content, length, &header, &raw) != MESSAGE_OK) {
        return;
    }
    struct sample sample = {
        .time_us = header.time_us,
        .acc = counts_of(raw.acc),
        .gyr = counts_of(raw.gyr),
        .temperature_cdeg = raw.temperature,
        .has_mag = raw.mag[0] != RAW_MAG_NULL,
        .mag_overflow = (raw.sample_flags & SAMPLE_MAG_OVERFLOW) != 0,
        .acc_clipped = (raw.sample_flags & SAMPLE_ACC_CLIPPED) != 0,
        .gyr_clipped = (raw.sample_flags & SAMPLE_GYR_CLIPPED) != 0,
        .has_gap = (raw.sample_flags & SAMPLE_GAP) != 0,
    };
    if (sample.has_mag) {
        sample.mag = counts_of(raw.mag);
    }
    (void)pose_step(&tracker, &sample);
    has_sample = true;
}

static void take_event(uint8_t length) {
    struct message_header header;
    struct message_event event;
    if (message_event_decode(content, length, &header, &event) != MESSAGE_OK) {
        return;
    }
    if (event.event == EVENT_TARED) {
        pose_set_origin(&tracker, (enum pose_origin)event.detail);
    } else if (event.event == EVENT_RESTARTED) {
        (void)pose_begin(&tracker, &params.calibration, &identity, event.detail);
        use_own();
        use_tip();
    } else if (event.event == EVENT_PARAMS_CHANGED) {
        put_in_force((uint32_t)event.detail);
        use_tip();
    }
}

// A pose of the log asks for that pose.
static bool answer(uint8_t length) {
    struct message_header header;
    struct message_pose pose;
    if (message_pose_decode(content, length, &header, &pose) != MESSAGE_OK) {
        return false;
    }
    uint8_t bytes[MESSAGE_POSE_SIZE + FRAME_AROUND];
    pose_read(&tracker, &pose);
    const uint8_t size =
        message_pose_encode(&pose, header.sequence, header.time_us, bytes + 1);
    send(bytes, frame_encode(SCHEMA_SEED, bytes, size));
    return true;
}

static const uint8_t zero = 0;
static const uint8_t here = 1;
static bool is_heard;  // a byte came

static void take(uint8_t length) {
    bool is_answered = false;
    if (content[0] == MESSAGE_HELLO) {
        take_hello(length);
    } else if (content[0] == MESSAGE_PARAMS) {
        take_params(length);
    } else if (has_sensor && content[0] == MESSAGE_RAW) {
        take_raw(length);
    } else if (has_sensor && content[0] == MESSAGE_EVENT) {
        take_event(length);
    } else if (has_sensor && content[0] == MESSAGE_POSE) {
        is_answered = answer(length);
    }
    if (!is_answered) {
        send(&zero, 1);
    }
}

// What the board's equipment would tell is no pose.
static bool swallow(const uint8_t *bytes, uint8_t length) {
    (void)bytes;
    (void)length;
    return true;
}

int main(void) {
    static struct outlet wire = {.put = swallow};
    static struct probe probe;  // without a sensor
    static const IN_FLASH struct probe_port port = {.wire = &wire};
    probe.port = &port;
    board_init();
    board_equipment_begin(&probe);
    frame_decoder_init(&decoder, SCHEMA_SEED, MESSAGE_HELLO, content, sizeof content);
    for (;;) {
        board_watchdog_kick();
        for (int16_t byte = board_receive(); byte >= 0; byte = board_receive()) {
            uint8_t length;
            if (!is_heard) {
                send(&zero, 1);
            }
            is_heard = true;
            if (frame_decode(&decoder, (uint8_t)byte, &length) == FRAME_OK) {
                take(length);
            }
        }
        board_equipment_step(&probe, board_time_us());
        // Nobody may have the port open yet.
        if (!is_heard) {
            send(&here, 1);
        }
        board_idle();
    }
}
