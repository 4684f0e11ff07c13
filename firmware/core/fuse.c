// SPDX-License-Identifier: MIT
// Measurement to orientation; see fuse.h. Frames: body, inertial (drifting with the
// gyroscope), level (z up, heading of the inertial frame), world (east, north, up).
#include "fuse.h"

enum {
    // Low-passes: VQF's tau_acc 3 s and rest filter 0.5 s; the field's 0.3 s.
    LEVEL_TAU_MS = 3000,
    REST_TAU_MS = 500,
    FIELD_TAU_MS = 300,
    FIELD_RATE_HZ = 100,
    // 12.5 ms of a reading behind the gyroscope, holding included: 256ths of a sample
    // for 5 Hz of sample rate.
    FIELD_LAG = 16,
    FIELD_REFERENCE = 200,  // readings whose mean is the reference: 2 s
    STEP_MAX_US = 7500,     // 38 rad/s an axis turn 0.5 rad in it
    STEPS_MAX = 8,
    REST_MS = 1500,       // VQF's rest: 1.5 s within 2 deg/s and 0.5 m/s2 of the mean
    FIELD_ONE = 16384,    // 1 of a squared distance
    SAMPLES_HELD = 4095,  // above every settling time; 16 k - 1
};

#define REST_RATE_Q25 INT32_C(1171299)          // 2 deg/s
#define REST_FORCE_Q21 INT32_C(1048576)         // 0.5 m/s2
#define REST_RATE_LIMIT_Q25 INT32_C(335544320)  // 10 rad/s: keeps the low-pass in range
#define BIAS_LIMIT_Q25 INT32_C(134217728)  // 4 rad/s: 42 rad/s of rate turn 0.55 rad
#define BIAS_VARIANCE_MAX_Q20 INT32_C(291271111)  // (0.5 deg/s)^2 over (0.03 deg/s)^2
#define FORCE_MIN_Q21 INT32_C(2097152)            // 1 m/s2: in free fall nothing levels
#define FIELD_ABSENT_US UINT32_C(1000000)
#define FIELD_HORIZONTAL_MIN_Q18 INT32_C(262144)  // 1 uT
#define FIELD_FAR_Q18 INT32_C(23592960)           // 30 * 3 uT
#define FIELD_STEP_MAX (15 * TURN32_DEGREE)
#define FIELD_DISTURBED_Q30 INT32_C(134217728)  // weight 1/8: d = 1
#define REFERENCE_GAIN_Q30 INT32_C(488064)      // 10 ms of 22 s
// One reading's heading variance, 22 deg2 s at 100 Hz, rad2.
#define HEADING_NOISE_Q30 INT32_C(719580000)
#define HEADING_VARIANCE_MAX_Q30 INT32_C(1073741824)  // (57 deg)^2
#define HEADING_FREE_Q30 INT32_C(294380000)           // (30 deg)^2
// 0.3 deg2/s of heading variance: rad2 as q2_30 a microsecond, a fraction of 2^32.
#define HEADING_DRIFT UINT32_C(421440000)
#define ONE_THIRD_Q30 INT32_C(357913941)
#define SQRT2_Q30 INT32_C(1518500250)

static struct lowpass_gain lowpass_gain_of(uint16_t rate_hz, uint16_t tau_ms) {
    // T / (sqrt(2) tau); tan x = x + x^3 / 3 for the small x of this house (< 0.03).
    const q2_30_t x = fixed_ratio(70711, (uint32_t)rate_hz * tau_ms * 100);
    const q2_30_t g = x + fixed_mul_q30(fixed_mul_q30(x, x), x) / 3;
    const q2_30_t sum = Q2_30_ONE + fixed_mul_q30(g, g) + fixed_mul_q30(g, SQRT2_Q30);
    return (struct lowpass_gain){g, fixed_ratio(Q2_30_ONE, (uint32_t)sum),
                                 (uint16_t)((uint32_t)rate_hz * tau_ms / 1000)};
}

