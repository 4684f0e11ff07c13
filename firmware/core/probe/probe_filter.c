// SPDX-License-Identifier: MIT
// The probe's filter begins; see probe_filter.h.
#include "core/probe/probe_filter.h"

#include "core/probe/own_field.h"
#include "core/probe/send.h"

#ifndef POSE_WITHOUT_STROKES
void probe_filter_use_tip(struct probe *probe) {
    pose_set_tip(&probe->tracker, &probe->params.tip,
                 probe->params.button_does == BUTTON_DOES_STROKE);
}
#endif

void probe_filter_restart(struct probe *probe, int32_t filter) {
    (void)pose_begin(&probe->tracker, &probe->params.calibration, probe->identity,
                     filter);
    own_field_use(probe);
    probe_filter_use_tip(probe);
    send_event(probe, EVENT_RESTARTED, CAUSE_COMMAND, filter);
}
