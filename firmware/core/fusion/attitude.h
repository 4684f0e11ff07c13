// SPDX-License-Identifier: MIT
// The filter in use: measurements in, orientation and its quality out. It is selected
// when it starts. If -DATTITUDE_ONLY=name is given, the image contains that filter
// only. fuse.h documents each function, with units and ranges.
#ifndef ATTITUDE_H
#define ATTITUDE_H

#include <stddef.h>

#include "core/fusion/complementary.h"
#include "core/fusion/dcm_pi.h"
#include "core/fusion/fuse.h"
#include "core/fusion/madgwick.h"
#include "core/fusion/mahony.h"
#include "core/fusion/quality.h"
#include "core/wire/messages.h"

#ifdef ATTITUDE_ONLY

#define ATTITUDE_PASTE(one, other) one##_##other
#define ATTITUDE_JOIN(one, other) ATTITUDE_PASTE(one, other)
#define ATTITUDE_CALL(verb) ATTITUDE_JOIN(ATTITUDE_ONLY, verb)

enum {
    ATTITUDE_IS_fuse = FILTER_FUSE,
    ATTITUDE_IS_complementary = FILTER_COMPLEMENTARY,
    ATTITUDE_IS_mahony = FILTER_MAHONY,
    ATTITUDE_IS_madgwick = FILTER_MADGWICK,
    ATTITUDE_IS_dcm_pi = FILTER_DCM_PI,
    ATTITUDE_DEFAULT = ATTITUDE_JOIN(ATTITUDE_IS, ATTITUDE_ONLY),
};

struct attitude {
    struct ATTITUDE_ONLY only;
};

static inline bool attitude_has(int32_t kind) {
    return kind == ATTITUDE_DEFAULT;
}

static inline enum filter attitude_kind(const struct attitude *attitude) {
    (void)attitude;
    return (enum filter)ATTITUDE_DEFAULT;
}

// Our filter, where it runs; else NULL.
static inline const struct fuse *attitude_fuse(const struct attitude *attitude) {
    return attitude_has(FILTER_FUSE) ? (const struct fuse *)&attitude->only : NULL;
}

// See fuse.h; other filters know no rest.
static inline void attitude_deny_rest(struct attitude *attitude) {
    if (attitude_has(FILTER_FUSE)) {
        fuse_deny_rest((struct fuse *)&attitude->only);
    }
}

static inline void attitude_learn_drift(struct attitude *attitude, uint8_t axis,
                                        const struct vector *delta_q15,
                                        uint32_t noise_q30, uint8_t windows) {
    if (attitude_has(FILTER_FUSE)) {
        fuse_learn_drift((struct fuse *)&attitude->only, axis, delta_q15, noise_q30,
                         windows);
    }
}

static inline void attitude_set_mag_lag(struct attitude *attitude, uint16_t lag_us) {
    if (attitude_has(FILTER_FUSE)) {
        fuse_set_mag_lag((struct fuse *)&attitude->only, lag_us);
    }
}

static inline void attitude_init(struct attitude *attitude, enum filter kind,
                                 uint16_t rate_hz, uint16_t gyr_delay_us) {
    (void)kind;
    ATTITUDE_CALL(init)(&attitude->only, rate_hz, gyr_delay_us);
}

static inline void attitude_set_accuracy(struct attitude *attitude,
                                         const struct calibration *calibration) {
    ATTITUDE_CALL(set_accuracy)(&attitude->only, calibration);
}

static inline void attitude_use_own(struct attitude *attitude,
                                    const struct own_field *own) {
    ATTITUDE_CALL(use_own)(&attitude->only, own);
}

static inline void attitude_restart(struct attitude *attitude) {
    ATTITUDE_CALL(restart)(&attitude->only);
}

static inline void attitude_step(struct attitude *attitude,
                                 const struct measurement *measurement,
                                 uint32_t interval_us) {
    ATTITUDE_CALL(step)(&attitude->only, measurement, interval_us);
}

static inline void attitude_take(struct attitude *attitude,
                                 const struct measurement *measurement,
                                 uint32_t interval_us) {
    ATTITUDE_CALL(take)(&attitude->only, measurement, interval_us);
}

static inline void attitude_work(struct attitude *attitude) {
    ATTITUDE_CALL(work)(&attitude->only);
}

static inline void attitude_set_bias(struct attitude *attitude,
                                     const struct vector *bias_rad_s_q25) {
    ATTITUDE_CALL(set_bias)(&attitude->only, bias_rad_s_q25);
}

static inline void attitude_orientation(const struct attitude *attitude,
                                        struct quat *out) {
    ATTITUDE_CALL(orientation)(&attitude->only, out);
}

static inline void attitude_quality(const struct attitude *attitude,
                                    struct attitude_quality *out) {
    ATTITUDE_CALL(quality)(&attitude->only, out);
}

#else

enum { ATTITUDE_DEFAULT = FILTER_FUSE };

struct attitude {
    uint8_t kind;  // enum filter
    union {
        struct fuse fuse;
        struct complementary complementary;
        struct mahony mahony;
        struct madgwick madgwick;
        struct dcm_pi dcm_pi;
    };
};

// True if this build has the filter `kind`, an enum filter or any other number.
bool attitude_has(int32_t kind);

enum filter attitude_kind(const struct attitude *attitude);

// Our filter, where it runs; else NULL.
static inline const struct fuse *attitude_fuse(const struct attitude *attitude) {
    return attitude->kind == FILTER_FUSE ? &attitude->fuse : NULL;
}

// See fuse.h; other filters know no rest.
static inline void attitude_deny_rest(struct attitude *attitude) {
    if (attitude->kind == FILTER_FUSE) {
        fuse_deny_rest(&attitude->fuse);
    }
}

static inline void attitude_learn_drift(struct attitude *attitude, uint8_t axis,
                                        const struct vector *delta_q15,
                                        uint32_t noise_q30, uint8_t windows) {
    if (attitude->kind == FILTER_FUSE) {
        fuse_learn_drift(&attitude->fuse, axis, delta_q15, noise_q30, windows);
    }
}

static inline void attitude_set_mag_lag(struct attitude *attitude, uint16_t lag_us) {
    if (attitude->kind == FILTER_FUSE) {
        fuse_set_mag_lag(&attitude->fuse, lag_us);
    }
}

// Needs attitude_has(kind).
void attitude_init(struct attitude *attitude, enum filter kind, uint16_t rate_hz,
                   uint16_t gyr_delay_us);

void attitude_set_accuracy(struct attitude *attitude,
                           const struct calibration *calibration);
void attitude_use_own(struct attitude *attitude, const struct own_field *own);
void attitude_restart(struct attitude *attitude);
void attitude_step(struct attitude *attitude, const struct measurement *measurement,
                   uint32_t interval_us);
// The same in two, see fuse.h.
void attitude_take(struct attitude *attitude, const struct measurement *measurement,
                   uint32_t interval_us);
void attitude_work(struct attitude *attitude);
void attitude_set_bias(struct attitude *attitude, const struct vector *bias_rad_s_q25);
void attitude_orientation(const struct attitude *attitude, struct quat *out);
void attitude_quality(const struct attitude *attitude, struct attitude_quality *out);

#endif
#endif
