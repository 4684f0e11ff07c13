// SPDX-License-Identifier: MIT
// Heading, from the magnetic field: one Kalman filter of the field of the place, in the
// level frame, and of the probe's own field, which turns with it.
#include <string.h>

#include "core/fusion/fuse_stages.h"

enum {
    // Variances as 16ths of 1 uT2.
    OWN_KNOWN = ROUNDED(16 * SQUARE(FUSE_OWN_KNOWN_SIGMA_UT)),
    OWN_UNKNOWN = ROUNDED(16 * SQUARE(FUSE_OWN_UNKNOWN_SIGMA_UT)),
    OWN_GOOD = ROUNDED(16 * SQUARE(FUSE_OWN_GOOD_SIGMA_UT)),
    OWN_SIGMA_MAX = ROUNDED(FUSE_OWN_UNKNOWN_SIGMA_UT * 100),  // 0.01 uT
    // Number of squares of 1.28 K that add one to the variance.
    OWN_WARMTH_PART = ROUNDED(1 / (16 * SQUARE(FUSE_OWN_WARMTH_UT_K * 1.28))),
    OWN_UNIT_BITS = 15,  // from 16ths of 1 uT2 to q13_19
    SURPRISE_WINDOWS = FUSE_WINDOWS(FUSE_SURPRISE_TAU_S),
    ASTRAY_WINDOWS = FUSE_WINDOWS(FUSE_ASTRAY_TAU_S),
    ACROSS_WINDOWS = FUSE_WINDOWS(FUSE_ACROSS_TAU_S),
};
#define OWN_GAIN_Q32 Q32_UNSIGNED(0.01 * 0.01 * 16)  // (0.01 uT)^2 in 16ths of 1 uT2

// The lag as seconds times 2^35, half of its variance in ms2 as q13_19.
#define LAG_Q35 Q35(FUSE_LAG_S)
#define LAG_MAX_Q35 Q35(FUSE_LAG_MAX_S)
#define LAG_MS_Q17 Q17(0.001)  // a ms q14_18 as seconds times 2^35
#define LAG_RATE_Q15 Q15(FUSE_LAG_RATE_MAX_RAD_S)
#define LAG_ANGLE_Q30 Q30(FUSE_LAG_ANGLE_MAX_RAD)
#define LAG_VARIANCE Q19(1e6 * SQUARE(FUSE_LAG_SIGMA_S) / 2)
#define LAG_FIELD_Q18 Q18(FUSE_LAG_FIELD_MAX_UT)
#define LAG_SLOPE_MAX Q13(FUSE_LAG_SLOPE_MAX_UT_S)

// Variances of fields as q13_19, uT2.
#define PLACE_VARIANCE Q19(SQUARE(FUSE_PLACE_SIGMA_UT))
#define PLACE_VARIANCE_MOVING                                                          \
    Q19(SQUARE(FUSE_PLACE_SIGMA_UT) + SQUARE(FUSE_PLACE_MOVING_SIGMA_UT))
#define FIELD_VARIANCE_MAX Q19(SQUARE(FUSE_FIELD_SIGMA_MAX_UT))
#define FIELD_VARIANCE_UNKNOWN_MAX Q19(FUSE_FIELD_UNKNOWN_MAX_UT2)
#define FIELD_NOISE Q19(FUSE_FIELD_NOISE_UT2_S / FUSE_WINDOW_S)
#define FIELD_NOISE_MAX Q19(FUSE_FIELD_NOISE_MAX_UT2)
#define DRIFTING_LEVEL_Q30 Q_RAD2(SQUARE(FUSE_DRIFTING_LEVEL_DPS), 30)
#define PLACE_WANDER Q19(FUSE_PER_WINDOW(FUSE_PLACE_WANDER_UT2_S))
#define OWN_WANDER Q19(FUSE_PER_WINDOW(FUSE_OWN_WANDER_UT2_S))
#define OWN_WANDER_ASTRAY Q19(FUSE_PER_WINDOW(FUSE_OWN_WANDER_ASTRAY_UT2_S))
#define OWN_DOUBT Q19(SQUARE(FUSE_OWN_DOUBT_UT))
#define PLACE_SPREAD_MAX Q19(FUSE_PLACE_SPREAD_MAX_UT2)

