// SPDX-License-Identifier: MIT
// The probe's params: told part by part, changed by commands, put in force. Private to
// core/probe/.
#ifndef PROBE_PARAMS_H
#define PROBE_PARAMS_H

#include "core/probe/probe.h"

// Loads them; call it once, at boot.
void probe_params_load(struct probe *probe, uint32_t now_us);

// All parts are to be told, or one more than are told already.
void probe_params_tell_all(struct probe *probe);
void probe_params_tell_one(struct probe *probe);

// Begins calibration at rest, filter and origin anew, with a filter that this build
// has, and tells it. There must be a sensor.
void probe_restart(struct probe *probe, int32_t filter, uint32_t now_us);

// Tells, writes or checks a little, where there is anything of the kind to do. The
// memory must be ready.
void probe_params_step(struct probe *probe, uint32_t now_us);

#endif
