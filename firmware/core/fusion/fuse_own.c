// SPDX-License-Identifier: MIT
// The probe's own field from one run to the next: what of it is worth keeping, and how
// the filter begins with it.
#include "core/fusion/fuse_stages.h"

enum {
    OWN_SIGMA = ROUNDED(FUSE_OWN_KEPT_SIGMA_UT * 4),
    SURPRISE_MAX = ROUNDED(FUSE_OWN_SURPRISE_MAX_UT * FUSE_OWN_SURPRISE_MAX_UT * 64),
};

#define OWN_SURE Q19(SQUARE(FUSE_OWN_SURE_SIGMA_UT))

void fuse_use_own(struct fuse *fuse, const struct own_field *own) {
    if (own->sigma == 0 || own->sigma > OWN_FIELD_SIGMA_MAX) {
        return;
    }
    const int16_t variance = (int16_t)(own->sigma * own->sigma);  // 16ths of 1 uT2
    if (variance >= fuse->settings.own_variance) {
        return;
    }
    fuse->settings.own_variance = variance;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fuse->state.field_ut[3 + axis] = own->axis[axis] * INT32_C(65536);
    }
}

bool fuse_read_own(const struct fuse *fuse, struct own_field *out) {
    if (fuse->state.field_learnt < FUSE_FIELD_LEARN || fuse->state.doubts != 0 ||
        fuse->state.field_astray > FUSE_FIELD_ASTRAY ||
        fuse->state.field_surprise > SURPRISE_MAX ||
        fuse->settings.own_variance < OWN_SIGMA * OWN_SIGMA) {
        return false;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        if (fuse->state.field_covariance[kalman_variance((uint8_t)(3 + axis))] >
            OWN_SURE) {
            return false;
        }
        out->axis[axis] =
            (int16_t)fixed_byte_floor(fixed_byte_floor(fuse->state.field_ut[3 + axis]));
    }
    out->sigma = OWN_SIGMA;
    return true;
}
