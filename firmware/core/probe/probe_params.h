// SPDX-License-Identifier: MIT
// What commands of a host change: the probe's params, told part by part and put in
// force, its filter, its stream. Private to core/probe/.
#ifndef PROBE_PARAMS_H
#define PROBE_PARAMS_H

#include "core/probe/probe.h"

// Loads them; call it once, at boot.
void probe_params_load(struct probe *probe);

// All parts are to be told, or one more than are told already.
void probe_params_tell_all(struct probe *probe);
void probe_params_tell_one(struct probe *probe);

// Begins calibration at rest, filter and origin anew, with a filter that this build
// has, and tells it. There must be a sensor.
void probe_restart(struct probe *probe, int32_t filter);

// As probe_set_streaming(), at probe->now_us.
void probe_stream(struct probe *probe, bool is_streaming, enum cause cause);

#ifdef POSE_WITHOUT_STROKES
#define probe_use_tip(probe) ((void)(probe))
#else
// Puts the tip, and what the button does, in force for the tracker.
void probe_use_tip(struct probe *probe);
#endif

// Tells, writes or checks a little, where there is anything of the kind to do. The
// memory must be ready.
void probe_params_step(struct probe *probe);

#endif
