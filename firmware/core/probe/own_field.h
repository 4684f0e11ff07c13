// SPDX-License-Identifier: MIT
// The probe's own magnetic field, kept without power for the filter to begin with.
// Private to core/probe/.
//
// It is kept where a calibration does not tell it better, the filter knows it to 2 uT
// an axis, and two looks agree, between which it was known for five minutes. It is
// forgotten where the filter knows it to be another, and with another calibration.
#ifndef OWN_FIELD_H
#define OWN_FIELD_H

#include "core/probe/probe_state.h"

// A build with POSE_WITHOUT_OWN_FIELD keeps none.
#ifdef POSE_WITHOUT_OWN_FIELD
#define own_field_begin(probe) ((void)(probe))
#define own_field_use(probe) ((void)(probe))
#define own_field_check(probe) ((void)(probe))
#define own_field_look(probe) ((void)(probe))
#define own_field_forget(probe) ((void)(probe))
#else

// At boot, once the params are loaded. A probe has no clock without power: each start
// adds 0.5 uT to its sigma, up to 10 uT.
void own_field_begin(struct probe *probe);

// Hands the tracker what was kept, after pose_begin().
void own_field_use(struct probe *probe);

// Forgets it where the params calibrate otherwise than when it was found.
void own_field_check(struct probe *probe);

// Once a second: keeps or forgets it, where that is due.
void own_field_look(struct probe *probe);

void own_field_forget(struct probe *probe);

#endif

#endif
