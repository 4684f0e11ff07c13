// SPDX-License-Identifier: MIT
// The probe's own magnetic field, kept without power; see own_field.h.
#include "core/probe/own_field.h"

#ifndef POSE_WITHOUT_OWN_FIELD

#include <string.h>

#include "core/probe/send.h"

enum {
    LOOK_S = 300,    // from one look to the next
    CHANGED_S = 10,  // a magnet in passing takes less
    // Steps of 0.25 uT.
    NEAR = 16,
    FAR = 32,
    AGE = 2,
};

void own_field_begin(struct probe *probe) {
    struct own_field *own = &probe->settings.own_field;
    if (own->sigma > 0 && own->sigma < OWN_FIELD_SIGMA_MAX) {
        own->sigma = (uint16_t)(own->sigma + AGE);
    }
    own_field_check(probe);
}

void own_field_use(struct probe *probe) {
    pose_use_own(&probe->tracker, &probe->settings.own_field);
}

void own_field_check(struct probe *probe) {
    if (probe->settings.own_calibration != (uint16_t)probe->params.digest) {
        memset(&probe->settings.own_field, 0, sizeof probe->settings.own_field);
    }
}

// Reports it at once: a restarted filter starts with it.
static void keep(struct probe *probe, const struct own_field *own) {
    probe->settings.own_field = *own;
    probe->settings.own_calibration = (uint16_t)probe->params.digest;
    settings_save(&probe->writer);
    send_hello(probe, TO_BOTH);
}

void own_field_forget(struct probe *probe) {
    const struct own_field none = {.sigma = 0};
    memset(&probe->own_watch, 0, sizeof probe->own_watch);
    if (probe->settings.own_field.sigma > 0) {
        keep(probe, &none);
    }
}

// Apart by that much an axis at most.
static bool is_within(const struct own_field *one, const struct own_field *other,
                      uint8_t steps) {
    bool is_within = true;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t apart = (int32_t)one->axis[axis] - other->axis[axis];
        is_within = is_within && fixed_magnitude(apart) <= steps;
    }
    return is_within;
}

// Keeps what two looks have found. Where that is as it was kept, only its sigma may
// have grown with starts since then.
static void look(struct probe *probe, const struct own_field *own) {
    const struct own_field *const kept = &probe->settings.own_field;
    const struct own_field *const seen = &probe->own_watch.seen;
    const bool is_steady = seen->sigma > 0 && is_within(own, seen, NEAR);
    probe->own_watch.seen = *own;
    if (is_steady &&
        (kept->sigma == 0 || kept->sigma > own->sigma || !is_within(own, kept, NEAR))) {
        keep(probe, own);
    }
}

void own_field_look(struct probe *probe) {
    struct own_watch *const watch = &probe->own_watch;
    const struct own_field *const kept = &probe->settings.own_field;
    const struct fuse *const fuse = attitude_fuse(&probe->tracker.attitude);
    struct own_field own;
    if (probe->identity == NULL || fuse == NULL || !fuse_read_own(fuse, &own)) {
        return;
    }
    const bool is_other = kept->sigma > 0 && !is_within(&own, kept, FAR);
    watch->changed_s = is_other ? (uint8_t)(watch->changed_s + 1) : 0;
    if (watch->changed_s == CHANGED_S) {
        own_field_forget(probe);
    } else if (++watch->known_s == LOOK_S) {
        watch->known_s = 0;
        look(probe, &own);
    }
}

#endif