static void lowpass_axis(int32_t *band, int32_t *level, const struct lowpass_gain *gain,
                         int32_t input, q2_30_t share) {
    const int32_t error = input - *level;
    if (share != 0) {
        *level += fixed_mul_q30(error, share);
        return;
    }
    const int32_t middle =
        fixed_mul_q30(*band + fixed_mul_q30(error, gain->integrator), gain->feedback);
    *level += 2 * fixed_mul_q30(middle, gain->integrator);
    *band = 2 * middle - *band;
}

// Takes the `count`th input (from 1). Needs |input| <= 1e9; the states stay below 1.1
// of the largest input.
static void lowpass_step(struct lowpass *filter, const struct lowpass_gain *gain,
                         const struct vector *input, uint16_t count) {
    // Of a mean as long as it settles.
    const q2_30_t share = count <= gain->settle ? Q2_30_ONE / count : 0;
    lowpass_axis(&filter->band.x, &filter->level.x, gain, input->x, share);
    lowpass_axis(&filter->band.y, &filter->level.y, gain, input->y, share);
    lowpass_axis(&filter->band.z, &filter->level.z, gain, input->z, share);
}

// Seconds times 2^35, so that rad/s q7_25 gives rad q2_30; |us| <= 10000 stay below
// 2^29. 2^35 / 1e6 = 34359 + 3171275686 / 2^32.
static int32_t seconds_q35(int32_t us) {
    const uint32_t magnitude = fixed_magnitude(us);
    const int32_t seconds =
        (int32_t)(magnitude * 34359 + fixed_umul_q32(magnitude, UINT32_C(3171275686)));
    return us < 0 ? -seconds : seconds;
}

void fuse_init(struct fuse *fuse, uint16_t rate_hz, uint16_t gyr_delay_us) {
    *fuse = (struct fuse){
        .coefficients =
            {
                .rate_hz = rate_hz,
                .level = lowpass_gain_of(rate_hz, LEVEL_TAU_MS),
                .rest = lowpass_gain_of(rate_hz / 2, REST_TAU_MS),
                .field = lowpass_gain_of(FIELD_RATE_HZ, FIELD_TAU_MS),
                .rate_square_gain = Q2_30_ONE / 3 / rate_hz,
                // VQF: bias wanders 0.1 deg/s in 100 s, a reading at rest has 0.03
                // deg/s: 0.01 / 100 / 0.0009 a second.
                .bias_forgetting = 2 * INT32_C(116508) / rate_hz,
                .rest_needed = (uint16_t)((uint32_t)rate_hz * REST_MS / 2000),
                .field_lag = (uint16_t)((uint32_t)rate_hz * FIELD_LAG / 5),
                // A mean rate over the sample period would be half a period old.
                .lead_s_q35 =
                    seconds_q35(gyr_delay_us - (int32_t)(UINT32_C(500000) / rate_hz)),
                .history_stride = (uint8_t)((rate_hz + 199) / 200),
            },
        .bias_variance = BIAS_VARIANCE_MAX_Q20,
    };
    fuse_restart(fuse);
}

void fuse_restart(struct fuse *fuse) {
    fuse->inertial_from_body = QUAT_IDENTITY;
    fuse->level_from_inertial = QUAT_IDENTITY;
    fuse->level_from_body = QUAT_IDENTITY;
    fuse->history_phase = 0;
    fuse->force = (struct lowpass){{0, 0, 0}, {0, 0, 0}};
    fuse->rest_rate = (struct lowpass){{0, 0, 0}, {0, 0, 0}};
    fuse->rest_force = (struct lowpass){{0, 0, 0}, {0, 0, 0}};
    fuse->rest_samples = 0;
    fuse->rest_looks = 0;
    fuse->is_rest_due = false;
    fuse->is_level_due = false;
    fuse->has_waited = false;
    fuse->heading_variance = HEADING_VARIANCE_MAX_Q30;
    fuse->field_weight = Q2_30_ONE;
    fuse->field_age_us = FIELD_ABSENT_US;
    fuse->rate_square = 0;
    fuse->samples = 0;
}

