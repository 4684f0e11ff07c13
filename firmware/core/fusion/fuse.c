// SPDX-License-Identifier: MIT
// Measurement to orientation; see fuse.h. What each stage does: fuse_stages.h.
#include "core/fusion/fuse.h"

#include <stddef.h>
#include <string.h>

#include "core/fusion/fuse_stages.h"

enum {
    STAGES = 10,         // of a window: at 100 samples a second, one a sample
    STEP_MAX_US = 7000,  // 41.4 rad/s an axis and 8 % of scale turn 0.55 rad in it
    FIELD_ABSENT = FUSE_WINDOWS(FUSE_FIELD_ABSENT_S),
    // Of two axes, in 1e-4 m/s2 each.
    LEVEL_SIGMA_MAX = ROUNDED(FUSE_LEVEL_SIGMA_G * GRAVITY_M_S2 * 1e4 / 1.414214),
};

// The numbers of one part of a step are not on the stack while another runs.
#define NOINLINE __attribute__((noinline))

#define DRIFT_SQUARE_START_Q30 Q_RAD2(SQUARE(FUSE_DRIFT_START_DPS), 30)
#define LEVEL_UNKNOWN_Q30 Q30(SQUARE(FUSE_LEVEL_SIGMA_G))
// rad2 q2_30 as 1e-4 deg2, whose steps stated variances have.
#define CDEG2_GAIN_Q32 Q_DEG2(1e4 * 4, 0)
#define CDEG2(degrees) ((uint32_t)ROUNDED((degrees) * (degrees)*1e4))
// Thirds of that for what levelling keeps correcting, (rad/s)^2 q2_30.
#define TILT_DRIFT_THIRDS Q_DEG2(3e4 / 1073741824.0 * SQUARE(FUSE_TILT_DRIFT_S), 0)
#define FIELD_LIMIT_Q18 Q18(FUSE_READING_MAX_UT)
#define FOUR_US_Q35 Q35(4e-6)

// Seconds times 2^35, so that rad/s q7_25 gives rad q2_30, within 4e-7 of them. Needs
// us <= 15000.
NOINLINE static int32_t seconds_q35(uint16_t us) {
    return fixed_half_floor(fixed_half_floor(us * FOUR_US_Q35));
}

void fuse_init(struct fuse *fuse, uint16_t rate_hz, uint16_t gyr_delay_us) {
    struct fuse_coefficients *coefficients = &fuse->coefficients;
    memset(fuse, 0, sizeof *fuse);
    coefficients->window = (uint8_t)(rate_hz / FUSE_WINDOWS(1));
    coefficients->stride = coefficients->window / STAGES;
    coefficients->middle = (uint8_t)(coefficients->window / 2 + coefficients->stride);
    coefficients->share = Q2_30_ONE / coefficients->window;
    // A mean rate over the sample period would be half a period old.
    coefficients->half_lead_s_q35 = fixed_divide(
        (gyr_delay_us - (int32_t)(UINT32_C(500000) / rate_hz)) * FOUR_US_Q35, 8);
    fuse_init_lag(fuse);
    fuse_init_gyro(fuse);
    fuse_restart(fuse);
}

void fuse_set_accuracy(struct fuse *fuse, const struct calibration *calibration) {
    fuse_set_own_accuracy(fuse, calibration->mag.sigma);
    fuse_set_scale_accuracy(fuse, calibration->gyr.sigma);
    fuse_set_known_field(fuse, calibration);
    fuse->drift = calibration->drift;
    const uint16_t sigma = calibration->acc.sigma;
    fuse->settings.level_variance =
        sigma >= LEVEL_SIGMA_MAX ? LEVEL_UNKNOWN_Q30 : fuse_level_variance_of(sigma);
}

void fuse_set_mag_lag(struct fuse *fuse, uint16_t lag_us) {
    fuse->state.lag_s_q35 = seconds_q35(lag_us);
}

void fuse_restart(struct fuse *fuse) {
    const size_t first = offsetof(struct fuse_state, in_window);
    memset(&fuse->state.in_window, 0,
           offsetof(struct fuse_state, bias_rad_s_q25) - first);
    quat_set_identity(&fuse->state.inertial_from_body);
    quat_set_identity(&fuse->state.level_from_inertial);
    quat_set_identity(&fuse->state.world_from_inertial);
    fuse->state.stage = STAGES;
    fuse->state.field_age = FIELD_ABSENT;
    fuse->state.heading_variance = FUSE_HEADING_VARIANCE_MAX_Q30;
    fuse->state.drift_square = DRIFT_SQUARE_START_Q30;
}

