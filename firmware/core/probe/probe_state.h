// SPDX-License-Identifier: MIT
// The state of a probe, and the board functions that it needs. All of core/probe/ works
// on this struct; see probe.h for who calls whom.
#ifndef PROBE_STATE_H
#define PROBE_STATE_H

#include <stddef.h>

#include "core/drivers/button.h"
#include "core/fusion/pose.h"
#include "core/math/in_flash.h"
#include "core/params/store.h"
#include "core/probe/outlet.h"
#include "core/storage/settings.h"
#include "core/wire/frame.h"
#include "core/wire/messages.h"

// A build with PROBE_WIRE_ONLY has sensor, wire and button only: no log and
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
    int16_t temperature;  // of the last sample, 0.01 degC
};

// How long the filter has known the probe's own field, and what it found last.
struct own_watch {
    struct own_field seen;
    uint16_t known_s;
    uint8_t changed_s;
};

// The board functions that a probe needs.
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
#ifndef PORTS_FIXED
    const IN_FLASH struct probe_port *port;
#endif
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
#ifndef POSE_WITHOUT_STROKES
    uint8_t blinks;  // seconds in which the LED tells that a press has measured nothing
#endif
    // NULL where the board has no more than sensor, wire and button.
    struct probe_log *log;
    void (*equipment)(struct message_equipment *out);  // fills all but messages_*
    struct button button;
    struct frame_decoder decoder;
    uint8_t received[MESSAGE_COMMAND_SIZE + FRAME_CRC];  // all that a host sends
    struct pose_tracker tracker;
};

enum state probe_state(const struct probe *probe);

// The filter in use, or the one that will run once there is a sensor: enum filter.
static inline uint8_t probe_state_filter(const struct probe *probe) {
    return (uint8_t)(probe->identity != NULL ? attitude_kind(&probe->tracker.attitude)
                                             : ATTITUDE_DEFAULT);
}

#endif
