// SPDX-License-Identifier: MIT
// The probe's filter, begun with what the probe knows. Private to core/probe/.
#ifndef PROBE_FILTER_H
#define PROBE_FILTER_H

#include "core/probe/probe_state.h"

// Restarts calibration at rest, filter and origin, with a filter that this build
// has, and tells it. There must be a sensor.
void probe_filter_restart(struct probe *probe, int32_t filter);

#ifdef POSE_WITHOUT_STROKES
#define probe_filter_use_tip(probe) ((void)(probe))
#else
// Puts the tip, and what the button does, in force for the tracker.
void probe_filter_use_tip(struct probe *probe);
#endif

#endif
