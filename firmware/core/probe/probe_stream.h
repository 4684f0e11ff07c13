// SPDX-License-Identifier: MIT
// The probe's stream of poses and raw samples, on or off. Private to core/probe/.
#ifndef PROBE_STREAM_H
#define PROBE_STREAM_H

#include "core/probe/probe_state.h"

// Starts or stops it and tells it with its cause, at probe->now_us; nothing where it
// does already.
void probe_stream(struct probe *probe, bool is_streaming, enum cause cause);

#endif
