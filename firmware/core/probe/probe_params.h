// SPDX-License-Identifier: MIT
// The probe's params, told part by part and put in force. Private to core/probe/.
#ifndef PROBE_PARAMS_H
#define PROBE_PARAMS_H

#include "core/probe/probe_state.h"

// Loads them; call it once, at boot.
void probe_params_load(struct probe *probe);

// All parts are to be told, or one more than are told already.
void probe_params_tell_all(struct probe *probe);
void probe_params_tell_one(struct probe *probe);

// Tells, writes or checks a little, where there is anything of the kind to do. The
// memory must be ready.
void probe_params_step(struct probe *probe);

#endif