// Turns q by a small angle, |angle| <= 0.55 rad, in the frame of reference on the right
// of it.
static void turn_by(struct quat *q, const struct vector *angle_rad_q30) {
    struct quat turn;
    quat_from_small_angle(angle_rad_q30, &turn);
    quat_multiply(q, &turn, q);
}

NOINLINE static void integrate(struct fuse *fuse, uint16_t interval_us) {
    while (interval_us > 0) {
        const uint16_t part = interval_us > STEP_MAX_US ? STEP_MAX_US : interval_us;
        interval_us = (uint16_t)(interval_us - part);
        struct vector angle;
        vector_scale(&fuse->state.rate_rad_s_q25, seconds_q35(part), &angle);
        turn_by(&fuse->state.inertial_from_body, &angle);
    }
}

// Adds a vector along an axis of the body, over 256, to a sum in the inertial frame.
NOINLINE static void add_turned(const struct matrix *turn, uint8_t axis, int16_t value,
                                struct vector *sum) {
    for (uint8_t row = 0; row < 3; ++row) {
        fixed_add(fixed_byte_floor((int32_t)turn->row[row][axis] * value),
                  &sum->axis[row]);
    }
}

// Whether the sample has a field reading: not zeros, which are none, and not of a
// sensor that gives one for ever.
NOINLINE static bool has_field(struct fuse *fuse,
                               const struct measurement *measurement) {
    if (!measurement->has_mag || !vector_exceeds(&measurement->mag_ut_q18, 0)) {
        return false;
    }
    if (fuse_repeats(&fuse->state.mag, &measurement->mag_ut_q18) >=
        FUSE_REPEATS_FIELD) {
        fuse_forget_place(fuse);
        return false;
    }
    ++fuse->state.field_count;
    return true;
}

// Adds the force, the rate about each axis of the body, and a field reading to the sums
// over the window.
NOINLINE static void add_to_means(struct fuse *fuse,
                                  const struct measurement *measurement) {
    struct matrix inertial_from_body;
    int32_t coarse[3];  // m/s2 q13
    const bool is_reading = has_field(fuse, measurement);
    matrix_from_quat(&fuse->state.inertial_from_body, &inertial_from_body);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int16_t rate =  // rad/s q9
            (int16_t)fixed_high_half(
                (uint32_t)(fuse->state.rate_rad_s_q25.axis[axis] + 32768));
        coarse[axis] = fixed_byte_floor(measurement->acc_m_s2_q21.axis[axis]);
        add_turned(&inertial_from_body, axis, rate, &fuse->state.turn_sum_q15[axis]);
        if (is_reading) {
            const int32_t field = fixed_clamp_high(measurement->mag_ut_q18.axis[axis],
                                                   FIXED_HIGH(FIELD_LIMIT_Q18));
            add_turned(&inertial_from_body, axis,
                       (int16_t)fixed_high_half((uint32_t)(field * 8 + 32768)),  // q5
                       &fuse->state.field_sum_q11);
        }
    }
    for (uint8_t row = 0; row < 3; ++row) {
        fixed_add(fixed_dot3_q14(coarse, inertial_from_body.row[row]),
                  &fuse->state.force_sum_q13.axis[row]);
    }
}

static void run_stage(struct fuse *fuse) {
    switch (fuse->state.stage) {
    case 0:
        fuse_stage_level(fuse);
        break;
    case 1:
        fuse_stage_regressors(fuse);
        fuse_stage_mean(fuse);
        break;
    case 2:
        fuse_stage_reading(fuse);
        fuse_stage_predict(fuse);
        break;
    case 3:
        fuse_stage_rest(fuse);
        fuse_stage_motion(fuse);
        break;
    case 4:
        fuse_stage_field(fuse);
        if (fuse->state.has_reading && !fuse_is_at_rest(fuse)) {
            fuse_follow_lag(fuse);
        }
        break;
    case 5:
        fuse_stage_turning(fuse);
        break;
    default:
        fuse_stage_field_axis(fuse, (uint8_t)(fuse->state.stage - 6));
        if (fuse->state.stage == STAGES - 1) {
            fuse_stage_world(fuse);
        }
        break;
    }
    ++fuse->state.stage;
}