// Fields as q14_18, uT, and squares of them, uT2.
#define OWN_NEAR_Q18 Q18(FUSE_OWN_NEAR_UT)
#define ACROSS_LIMIT_Q18 Q18(FUSE_ACROSS_MAX_UT)
#define FIELD_STEP_MAX_Q18 Q18(FUSE_FIELD_STEP_MAX_UT)
#define FIELD_FAR_Q18 Q18(FUSE_SURPRISE_MAX_UT)
#define PLACE_LIMIT_Q18 Q18(FUSE_PLACE_MAX_UT)
#define OWN_LIMIT_Q18 Q18(FUSE_OWN_MAX_UT)
#define PLACE_TURNED_Q18 Q18(FUSE_FIELD_MAX_UT)
#define FIELD_TURNED_Q18 Q18(FUSE_SURPRISE_UT)
#define FIELD_TURNED_GAIN_Q14 Q14(2 * FUSE_SURPRISE_UT * 64 / 262144)  // to 64ths

// A reading's squared distance has 4096ths of 1 uT2.
#define FIELD_UNIT_FINE ((uint32_t)ROUNDED(FUSE_SURPRISE_UT * FUSE_SURPRISE_UT * 4096))
#define FIELD_UNIT_TURNED                                                              \
    ((uint32_t)ROUNDED(FUSE_TURNED_SURPRISE * FUSE_SURPRISE_UT * FUSE_SURPRISE_UT *    \
                       4096))
// Twice that of a length in 8ths is 64ths of its square.
#define ASTRAY_LENGTH ROUNDED(2 * FUSE_ASTRAY_LENGTH_UT * 64 / 8)

// What levelling keeps correcting leans the vertical field: from q14_18 to q13_19.
#define LEANING_MAX_Q18 Q18(FUSE_FIELD_NOISE_MAX_UT2 / FUSE_FIELD_DRIFT_S2)
#define LEANING_NOISE ROUNDED(FUSE_FIELD_DRIFT_S2 * 2)

// What a reading tells of the heading has a noise of its own, as quarters of 1 uT2 in
// q11_21: a share of that of the field, times 1 and the squared distance of a reading
// in units; and what leans.
#define TURNING_NOISE                                                                  \
    ROUNDED(512.0 / 4 * FUSE_TURNING_SHARE * FUSE_FIELD_NOISE_UT2_S / FUSE_WINDOW_S /  \
            (SQUARE(FUSE_SURPRISE_UT)))
#define TURNING_FAR                                                                    \
    ((uint32_t)ROUNDED(FUSE_TURNING_FAR * FUSE_SURPRISE_UT * FUSE_SURPRISE_UT * 4096))
#define TURNING_LEANING_MAX_Q18                                                        \
    Q18(FUSE_TURNING_LEANING_MAX_UT2 / FUSE_TURNING_DRIFT_S2)
#define TURNING_LEANING ROUNDED(FUSE_TURNING_DRIFT_S2 / 4 * 8)
#define TURNING_NOISE_MAX INT32_C(1000000000)  // of what kalman_read takes
#define TURNED_OFF_Q30 Q_RAD(0.5 * 128, 30)    // half a degree, from q14_18 to q7_25

// Heading variance that a window adds, rad2 as 2^-39ths; and that by what the
// gyroscope's uncertainty turned it, (4 deg)^2 as 2^-17ths.
#define HEADING_WANDER Q_RAD2(FUSE_PER_WINDOW(FUSE_HEADING_WANDER_DEG2_S), 39)
#define HEADING_WANDER_ALONE                                                           \
    Q_RAD2(FUSE_PER_WINDOW(FUSE_HEADING_WANDER_ALONE_DEG2_S), 39)
#define HEADING_WANDER_TURNED                                                          \
    Q_RAD2(FUSE_PER_WINDOW(FUSE_HEADING_WANDER_TURNED_DEG2_S), 39)
#define HEADING_TURNED Q_RAD2(SQUARE(FUSE_HEADING_UNIT_DEG), 39 - 17)

