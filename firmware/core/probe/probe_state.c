// SPDX-License-Identifier: MIT
// The state of a probe; see probe_state.h.
#include "core/probe/probe_state.h"

enum state probe_state(const struct probe *probe) {
    if (probe->is_faulty) {
        return STATE_FAULT;
    }
    if (probe->is_streaming) {
        return STATE_STREAMING;
    }
    return probe->identity != NULL && probe->tracker.is_calibrated ? STATE_IDLE
                                                                   : STATE_CALIBRATING;
}
