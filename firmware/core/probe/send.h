// SPDX-License-Identifier: MIT
// Every message of a probe, each made by one function, for the wire and the card alike.
// Private to core/probe/; what boards may send is in probe.h. Each is stamped with
// probe->now_us.
#ifndef SEND_H
#define SEND_H

#include "core/probe/probe_state.h"

// Where a message goes. The card takes it only while a log is kept.
enum {
    TO_WIRE = 1,
    TO_CARD = PROBE_IS_WIRE_ONLY ? 0 : 2,
    TO_BOTH = TO_WIRE | TO_CARD,
};

void send_event(struct probe *probe, enum event event, enum cause cause,
                int32_t detail);
void send_hello(struct probe *probe, uint8_t outlets);
// Ends the second whose load it tells.
void send_status(struct probe *probe);
void send_equipment(struct probe *probe);
// The part of the params at `at`, of those in force or of those that are to be.
void send_params(struct probe *probe, enum bank_side side, uint8_t at);
// Sends the sensor responses that the host evaluates; there must be some.
void send_self_test(struct probe *probe);
void send_reply(struct probe *probe);
void send_raw(struct probe *probe, uint8_t outlets, const struct sample *sample);
// Reads the pose of the last sample, where it goes anywhere.
void send_pose(struct probe *probe, uint8_t outlets);
#ifdef POSE_WITHOUT_STROKES
#define send_stroke(probe, outlets) ((void)(probe))
#else
// Sends the state of a stroke after the last sample, if there is one.
void send_stroke(struct probe *probe, uint8_t outlets);
#endif

#endif