#define FREE_Q30 Q_RAD2(SQUARE(FUSE_HEADING_FREE_DEG), 30)
#define FREE_UNKNOWN_Q30 Q_RAD2(SQUARE(FUSE_HEADING_FREE_UNKNOWN_DEG), 30)

// One copy, whose numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

void fuse_set_own_accuracy(struct fuse *fuse, uint16_t sigma) {
    uint32_t variance = OWN_UNKNOWN;
    if (sigma < OWN_SIGMA_MAX) {
        variance = fixed_umul_q32((uint32_t)sigma * sigma, OWN_GAIN_Q32);
    }
    fuse->settings.own_variance =
        (int16_t)(variance < OWN_KNOWN ? OWN_KNOWN : variance);
    memset(&fuse->state.own_ut_q18, 0, sizeof fuse->state.own_ut_q18);
    // The heading was found with the calibration before, and may turn by 2 degrees.
    fuse->state.is_turned = true;
}

bool fuse_is_own_unknown(const struct fuse *fuse) {
    return fuse->settings.own_variance > OWN_GOOD || fuse->state.is_own_unknown;
}

bool fuse_is_heading_free(const struct fuse *fuse) {
    return fuse->state.heading_variance >
           (fuse_is_own_unknown(fuse) ? FREE_UNKNOWN_Q30 : FREE_Q30);
}

void fuse_init_lag(struct fuse *fuse) {
    fuse->settings.own_variance = OWN_KNOWN;
    fuse->state.lag_s_q35 = LAG_Q35;
    fuse->state.lag_variance = LAG_VARIANCE;
}

void fuse_stage_mean(struct fuse *fuse) {
    if (fuse->state.field_count == 0) {
        return;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        int32_t *const sum = &fuse->state.field_sum_q11.axis[axis];
        int32_t *const rate = &fuse->state.reading_rad_s_q25.axis[axis];
        fuse->state.reading_ut_q18.axis[axis] =
            fixed_divide(*sum, fuse->state.field_count) * 128;
        *sum = 0;
        *rate = fixed_scale_up(
            fixed_clamp(fixed_mul_at(rate, &fuse->coefficients.share), LAG_RATE_Q15),
            10);
    }
    fuse->state.field_count = 0;
    fuse->state.has_reading = true;
}

// Readings are older than their samples: by the lag, in which the mean rate has turned
// the probe.
void fuse_stage_reading(struct fuse *fuse) {
    struct vector angle;
    struct quat turn;
    struct quat attitude;
    struct vector *const reading = &fuse->state.reading_ut_q18;
    if (!fuse->state.has_reading) {
        return;
    }
    vector_scale(&fuse->state.reading_rad_s_q25, -fuse->state.lag_s_q35, &angle);
    vector_clamp(&angle, LAG_ANGLE_Q30, &angle);
    quat_from_small_angle(&angle, &turn);
    quat_multiply(&turn, &fuse->state.level_from_inertial, &turn);
    quat_renormalise(&turn);
    quat_rotate(&turn, reading, reading);
    quat_multiply(&turn, &fuse->state.middle_attitude, &attitude);
    quat_renormalise(&attitude);
    matrix_from_quat(&attitude, &fuse->state.level_from_body);
}

// An axis of the reading less the expected place + level_from_body * own; below
// 8192 uT.
NOINLINE static q14_18_t field_away(const struct fuse *fuse, uint8_t axis) {
    return fuse->state.reading_ut_q18.axis[axis] - fuse->state.field_ut[axis] -
           fixed_dot3_q14(fuse->state.field_ut + 3,
                          fuse->state.level_from_body.row[axis]);
}

// The same, held within what one reading may correct.
static q14_18_t field_step(const struct fuse *fuse, uint8_t axis) {
    return fixed_clamp_high(field_away(fuse, axis), FIXED_HIGH(FIELD_STEP_MAX_Q18));
}