void fuse_set_bias(struct fuse *fuse, const struct vector *bias_rad_s_q25) {
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &fuse->bias_rad_s_q25);
    fuse->calibrated_rad_s_q25 = fuse->bias_rad_s_q25;
    fuse->bias_variance = 116508;  // (0.01 deg/s)^2 over (0.03 deg/s)^2
}

// True where |v - mean| is below the limit, which is at most 2^21.
static bool is_near(const struct vector *v, const struct vector *mean, int32_t limit) {
    struct vector away;
    vector_subtract(v, mean, &away);
    if (vector_exceeds(&away, limit)) {
        return false;
    }
    // 2^9 keeps the precision of the squares.
    const uint32_t bound = (uint32_t)limit * 512;
    away = (struct vector){away.x * 512, away.y * 512, away.z * 512};
    return vector_square_q32(&away) < fixed_umul_q32(bound, bound);
}

// Rest: rates and force have stayed near their short mean, and the mean rate near the
// calibrated bias. At rest the mean rate is the bias.
static void follow_rest(struct fuse *fuse, const struct measurement *measurement) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    const struct vector *force = &measurement->acc_m_s2_q21;
    const struct vector *mean_rate = &fuse->rest_rate.level;
    struct vector *bias = &fuse->bias_rad_s_q25;
    struct vector rate;
    struct vector wander;
    if (fuse->rest_looks < coefficients->rest.settle + 1U) {
        ++fuse->rest_looks;
    }
    vector_clamp(&measurement->gyr_rad_s_q25, REST_RATE_LIMIT_Q25, &rate);
    lowpass_step(&fuse->rest_rate, &coefficients->rest, &rate, fuse->rest_looks);
    lowpass_step(&fuse->rest_force, &coefficients->rest, force, fuse->rest_looks);
    vector_subtract(mean_rate, &fuse->calibrated_rad_s_q25, &wander);
    if (!is_near(&rate, mean_rate, REST_RATE_Q25) ||
        !is_near(force, &fuse->rest_force.level, REST_FORCE_Q21) ||
        vector_exceeds(&wander, REST_RATE_Q25)) {
        fuse->rest_samples = 0;
    } else if (fuse->rest_samples < coefficients->rest_needed) {
        ++fuse->rest_samples;
    }
    fuse->bias_variance = fixed_clamp(
        fuse->bias_variance + coefficients->bias_forgetting, BIAS_VARIANCE_MAX_Q20);
    if (fuse->rest_samples < coefficients->rest_needed) {
        return;
    }
    const q2_30_t gain = fixed_ratio((uint32_t)fuse->bias_variance,
                                     (uint32_t)fuse->bias_variance + UINT32_C(1048576));
    fuse->bias_variance -= fixed_mul_q30(fuse->bias_variance, gain);
    struct vector step;
    vector_subtract(mean_rate, bias, &step);
    vector_scale(&step, gain, &step);
    *bias = (struct vector){bias->x + step.x, bias->y + step.y, bias->z + step.z};
}

static void integrate(struct fuse *fuse, const struct vector *rate_q25,
                      uint32_t interval_us) {
    for (uint8_t step = 0; step < STEPS_MAX && interval_us > 0; ++step) {
        const uint32_t part = interval_us > STEP_MAX_US ? STEP_MAX_US : interval_us;
        interval_us -= part;
        struct vector angle;
        struct quat turn;
        vector_scale(rate_q25, seconds_q35((int32_t)part), &angle);
        quat_from_small_angle(&angle, &turn);
        quat_multiply(&fuse->inertial_from_body, &turn, &fuse->inertial_from_body);
    }
}

static void filter_force(struct fuse *fuse, const struct vector *force_body_q21) {
    struct vector force;
    quat_rotate(&fuse->inertial_from_body, force_body_q21, &force);
    lowpass_step(&fuse->force, &fuse->coefficients.level, &force, fuse->samples);
}

