// SPDX-License-Identifier: MIT
// Detects impossible readings: a field that is not the Earth's, or not that of the
// calibration, and dead sensors.
#include <string.h>

#include "core/fusion/fuse_stages.h"

enum {
    FUSE_FIELD = FUSE_IMPOSSIBLE | FUSE_UNLIKE,
    UNLIKE_PART = FUSE_UNLIKE_PART,
    PLAIN = FUSE_WINDOWS(FUSE_PLAIN_S),
};

// Squares of quarters of 1 uT.
#define EARTH_MIN_SQUARE ROUNDED(SQUARE(FUSE_EARTH_MIN_UT * 4))
#define EARTH_MAX_SQUARE ROUNDED(SQUARE(FUSE_EARTH_MAX_UT * 4))
#define FAR_Q18 Q18(FUSE_SURPRISE_MAX_UT)
#define OWN_IMPOSSIBLE_Q18 Q18(FUSE_OWN_IMPOSSIBLE_UT)
#define OWN_NEAR_Q18 Q18(FUSE_OWN_NEAR_UT)
#define ELSEWHERE_VARIANCE Q19(SQUARE(FUSE_ELSEWHERE_SIGMA_UT))

// One copy, whose numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

uint8_t fuse_repeats(struct fuse_repeats *repeats, const struct vector *v) {
    // Not the lowest byte, in which a count of a sensor may be a whole number of steps.
    const uint8_t sum = (uint8_t)fixed_byte_floor(v->x + v->y + v->z);
    if (sum != repeats->sum) {
        repeats->sum = sum;
        repeats->count = 0;
    } else if (repeats->count < UINT8_MAX) {
        ++repeats->count;
    }
    return repeats->count;
}

void fuse_forget_place(struct fuse *fuse) {
    fuse->state.field_learnt = 0;
    fuse->state.heading_variance = FUSE_HEADING_VARIANCE_MAX_Q30;
}

static int16_t magnitude(int16_t value) {
    return (int16_t)(value < 0 ? -value : value);
}

void fuse_set_known_field(struct fuse *fuse, const struct calibration *calibration) {
    const bool is_known = calibration->field_north != CALIBRATION_NO_FIELD;
    fuse->settings.known_north = 0;
    fuse->settings.known_up = 0;
    if (is_known) {
        fuse->settings.known_north = calibration->field_north;
        fuse->settings.known_up = calibration->field_up;
    }
}

// The fault of a field: 0, FUSE_IMPOSSIBLE or FUSE_UNLIKE.
NOINLINE static uint8_t doubt_of(const struct fuse *fuse, q14_18_t horizontal_ut,
                                 q14_18_t up_ut) {
    const struct fuse_settings *settings = &fuse->settings;
    // Quarters of 1 uT: the upper halves.
    const int16_t horizontal = (int16_t)fixed_high_half(
        (uint32_t)fixed_clamp_high(horizontal_ut, FIXED_HIGH(FAR_Q18)));
    const int16_t up = (int16_t)fixed_high_half(
        (uint32_t)fixed_clamp_high(up_ut, FIXED_HIGH(FAR_Q18)));
    const int32_t square = (int32_t)horizontal * horizontal + (int32_t)up * up;
    if (square < EARTH_MIN_SQUARE || square > EARTH_MAX_SQUARE) {
        return FUSE_IMPOSSIBLE;
    }
    const int16_t known =
        (int16_t)(magnitude(settings->known_north) + magnitude(settings->known_up));
    const int16_t apart =
        (int16_t)(magnitude((int16_t)(horizontal - settings->known_north)) +
                  magnitude((int16_t)(up - settings->known_up)));
    return known > 0 && UNLIKE_PART * apart > known ? FUSE_UNLIKE : 0;
}

NOINLINE static bool is_plain(const struct fuse *fuse,
                              const struct vector *field_ut_q18) {
    struct vector horizontal = *field_ut_q18;
    horizontal.z = 0;
    return doubt_of(fuse, vector_normalise(&horizontal), field_ut_q18->z) == 0;
}

bool fuse_is_plain_again(struct fuse *fuse) {
    if ((!fuse->state.is_own_unknown && (fuse->state.doubts & FUSE_FIELD) == 0) ||
        is_plain(fuse, &fuse->state.place_ut_q18) ||
        !is_plain(fuse, &fuse->state.reading_ut_q18)) {
        fuse->state.field_plain = 0;
        return false;
    }
    ++fuse->state.field_plain;
    return fuse->state.field_plain == PLAIN;
}

// Turning has shown that the probe has no own field.
static bool has_shown_no_own(const struct fuse *fuse) {
    for (uint8_t axis = 3; axis < FUSE_FIELD_STATES; ++axis) {
        if (fuse->state.field_covariance[kalman_variance(axis)] > ELSEWHERE_VARIANCE) {
            return false;
        }
    }
    return !vector_exceeds(&fuse->state.own_ut_q18, OWN_NEAR_Q18);
}

void fuse_doubt_place(struct fuse *fuse, q14_18_t horizontal_ut) {
    uint8_t doubt = doubt_of(fuse, horizontal_ut, fuse->state.place_ut_q18.z);
    if (fuse->state.is_own_unknown && has_shown_no_own(fuse)) {
        if (doubt == 0) {
            fuse->state.is_own_unknown = false;
        }
        if (doubt == FUSE_UNLIKE) {  // it is elsewhere
            doubt = 0;
        }
    }
    if (fuse->settings.own_variance > FUSE_OWN_CALIBRATED &&
        vector_exceeds(&fuse->state.own_ut_q18, OWN_IMPOSSIBLE_Q18)) {
        doubt = FUSE_IMPOSSIBLE;
    }
    fuse->state.doubts = (uint8_t)((fuse->state.doubts & FUSE_FORCE) | doubt);
}