// The mean of the first readings is the field of the place. It is as uncertain as the
// probe's own field, and correlated with it.
NOINLINE static void learn_place(struct fuse *fuse) {
    int32_t *const covariance = fuse->state.field_covariance;
    fuse_forget_turned(fuse);
    ++fuse->state.field_learnt;
    memset(covariance, 0, sizeof fuse->state.field_covariance);
    fuse->state.is_own_unknown =
        fuse->state.field_plain > 0 ||
        (fuse->state.doubts & (FUSE_IMPOSSIBLE | FUSE_UNLIKE)) != 0;
    const uint16_t warmth = (uint16_t)(fuse->state.warmth * fuse->state.warmth);
    int16_t variance =
        (int16_t)(fuse->settings.own_variance + (int16_t)(warmth / OWN_WARMTH_PART));
    if (fuse->state.is_own_unknown) {
        variance = OWN_UNKNOWN;
    }
    const int32_t own = fixed_scale_up(variance, OWN_UNIT_BITS);
    kalman_wander(covariance, 3, own, FIXED_HIGH(FIELD_VARIANCE_UNKNOWN_MAX));
    kalman_wander(covariance, 0, own, FIXED_HIGH(FIELD_VARIANCE_UNKNOWN_MAX));
    kalman_wander(covariance, 0,
                  fuse_is_at_rest(fuse) ? PLACE_VARIANCE : PLACE_VARIANCE_MOVING,
                  FIXED_HIGH(FIELD_VARIANCE_UNKNOWN_MAX));
    int32_t *shared = covariance + FUSE_FIELD_STATES;  // the row of the first own state
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fixed_add(fixed_divide(field_away(fuse, axis), fuse->state.field_learnt),
                  &fuse->state.field_ut[axis]);
        for (uint8_t column = 0; column < 3; ++column) {
            *shared = (int32_t)fuse->state.level_from_body.row[column][axis] *
                      (-2 * variance);
            ++shared;
        }
        shared += axis + 1;
    }
}

// Readings keep showing that the probe's field has changed.
NOINLINE static bool is_astray(const struct fuse *fuse) {
    return fuse->state.field_astray > FUSE_FIELD_ASTRAY && !fuse_is_at_rest(fuse);
}

// The uncertainty that a window adds: the field of the place turns with an error of the
// heading, and both fields wander, the probe's more where readings keep surprising.
NOINLINE static void predict_field(struct fuse *fuse) {
    int32_t *covariance = fuse->state.field_covariance;
    const int32_t turn_q39 = (!fuse->state.has_reading ? HEADING_WANDER_ALONE
                              : fuse->state.is_turned  ? HEADING_WANDER_TURNED
                                                       : HEADING_WANDER) +
                             fuse->state.turned_q17 * HEADING_TURNED;
    if (!fuse->state.has_reading) {
        fixed_add_clamped_high(fixed_scale_down(turn_q39, 9),
                               FIXED_HIGH(FUSE_HEADING_VARIANCE_MAX_Q30),
                               &fuse->state.heading_variance);
    }
    // The horizontal field, at most 60 uT: half of it, and it times the turn, as
    // 2^32ths.
    int32_t half[2];
    int32_t turned[2];
    for (uint8_t axis = 0; axis < 2; ++axis) {
        const int32_t place =
            fixed_clamp_high(fuse->state.field_ut[axis], FIXED_HIGH(PLACE_TURNED_Q18));
        half[axis] = fixed_half_floor(place);
        turned[axis] = fixed_mul_q30(fixed_scale_up(place, 5), turn_q39);
    }
    if (covariance[0] + covariance[2] < PLACE_SPREAD_MAX) {
        fixed_add(fixed_mul_at(&half[1], &turned[1]), &covariance[0]);
        fixed_subtract(fixed_mul_at(&half[0], &turned[1]), &covariance[1]);
        fixed_add(fixed_mul_at(&half[0], &turned[0]), &covariance[2]);
    }
    const int16_t limit = FIXED_HIGH(
        fuse_is_own_unknown(fuse) ? FIELD_VARIANCE_UNKNOWN_MAX : FIELD_VARIANCE_MAX);
    const int32_t drifting = fuse->state.drifting > 0 ? fuse->state.drifting : 0;
    kalman_wander(covariance, 0, PLACE_WANDER + fixed_byte_floor(drifting), limit);
    kalman_wander(covariance, 3, is_astray(fuse) ? OWN_WANDER_ASTRAY : OWN_WANDER,
                  limit);
}

