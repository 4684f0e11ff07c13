// SPDX-License-Identifier: MIT
// The probe's params; see probe_params.h.
#include "core/probe/probe_params.h"

#include <stddef.h>

#include "core/drivers/ports_of.h"
#include "core/probe/own_field.h"
#include "core/probe/probe_filter.h"
#include "core/probe/send.h"

void probe_params_load(struct probe *probe) {
    const bool is_whole =
        params_store_open(&probe->store, PROBE_PORT(probe)->memory, &probe->params);
    if (!is_whole) {
        send_event(probe, EVENT_PARAMS_LOST, CAUSE_WORN,
                   (int32_t)probe->store.bank.list.digest);
    }
}

void probe_params_tell_all(struct probe *probe) {
    probe->part_at = 0;
    // One, too, where there are no records.
    probe->parts_due = (uint8_t)(probe->store.bank.list.length / PARAMS_PART + 1);
}

void probe_params_tell_one(struct probe *probe) {
    if (probe->parts_due == 0) {
        probe->parts_due = 1;
    }
}

static void tell_part(struct probe *probe) {
    const uint8_t length = probe->store.bank.list.length;
    --probe->parts_due;
    if (probe->part_at != 0 && probe->part_at >= length) {
        probe->part_at = 0;  // after the last part it is the self-test's turn
        if (probe->identity != NULL && probe->identity->answers != NULL) {
            send_self_test(probe);
            return;
        }
    }
    send_params(probe, BANK_CURRENT, probe->part_at);
    probe->part_at = (uint8_t)(probe->part_at + PARAMS_PART);
    if (probe->part_at >= length) {
        probe->parts_due = 0;  // one was too many where parts divide the length
    }
}

// Activates the current params. The filter restarts if it was fed by another
// calibration, whose units what it has learned is in, unless the host knows that the
// axes are the same.
static void change(struct probe *probe) {
    const uint32_t before = probe->params.digest;
    (void)params_store_load(&probe->store, &probe->params);
    own_field_check(probe);
    send_event(probe, EVENT_PARAMS_CHANGED, CAUSE_COMMAND,
               (int32_t)probe->store.bank.list.digest);
    const bool is_other = before != probe->params.digest;
    if (probe->identity != NULL && is_other && !probe->store.goes_on) {
        probe_filter_restart(probe, probe_state_filter(probe));
    } else if (probe->identity != NULL) {
        if (is_other) {
            pose_recalibrate(&probe->tracker);
        }
        probe_filter_use_tip(probe);
    }
    send_hello(probe, TO_BOTH);
    probe->part_at = 0;
}

void probe_params_step(struct probe *probe) {
    switch (params_store_step(&probe->store)) {
    case PARAMS_CHANGED:
        change(probe);
        break;
    case PARAMS_TELLS:
        send_params(probe, BANK_SPARE, probe->store.told);
        break;
    case PARAMS_IDLE:
        if (probe->parts_due > 0) {
            tell_part(probe);
        }
        break;
    default:
        break;
    }
}