// Turns the level frame so that the low-passed specific force points up.
static void follow_gravity(struct fuse *fuse) {
    struct quat *level = &fuse->level_from_inertial;
    struct vector up;
    int32_t norm;
    quat_rotate(level, &fuse->force.level, &up);
    if (!vector_normalise(&up, &up, &norm) || norm < FORCE_MIN_Q21) {
        return;
    }
    if (up.z < 0) {
        // More than a quarter turn away, which only the start sees: half a turn about x
        // first, so that what remains is well conditioned.
        *level = (struct quat){-level->x, level->w, -level->z, level->y};
        up.y = -up.y;
        up.z = -up.z;
    }
    // The shortest turn that takes `up` to z: cosine c of half its angle from
    // c^2 = (1 + up_z) / 2, which is in [1/2, 1].
    uint32_t square = ((uint32_t)Q2_30_ONE + (uint32_t)up.z) * 2;
    if (square < UINT32_C(0x80000000)) {
        square = UINT32_MAX;  // up_z reached 1 and the fraction wrapped
    }
    const q2_30_t inverse = fixed_rsqrt(square);
    const q2_30_t half_inverse = fixed_half_floor(inverse);
    const struct quat turn = {(q2_30_t)fixed_umul_q32(square, (uint32_t)inverse),
                              fixed_mul_q30(up.y, half_inverse),
                              -fixed_mul_q30(up.x, half_inverse), 0};
    quat_multiply(&turn, level, level);
}

// The orientation of FIELD_LAG_US ago, between two that are remembered.
static void orientation_at_field(const struct fuse *fuse, struct quat *out) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    // Strides back from the latest remembered, in 256ths. It is below FUSE_HISTORY - 1
    // because a stride is 5 ms or more.
    const uint16_t past = (uint16_t)(fuse->history_phase * 256U);
    const uint16_t lag = (uint16_t)((uint16_t)(coefficients->field_lag - past) /
                                    coefficients->history_stride);
    const q2_30_t fraction = (int32_t)(lag % 256) * (Q2_30_ONE / 256);
    const struct quat *a = &fuse->history[lag / 256];
    const struct quat *b = a + 1;
    out->w = a->w + fixed_mul_q30(fixed_sub_sat(b->w, a->w), fraction);
    out->x = a->x + fixed_mul_q30(fixed_sub_sat(b->x, a->x), fraction);
    out->y = a->y + fixed_mul_q30(fixed_sub_sat(b->y, a->y), fraction);
    out->z = a->z + fixed_mul_q30(fixed_sub_sat(b->z, a->z), fraction);
    quat_renormalise(out);
}

static void remember_orientation(struct fuse *fuse) {
    quat_multiply(&fuse->level_from_inertial, &fuse->inertial_from_body,
                  &fuse->level_from_body);
    if (fuse->samples == 1) {  // nothing earlier is known: it has always been so
        for (uint8_t i = 0; i < FUSE_HISTORY; ++i) {
            fuse->history[i] = fuse->level_from_body;
        }
    }
    ++fuse->history_phase;
    if (fuse->history_phase >= fuse->coefficients.history_stride) {
        fuse->history_phase = 0;
        for (uint8_t i = FUSE_HISTORY - 1; i > 0; --i) {
            fuse->history[i] = fuse->history[i - 1];
        }
        fuse->history[0] = fuse->level_from_body;
    }
}