// In a body that turns, the field of the place moves by place x rate. The part of the
// reading's surprise along that direction is an error of the lag.
void fuse_follow_lag(struct fuse *fuse) {
    struct vector place;
    struct vector slope;  // uT/s as q18_13, at most 346 * 62.4
    vector_clamp(&fuse->state.place_ut_q18, LAG_FIELD_Q18, &place);
    vector_cross(&place, &fuse->state.reading_rad_s_q25, &slope);
    const int32_t norm = vector_normalise(&slope);
    if (norm == 0) {
        return;
    }
    // 2^14 / 1000 / 2^13 of it, which is in uT/ms; at most 2.
    const q2_14_t row =
        (q2_14_t)fixed_divide(fixed_divide(fixed_clamp(norm, LAG_SLOPE_MAX), 5), 100);
    q2_30_t gain;
    kalman_read(&fuse->state.lag_variance, 1, &row, fuse->state.field_noise, &gain);
    q14_18_t along = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fixed_add(fixed_mul_q30(slope.axis[axis], field_step(fuse, axis)), &along);
    }
    const int32_t lag =
        fuse->state.lag_s_q35 - fixed_times(fixed_mul_q30(gain, along), LAG_MS_Q17);
    fuse->state.lag_s_q35 = fixed_clamp(lag > 0 ? lag : 0, LAG_MAX_Q35);
}

// The square of the vertical field, seen through a level that leans by an angle whose
// square is given: uT2; of what levelling keeps correcting in a second, at most 28.
q14_18_t fuse_leaning(const struct fuse *fuse, q2_30_t square_rad) {
    const int32_t vertical =
        fixed_clamp_high(fuse->state.field_ut[2], FIXED_HIGH(PLACE_TURNED_Q18));
    return fixed_mul_q30(fixed_square_q30(fixed_scale_up(vertical, 6)), square_rad);
}

// An axis of the reading's surprise, held within 90 uT; adds its square, 4096ths of
// 1 uT2.
static q14_18_t add_away(const struct fuse *fuse, uint8_t axis, uint32_t *square) {
    const q14_18_t off =
        fixed_clamp_high(field_away(fuse, axis), FIXED_HIGH(FIELD_FAR_Q18));
    fixed_add(fixed_square_q30(fixed_scale_up(off, 3)), (int32_t *)square);
    return off;
}

// The variance of a reading along `row` that does not come from the gyroscope, as
// quarters of 1 uT2 in q11_21. `square`: of the reading's distance, 4096ths of 1 uT2.
NOINLINE static int32_t turning_noise(const struct fuse *fuse, const q2_14_t row[],
                                      uint32_t square) {
    int32_t shared[FUSE_FIELD_STATES];
    const uint32_t distance = square < TURNING_FAR ? square : TURNING_FAR;
    const int32_t own =
        fixed_times((int32_t)(distance + FIELD_UNIT_FINE), TURNING_NOISE) +
        fixed_times(fixed_clamp(fuse_leaning(fuse, fuse->state.drift_square),
                                TURNING_LEANING_MAX_Q18),
                    TURNING_LEANING);
    // Of the heading's variance, what the field's covariance has already.
    const int32_t spread = fixed_clamp(
        kalman_share(fuse->state.field_covariance, FUSE_FIELD_STATES, row, shared),
        TURNING_NOISE_MAX);
    const int32_t across = fixed_dot3_q14(shared, row);
    const int32_t seen = fixed_mul_q14(
        fixed_mul_q14(fuse->state.motion_covariance[FUSE_MOTION_PAIRS - 1],
                      fuse->state.turned_by),
        fuse->state.turned_by);
    const int32_t noise = own + spread - (seen < across ? seen : across);
    const int32_t least = fixed_divide(own, 4);
    return fixed_clamp(noise < least ? least : noise, TURNING_NOISE_MAX);
}

// A step of a mean towards uT, held within 10.
NOINLINE static void follow(int16_t *mean, q14_18_t ut) {
    const int16_t now =
        (int16_t)fixed_byte_floor(fixed_clamp_high(ut, FIXED_HIGH(ACROSS_LIMIT_Q18)));
    *mean = (int16_t)(*mean + (int16_t)(now - *mean) / ACROSS_WINDOWS);
}

