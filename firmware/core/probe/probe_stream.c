// SPDX-License-Identifier: MIT
// The probe's stream; see probe_stream.h.
#include "core/probe/probe_stream.h"

#include <stddef.h>

#include "core/probe/send.h"

// The origin that the params ask for at the start of a stream.
static void set_reference(struct probe *probe, enum cause cause) {
    if (probe->params.reference == REFERENCE_NONE || probe->identity == NULL ||
        !probe->tracker.has_sample) {
        return;
    }
    const enum pose_origin origin = probe->params.reference == REFERENCE_FULL
                                        ? POSE_ORIGIN_FULL
                                        : POSE_ORIGIN_HEADING;
    pose_set_origin(&probe->tracker, origin);
    send_event(probe, EVENT_TARED, cause, (int32_t)origin);
}

void probe_stream(struct probe *probe, bool is_streaming, enum cause cause) {
    if (probe->is_streaming == is_streaming) {
        return;
    }
    probe->is_streaming = is_streaming;
    if (is_streaming) {
        set_reference(probe, cause);
    }
    send_event(probe, is_streaming ? EVENT_STREAM_STARTED : EVENT_STREAM_STOPPED, cause,
               0);
}