// How much a reading weighs by its distance d from the reference: 1 / (1 + d^2)^3, with
// 3 uT of norm and 6 uT of vertical part as the units of d. At most 30 units count.
static q2_30_t weigh_field(struct fuse *fuse, const struct vector *norm_and_up_q18) {
    struct vector *reference = &fuse->reference_ut_q18;
    const bool is_learning = fuse->field_samples < FIELD_REFERENCE;
    if (is_learning) {
        ++fuse->field_samples;
    }
    lowpass_step(&fuse->field, &fuse->coefficients.field, norm_and_up_q18,
                 fuse->field_samples);
    if (is_learning) {
        reference->x += (norm_and_up_q18->x - reference->x) / fuse->field_samples;
        reference->y += (norm_and_up_q18->y - reference->y) / fuse->field_samples;
        return Q2_30_ONE;
    }
    const int32_t norm_away = fuse->field.level.x - reference->x;
    const int32_t up_away = fuse->field.level.y - reference->y;
    // In units of d, 22 fraction bits: / 3 and / 6, times 16.
    const int32_t norm_d =
        fixed_mul_q30(fixed_clamp(norm_away, FIELD_FAR_Q18), ONE_THIRD_Q30) * 16;
    const int32_t up_d =
        fixed_mul_q30(fixed_clamp(up_away, 2 * FIELD_FAR_Q18), ONE_THIRD_Q30) * 8;
    // d^2 with 14 fraction bits, at most 2 * 30^2.
    const uint32_t d2 =
        (uint32_t)(fixed_mul_q30(norm_d, norm_d) + fixed_mul_q30(up_d, up_d));
    if (d2 < FIELD_ONE && fuse->rest_samples == 0) {
        // The reference follows the place, in 22 s, while nothing disturbs.
        reference->x += fixed_mul_q30(norm_away, REFERENCE_GAIN_Q30);
        reference->y += fixed_mul_q30(up_away, REFERENCE_GAIN_Q30);
    }
    const q2_30_t once = fixed_ratio(FIELD_ONE, FIELD_ONE + d2);
    return fixed_mul_q30(fixed_mul_q30(once, once), once);
}

static void follow_field(struct fuse *fuse, const struct vector *field_body_q18) {
    struct quat lagging;
    struct vector field;
    struct vector unit;
    struct vector norm_and_up = {0, 0, 0};
    orientation_at_field(fuse, &lagging);
    quat_rotate(&lagging, field_body_q18, &field);
    if (!vector_normalise(&field, &unit, &norm_and_up.x)) {
        return;  // no field at all: no reading
    }
    norm_and_up.y = field.z;
    fuse->field_age_us = 0;
    fuse->field_weight = weigh_field(fuse, &norm_and_up);
    if (fixed_magnitude(field.x) < FIELD_HORIZONTAL_MIN_Q18 &&
        fixed_magnitude(field.y) < FIELD_HORIZONTAL_MIN_Q18) {
        fuse->field_weight = 0;  // it points along the vertical and tells no heading
        return;
    }
    // The turn about z that brings the horizontal field to north, y.
    const turn32_t measured = fixed_atan2(field.x, field.y);
    if (fuse->heading_variance == HEADING_VARIANCE_MAX_Q30) {
        fuse->heading = measured;  // nothing is known of it yet
        fuse->heading_variance = HEADING_NOISE_Q30;
        return;
    }
    // Kalman's gain of one angle, with the noise over the weight as its noise.
    const q2_30_t weighted = fixed_mul_q30(fuse->heading_variance, fuse->field_weight);
    const q2_30_t gain =
        fixed_ratio((uint32_t)weighted, (uint32_t)weighted + HEADING_NOISE_Q30);
    turn32_t away = turn32_sub(measured, fuse->heading);
    if (fuse->field_samples == FIELD_REFERENCE) {
        // A step of 15 deg at most; at the start the first reading may have been poor.
        away = fixed_clamp(away, FIELD_STEP_MAX);
    }
    fuse->heading = turn32_add(fuse->heading, fixed_mul_q30(away, gain));
    fuse->heading_variance -= fixed_mul_q30(fuse->heading_variance, gain);
}

// What is slow takes turns, rest one sample and the vertical the next, and waits one
// sample for a field that comes: no sample carries all of it. Only the first does not
// wait, since its field needs a level.
static void share_out(struct fuse *fuse, const struct measurement *measurement) {
    if (fuse->samples % 2 == 0) {
        fuse->is_rest_due = true;
    } else {
        fuse->is_level_due = true;
    }
    if (measurement->has_mag && !fuse->has_waited && fuse->samples > 1) {
        fuse->has_waited = true;
        return;
    }
    fuse->has_waited = false;
    if (fuse->is_rest_due) {
        fuse->is_rest_due = false;
        follow_rest(fuse, measurement);
    }
    if (fuse->is_level_due) {
        fuse->is_level_due = false;
        follow_gravity(fuse);
    }
}