// What of the reading is across the horizontal field, and the noise of it. What goes on
// across and not along is the gyroscope's drift.
NOINLINE static q14_18_t look_across(struct fuse *fuse, int32_t *noise) {
    q2_14_t row[FUSE_FIELD_STATES];
    row[0] = fuse->state.across[0];
    row[1] = fuse->state.across[1];
    row[2] = 0;
    const q2_14_t side[3] = {row[1], (q2_14_t)-row[0], 0};
    uint32_t square = 0;
    q14_18_t off = 0;
    q14_18_t along = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const q14_18_t away = add_away(fuse, axis, &square);
        fixed_add_product(away, row[axis], &off);
        fixed_add_product(away, side[axis], &along);
        row[3 + axis] = (q2_14_t)fixed_scale_down(
            (int32_t)row[0] * fuse->state.level_from_body.row[0][axis] +
                (int32_t)row[1] * fuse->state.level_from_body.row[1][axis],
            14);
    }
    *noise = turning_noise(fuse, row, square);
    follow(&fuse->state.across_mean, off);
    follow(&fuse->state.along_mean, along);
    if (!fuse_is_at_rest(fuse) && fuse->state.drift_square < DRIFTING_LEVEL_Q30) {
        const int32_t more =
            (int32_t)fuse->state.across_mean * fuse->state.across_mean -
            (int32_t)fuse->state.along_mean * fuse->state.along_mean;
        fuse->state.drifting += fixed_byte_floor(more - fuse->state.drifting);
    }
    return off;
}

void fuse_stage_turning(struct fuse *fuse) {
    int32_t noise;
    if (!fuse->state.has_reading || fuse->state.turned_by == 0) {
        return;
    }
    const int32_t off = look_across(fuse, &noise);
    q2_14_t row[KALMAN_STATES] = {0};
    row[FUSE_TURNS] = fuse->state.turned_by;
    fuse_read_motion(
        fuse, row, noise,
        fixed_mul_q30(fixed_clamp_high(off, FIXED_HIGH(FIELD_STEP_MAX_Q18)),
                      TURNED_OFF_Q30));
}

// Measures how far the reading is from the expected one, and sets its noise by that:
// the farther, the less it weighs.
NOINLINE static void weigh_field(struct fuse *fuse) {
    struct {
        uint32_t square;  // of the distance, 4096ths of 1 uT2, at most 90 uT an axis
        int32_t longer;   // by how much the field's square is, 64ths of 1 uT2
        int32_t length, horizontal;
    } sum = {0};
    int32_t off = 0;
    int32_t longer_flat = 0;  // by how much the horizontal field's square is
    for (uint8_t axis = 0; axis < 3; ++axis) {
        const int32_t place =
            fixed_clamp_high(fuse->state.field_ut[axis], FIXED_HIGH(FIELD_FAR_Q18));
        off = add_away(fuse, axis, &sum.square);
        longer_flat = sum.longer;
        if (axis < 2) {
            fixed_add((int32_t)fixed_magnitude(place), &sum.horizontal);
        }
        fixed_add(fixed_mul_q30(off, off + 2 * place), &sum.longer);
        fixed_add(fixed_square_q30(place), &sum.length);
    }
    // A field of the same length and steepness means that the heading is wrong.
    fuse->state.is_turned =
        sum.square > FIELD_UNIT_TURNED &&
        fixed_magnitude(off) < (uint32_t)FIELD_TURNED_Q18 &&
        fixed_magnitude(longer_flat) <
            (uint32_t)fixed_mul_q14(sum.horizontal, FIELD_TURNED_GAIN_Q14);
    const uint16_t coarse =
        (uint16_t)fixed_clamp(fixed_divide((int32_t)sum.square, 64), UINT16_MAX);
    fuse->state.field_surprise =
        (uint16_t)(fuse->state.field_surprise -
                   fuse->state.field_surprise / SURPRISE_WINDOWS +
                   coarse / SURPRISE_WINDOWS);
    // sqrt(1 + square / unit), times 768
    q13_19_t *noise = &fuse->state.field_noise;
    *noise = FIELD_NOISE / 768 *
             (int32_t)fixed_sqrt(
                 (uint32_t)fixed_scale_up((int32_t)(FIELD_UNIT_FINE + sum.square), 4));
    if (fuse_is_at_rest(fuse)) {
        // Readings at rest repeat each other.
        *noise = fixed_times(
            fixed_clamp_high(*noise, FIXED_HIGH(FIELD_NOISE_MAX / FUSE_REST_FACTOR)),
            FUSE_REST_FACTOR);
    } else {
        // An error of level or heading turns a reading and leaves its length.
        const bool is_strange =
            sum.square > FIELD_UNIT_FINE && !fuse->state.is_turned &&
            fixed_magnitude(sum.longer) >
                (uint32_t)fixed_times(fixed_sqrt((uint32_t)sum.length), ASTRAY_LENGTH);
        fuse->state.field_astray =
            (uint16_t)(fuse->state.field_astray -
                       fuse->state.field_astray / ASTRAY_WINDOWS +
                       (is_strange ? UINT16_MAX / ASTRAY_WINDOWS : 0));
    }
    fixed_add_clamped_high(
        fixed_times(
            fixed_clamp(fuse_leaning(fuse, fuse->state.drift_square), LEANING_MAX_Q18),
            LEANING_NOISE),
        FIXED_HIGH(FIELD_NOISE_MAX), noise);
}

