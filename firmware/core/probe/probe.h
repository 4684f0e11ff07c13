// SPDX-License-Identifier: MIT
// The probe: samples, button and received bytes in, frames out. Its states, its
// messages, what it counts; no hardware and no clock of its own.
#ifndef PROBE_H
#define PROBE_H

#include "core/drivers/button.h"
#include "core/fusion/pose.h"
#include "core/math/in_flash.h"
#include "core/params/store.h"
#include "core/probe/outlet.h"
#include "core/storage/settings.h"
#include "core/wire/frame.h"
#include "core/wire/messages.h"

// A build with PROBE_WIRE_ONLY has nothing beside sensor, wire and button: no log and
// no equipment.
#ifdef PROBE_WIRE_ONLY
enum { PROBE_IS_WIRE_ONLY = true };
#else
enum { PROBE_IS_WIRE_ONLY = false };
#endif

// A card that keeps messages.
struct probe_log {
    struct outlet outlet;
    bool is_on;
    uint32_t earlier;       // messages of the logs before this one, since boot
    uint16_t unsent_flags;  // clipped and gap of poses that were kept and not sent
};

// What a status message has of the probe's own. The runs of members that lie alike in
// both are copied at once.
struct probe_counts {
    uint32_t samples_read, samples_fused, overruns;
    uint16_t bus_faults, bus_recoveries;
    uint16_t commands_received, commands_bad;
    uint32_t uptime;  // s
    uint32_t cycles_worst;
};

// How long the filter has known the probe's own field, and what it found last.
struct own_watch {
    struct own_field seen;
    uint16_t known_s;
    uint8_t changed_s;
};

// What the probe asks of a board.
struct probe_port {
    struct outlet *wire;
    const IN_FLASH struct memory *memory;
    // Fills board, firmware, reset_cause and reset_address.
    void (*describe)(struct message_hello *out);
    // Fills samples_ready, stack_free, supply and receive_lost.
    void (*measure)(struct message_status *out);
    // See board.h.
    bool (*unique_id)(uint8_t id[8]);
    uint16_t (*entropy)(void);
};

// The smaller and the busier a member, the further up: the AVR reaches the first 64
// bytes of a struct in one instruction.
struct probe {
    const IN_FLASH struct probe_port *port;
    const struct sensor_identity *identity;  // NULL until the sensor was found
    bool is_streaming;
    bool is_faulty;  // the sensor does not deliver
    uint8_t said;    // messages of the second that runs
    bool has_told_refusal;
    bool wants_reset;
    uint32_t now_us;             // of what is worked on: messages are stamped with it
    struct message_reply reply;  // to the last command
    uint16_t pose_phase, raw_phase;
    uint16_t samples;  // of the second that runs, and the cycles of their work
    uint32_t cycles_sum;
    uint32_t second_us;  // start of the second that runs
    struct probe_counts status;
    uint32_t refused_us;  // when a refused calibration was last told
    struct settings settings;
    struct settings_writer writer;
    struct params params;
    struct params_store store;
    uint8_t part_at;    // of the params' part that is told next
    uint8_t parts_due;  // parts still to be told
#ifndef POSE_WITHOUT_OWN_FIELD
    struct own_watch own_watch;
#endif
    // NULL where the board has no more than sensor, wire and button.
    struct probe_log *log;
    void (*equipment)(struct message_equipment *out);  // fills all but messages_*
    struct button button;
    struct frame_decoder decoder;
    uint8_t received[MESSAGE_COMMAND_SIZE + FRAME_CRC];  // all that a host sends
    struct pose_tracker tracker;
};

// Loads settings and params, counts the boot, makes the probe's id where it has none.
void probe_begin(struct probe *probe, const IN_FLASH struct probe_port *port,
                 uint32_t now_us);

// The board has more than sensor, wire and button. Both must stay valid.
void probe_equip(struct probe *probe, struct probe_log *log,
                 void (*equipment)(struct message_equipment *out));

// The sensor is set up and samples will come, for the first time or again.
void probe_sensor_ready(struct probe *probe, const struct sensor_identity *identity,
                        uint32_t now_us);

// The sensor or its bus failed; `detail` goes into the event. `is_over`: samples have
// stopped until probe_sensor_ready(); otherwise one sample was lost.
void probe_sensor_failed(struct probe *probe, enum event event, enum cause cause,
                         int32_t detail, bool is_over, uint32_t now_us);

// Data-ready edges were missed: their samples are lost.
void probe_overrun(struct probe *probe, uint16_t missed, uint32_t now_us);

void probe_sample(struct probe *probe, const struct sample *sample);

// What a sample cost, all work for it included.
void probe_worked(struct probe *probe, uint32_t cycles);

void probe_receive(struct probe *probe, uint8_t byte, uint32_t now_us);

// Something happened that a board knows of.
void probe_tell(struct probe *probe, enum event event, enum cause cause, int32_t detail,
                uint32_t now_us);

// Starts or stops streaming and tells it with its cause; nothing where it does already.
void probe_set_streaming(struct probe *probe, bool is_streaming, enum cause cause,
                         uint32_t now_us);

// A host may have come: says who the probe is.
void probe_say_hello(struct probe *probe, uint32_t now_us);

// Starts to keep messages: a hello, then each sample's raw and pose whatever the wire
// gets of them, and all else that is sent. Their sequence starts at 0. Or stops it.
void probe_log(struct probe *probe, bool is_on, uint32_t now_us);

// Button, periodic messages, settings. Call it every 10 ms or oftener.
void probe_step(struct probe *probe, bool is_button_down, uint32_t now_us);

enum state probe_state(const struct probe *probe);

// Idle: a flash of 50 ms every 2 s. Calibrating: 5 blinks a second. Streaming: on.
// Fault: two short flashes a second.
bool probe_led(const struct probe *probe, uint32_t now_us);

#endif