void fuse_take(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    vector_subtract(&measurement->gyr_rad_s_q25, &fuse->state.bias_rad_s_q25,
                    &fuse->state.rate_rad_s_q25);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        int32_t *rate = &fuse->state.rate_rad_s_q25.axis[axis];
        fixed_add(fixed_mul_at(rate, &fuse->state.scale[axis]), rate);
    }
    if ((fuse->state.windows | fuse->state.in_window) == 0) {
        fuse_take_first(fuse, &measurement->acc_m_s2_q21);
    } else {
        if (interval_us > FUSE_INTERVAL_MAX_US) {
            interval_us = FUSE_INTERVAL_MAX_US;
            fuse->state.clipped = FUSE_CLIPPED_LOST;
        }
        integrate(fuse, (uint16_t)interval_us);
    }
    if (measurement->gyr_clipped && fuse->state.clipped < UINT8_MAX) {
        ++fuse->state.clipped;
    }
    if (measurement->acc_clipped || fuse->state.clipped > 0) {
        fuse->state.unsettled = FUSE_UNSETTLED;
    }
    add_to_means(fuse, measurement);
    fuse->state.warmth = measurement->warmth;
    // Of two samples in a row, one runs a stage and one looks for rest.
    ++fuse->state.in_stride;
    if (fuse->state.in_stride == coefficients->stride) {
        fuse->state.in_stride = 0;
    }
    ++fuse->state.in_window;
    if (fuse->state.in_window == coefficients->middle) {
        fuse->state.middle_attitude = fuse->state.inertial_from_body;
    }
    if (fuse->state.in_window == coefficients->window) {
        fuse->state.in_window = 0;
        fuse->state.in_stride = 0;
        fuse->state.stage = 0;
        quat_renormalise(&fuse->state.inertial_from_body);
    }
    if ((uint8_t)(fuse->state.in_stride + 1) == coefficients->stride) {
        fuse_look_for_rest(fuse, measurement);
    }
}

void fuse_work(struct fuse *fuse) {
    if (fuse->state.windows == 0 && fuse->state.in_window == 1) {
        fuse_level_first(fuse);
    }
    if (fuse->state.in_stride == 0 && fuse->state.stage < STAGES) {
        run_stage(fuse);
    }
}

void fuse_step(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us) {
    fuse_take(fuse, measurement, interval_us);
    fuse_work(fuse);
}

void fuse_orientation(const struct fuse *fuse, struct quat *out) {
    // The gyroscope's low-pass still holds back the motion of the last few
    // milliseconds: the last rate makes up for it. Of half that angle, h, the cosine is
    // 1 - h^2/2, and the sine h: within 1e-4 of 12 degrees.
    struct quat turn;
    struct vector *const half = (struct vector *)&turn.x;
    quat_set_identity(&turn);
    vector_scale(&fuse->state.rate_rad_s_q25, fuse->coefficients.half_lead_s_q35, half);
    turn.w -= fixed_half_floor(vector_square_q30(half));
    quat_multiply(&fuse->state.world_from_inertial, &fuse->state.inertial_from_body,
                  out);
    quat_multiply(out, &turn, out);
    quat_renormalise(out);
}

// A variance as 1e-4 deg2.
NOINLINE static uint32_t in_cdeg(q2_30_t variance) {
    return fixed_umul_q32((uint32_t)variance, CDEG2_GAIN_Q32);
}

static bool is_levelling(const struct fuse *fuse) {
    return (uint8_t)(fuse->state.windows + 1) <=
           FUSE_LEVEL_SETTLE;  // FUSE_WINDOWS_LOST is 0
}

void fuse_quality(const struct fuse *fuse, struct attitude_quality *out) {
    uint16_t flags = 0;
    if (is_levelling(fuse) ||
        (fuse->state.field_learnt > 0 && fuse->state.field_learnt < FUSE_FIELD_LEARN)) {
        flags |= POSE_STARTING;
    }
    if (fuse_is_at_rest(fuse)) {
        flags |= POSE_AT_REST;
    }
    if (fuse->state.field_age >= FIELD_ABSENT) {
        flags |= POSE_MAG_ABSENT;
    } else if (fuse->state.field_surprise > FUSE_FIELD_UNIT) {
        flags |= POSE_MAG_DISTURBED;
    }
    if (fuse_is_heading_free(fuse)) {
        flags |= POSE_HEADING_FREE;
    }
    flags |= (uint16_t)(fuse->state.doubts * 256);
    out->flags = flags;
    out->tilt_sigma_cdeg = UINT16_MAX;
    out->heading_sigma_cdeg = UINT16_MAX;
    if (is_levelling(fuse) || (fuse->state.doubts & FUSE_FORCE) != 0) {
        return;
    }
    out->tilt_sigma_cdeg =
        fixed_sqrt(CDEG2(FUSE_TILT_FLOOR_DEG) +
                   (uint32_t)fixed_divide(
                       fixed_times(fuse->state.drift_square, TILT_DRIFT_THIRDS), 3) +
                   in_cdeg(fuse_level_variance(fuse)));
    if (fuse->state.doubts == 0 && (flags & (POSE_STARTING | POSE_HEADING_FREE)) == 0) {
        out->heading_sigma_cdeg = fixed_sqrt(CDEG2(FUSE_HEADING_FLOOR_DEG) +
                                             in_cdeg(fuse->state.heading_variance));
    }
}