void fuse_stage_field(struct fuse *fuse) {
    if (!fuse->state.has_reading) {
        if (fuse->state.field_age < UINT8_MAX) {
            ++fuse->state.field_age;
        }
        predict_field(fuse);
        return;
    }
    if (fuse->state.field_age == UINT8_MAX && fuse_is_heading_free(fuse)) {
        fuse->state.field_learnt = 0;  // after this time, learn the local field again
    }
    if (fuse->state.windows == FUSE_LEVEL_SETTLE && !fuse_is_at_rest(fuse)) {
        fuse->state.field_learnt = 0;  // readings in motion had no good level
    }
    fuse->state.field_age = 0;
    if (fuse->state.field_learnt == FUSE_FIELD_LEARN && fuse_is_plain_again(fuse)) {
        fuse->state.field_learnt = 0;
        memset(&fuse->state.own_ut_q18, 0, sizeof fuse->state.own_ut_q18);
    }
    if (fuse->state.field_learnt < FUSE_FIELD_LEARN) {
        learn_place(fuse);
        fuse->state.has_reading = false;
        return;
    }
    predict_field(fuse);
    weigh_field(fuse);
}

// The probe seems to have no own field, and is known to have had none.
static bool has_no_own(const struct fuse *fuse) {
    return fuse->settings.own_variance < FUSE_OWN_CALIBRATED &&
           !fuse_is_at_rest(fuse) && !is_astray(fuse) &&
           !vector_exceeds(&fuse->state.own_ut_q18, OWN_NEAR_Q18);
}

void fuse_stage_field_axis(struct fuse *fuse, uint8_t axis) {
    q2_30_t gain[FUSE_FIELD_STATES];
    q2_14_t row[FUSE_FIELD_STATES] = {0};
    uint8_t state = axis;
    int32_t noise = OWN_DOUBT;
    q14_18_t away;
    if (!fuse->state.has_reading) {
        return;
    }
    if (axis < 3) {
        memcpy(row + 3, fuse->state.level_from_body.row[axis], 3 * sizeof *row);
        noise = fuse->state.field_noise;
        away = field_step(fuse, axis);
    } else if (has_no_own(fuse)) {
        state = (uint8_t)(3 + fuse->state.next_axis);
        away = -fuse->state.field_ut[state];
        fuse_next_axis(fuse);
    } else {
        return;
    }
    row[state] = FUSE_Q2_14_ONE;
    kalman_read(fuse->state.field_covariance, FUSE_FIELD_STATES, row, noise, gain);
    for (state = 0; state < FUSE_FIELD_STATES; ++state) {
        fixed_add_clamped_high(fixed_mul_q30(gain[state], away),
                               FIXED_HIGH(state < 3 ? PLACE_LIMIT_Q18 : OWN_LIMIT_Q18),
                               &fuse->state.field_ut[state]);
    }
}
