// SPDX-License-Identifier: MIT
// The choice of a filter at run time; see attitude.h.
#include "core/fusion/attitude.h"

#ifndef ATTITUDE_ONLY

// name_verb(&attitude->name, ...) of the filter that runs.
#define DISPATCH(verb, ...)                                                            \
    switch (attitude->kind) {                                                          \
    case FILTER_COMPLEMENTARY:                                                         \
        complementary_##verb(&attitude->complementary, ##__VA_ARGS__);                 \
        break;                                                                         \
    case FILTER_MAHONY:                                                                \
        mahony_##verb(&attitude->mahony, ##__VA_ARGS__);                               \
        break;                                                                         \
    case FILTER_MADGWICK:                                                              \
        madgwick_##verb(&attitude->madgwick, ##__VA_ARGS__);                           \
        break;                                                                         \
    case FILTER_DCM_PI:                                                                \
        dcm_pi_##verb(&attitude->dcm_pi, ##__VA_ARGS__);                               \
        break;                                                                         \
    default:                                                                           \
        fuse_##verb(&attitude->fuse, ##__VA_ARGS__);                                   \
        break;                                                                         \
    }

bool attitude_has(int32_t kind) {
    return kind >= FILTER_FUSE && kind <= FILTER_DCM_PI;
}

enum filter attitude_kind(const struct attitude *attitude) {
    return (enum filter)attitude->kind;
}

void attitude_init(struct attitude *attitude, enum filter kind, uint16_t rate_hz,
                   uint16_t gyr_delay_us) {
    attitude->kind = (uint8_t)kind;
    DISPATCH(init, rate_hz, gyr_delay_us)
}

void attitude_set_accuracy(struct attitude *attitude,
                           const struct calibration *calibration) {
    DISPATCH(set_accuracy, calibration)
}

void attitude_use_own(struct attitude *attitude, const struct own_field *own) {
    DISPATCH(use_own, own)
}

void attitude_restart(struct attitude *attitude) {
    DISPATCH(restart)
}

void attitude_step(struct attitude *attitude, const struct measurement *measurement,
                   uint32_t interval_us) {
    DISPATCH(step, measurement, interval_us)
}

void attitude_take(struct attitude *attitude, const struct measurement *measurement,
                   uint32_t interval_us) {
    DISPATCH(take, measurement, interval_us)
}

void attitude_work(struct attitude *attitude) {
    DISPATCH(work)
}

void attitude_set_bias(struct attitude *attitude, const struct vector *bias_rad_s_q25) {
    DISPATCH(set_bias, bias_rad_s_q25)
}

void attitude_orientation(const struct attitude *attitude, struct quat *out) {
    DISPATCH(orientation, out)
}

void attitude_quality(const struct attitude *attitude, struct attitude_quality *out) {
    DISPATCH(quality, out)
}

#endif