void fuse_step(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us) {
    // Held where it no longer matters, in steps that keep its turn.
    fuse->samples = (uint16_t)(fuse->samples < SAMPLES_HELD ? fuse->samples + 1
                                                            : SAMPLES_HELD - 15);
    struct vector *rate = &fuse->rate_rad_s_q25;
    vector_subtract(&measurement->gyr_rad_s_q25, &fuse->bias_rad_s_q25, rate);
    integrate(fuse, rate, interval_us);
    filter_force(fuse, &measurement->acc_m_s2_q21);
    share_out(fuse, measurement);
    if (fuse->samples % 16 == 0) {
        quat_renormalise(&fuse->inertial_from_body);
    } else if (fuse->samples % 16 == 8) {
        quat_renormalise(&fuse->level_from_inertial);
    }
    remember_orientation(fuse);
    // Known less and less while nothing corrects it; a second at most is added at once.
    const uint32_t drift_us = interval_us > 1000000 ? 1000000 : interval_us;
    if (fuse->heading_variance < HEADING_VARIANCE_MAX_Q30) {
        fuse->heading_variance = fixed_clamp(
            fuse->heading_variance + (int32_t)fixed_umul_q32(drift_us, HEADING_DRIFT),
            HEADING_VARIANCE_MAX_Q30 - 1);
    }
    if (fuse->field_age_us < FIELD_ABSENT_US) {
        fuse->field_age_us += drift_us;
    }
    if (measurement->has_mag) {
        follow_field(fuse, &measurement->mag_ut_q18);
    }
    const uint32_t square = vector_square_q32(rate);  // (rad/s)^2 as q14_18
    fuse->rate_square += fixed_mul_q30((int32_t)square - fuse->rate_square,
                                       fuse->coefficients.rate_square_gain);
}

void fuse_orientation(const struct fuse *fuse, struct quat *out) {
    struct vector angle;
    struct quat turn;
    q2_30_t s;
    q2_30_t c;
    // The heading's turn about z, which has but two parts.
    const struct quat *level = &fuse->level_from_body;
    fixed_sincos(fuse->heading / 2, &s, &c);
    *out = (struct quat){fixed_mul_q30(c, level->w) - fixed_mul_q30(s, level->z),
                         fixed_mul_q30(c, level->x) - fixed_mul_q30(s, level->y),
                         fixed_mul_q30(c, level->y) + fixed_mul_q30(s, level->x),
                         fixed_mul_q30(c, level->z) + fixed_mul_q30(s, level->w)};
    // The gyroscope's low-pass still holds back the last few milliseconds: they are
    // made up with the last rate.
    vector_scale(&fuse->rate_rad_s_q25, fuse->coefficients.lead_s_q35, &angle);
    quat_from_small_angle(&angle, &turn);
    quat_multiply(out, &turn, out);
    quat_renormalise(out);
}

void fuse_quality(const struct fuse *fuse, struct fuse_quality *out) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    out->is_starting = fuse->samples < coefficients->level.settle;
    out->is_at_rest = fuse->rest_samples == coefficients->rest_needed;
    out->is_mag_absent = fuse->field_age_us >= FIELD_ABSENT_US;
    out->is_mag_disturbed =
        !out->is_mag_absent && fuse->field_weight < FIELD_DISTURBED_Q30;
    out->is_heading_free = fuse->heading_variance > HEADING_FREE_Q30;
    // 0.312^2 + (0.221 W / 100 deg/s)^2 deg2, W the rms rate over 3 s, as 1e-4 deg2:
    // 973 + 160.3 (rad/s)^2. Fitted to recordings with optical truth.
    const uint32_t tilt = 973 + fixed_umul_q32((uint32_t)fuse->rate_square, 2626356);
    out->tilt_sigma_cdeg = out->is_starting ? UINT16_MAX : fixed_sqrt(tilt);
    // 1.5 deg of the field's own error at the start, and the filter's variance: rad2
    // q2_30 to 1e-4 deg2 is 0.030573.
    const uint32_t heading =
        22500 + fixed_umul_q32((uint32_t)fuse->heading_variance, 131310000);
    out->heading_sigma_cdeg =
        out->is_starting || out->is_heading_free ? UINT16_MAX : fixed_sqrt(heading);
}
