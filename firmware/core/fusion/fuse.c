// SPDX-License-Identifier: MIT
// Measurement to orientation; see fuse.h. Frames of reference: body, inertial (drifting
// with the gyroscope), level (z up, heading of the inertial frame), world (east, north,
// up).
#include "core/fusion/fuse.h"

#include <stddef.h>
#include <string.h>

enum {
    FRAMES_HZ = 10,
    STAGES = 10,         // of a frame: at 100 samples a second, one a sample
    LEVEL_SETTLE = 30,   // frames in VQF's tau_acc, 3 s
    STEP_MAX_US = 7500,  // 41.4 rad/s an axis and 2 % of scale turn 0.55 rad in it
    STEPS_MAX = 8,
    // VQF's rest: 1.5 s within 2 deg/s and 0.5 m/s2 of a mean of 0.5 s.
    REST_SETTLE = 50,
    REST_LOOKS = 150,
    // Samples of a frame whose motion was lost, from which on nothing is known; and the
    // frames after any in which levelling tells nothing of bias.
    CLIPPED_LOST = 4,
    UNSETTLED = 100,
    FIELD_LEARN = 20,      // readings whose mean is the first field: 2 s
    FIELD_ABSENT = 10,     // frames without a reading
    FIELD_UNIT = 576,      // (3 uT)^2 as 64ths of 1 uT2
    FIELD_ASTRAY = 32767,  // half: the field of the probe has changed
    Q2_14_ONE = 16384,
};

// A reading is 12.5 ms behind the gyroscope, its holding included, give or take 5 ms by
// a sensor's clocks: seconds times 2^35, and half of a variance in ms2.
#define LAG_Q35 INT32_C(429496730)
#define LAG_MAX_Q35 INT32_C(1030792151)         // 30 ms
#define LAG_MS_Q17 INT32_C(131)                 // a ms q14_18 as seconds times 2^35
#define LAG_VARIANCE INT32_C(6553600)           // 12.5 ms2
#define LAG_RATE_Q25 INT32_C(1207959552)        // 36 rad/s an axis: 62.4 in all
#define LAG_FIELD_Q18 INT32_C(52428800)         // 200 uT an axis
#define LAG_SLOPE_MAX INT32_C(16383500)         // 2 uT/ms as uT/s q18_13
#define REST_RATE_Q25 INT32_C(1171299)          // 2 deg/s
#define REST_FORCE_Q21 INT32_C(1048576)         // 0.5 m/s2
#define REST_RATE_LIMIT_Q25 INT32_C(335544320)  // 10 rad/s: keeps the low-pass in range
#define BIAS_LIMIT_Q25 INT32_C(114085069)       // 3.4 rad/s
#define FORCE_LIMIT_Q13 INT32_C(3906250)  // 477 m/s2: more than the range's corner
#define FORCE_MIN_Q21 INT32_C(2097152)    // 1 m/s2: in free fall nothing levels

// Bias and scale. Variances in (deg/s)^2 and 500ths squared as q6_26.
#define BIAS_VARIANCE_MAX INT32_C(16777216)    // (0.5 deg/s)^2
#define BIAS_VARIANCE_FOUND INT32_C(6711)      // (0.01 deg/s)^2
#define SCALE_VARIANCE_MAX INT32_C(150994944)  // 0.3 %: (1.5 / 500)^2
#define MOTION_WANDER INT32_C(671)             // 1e-4 a second
#define MOTION_NOISE INT32_C(201326592)  // 0.3 (deg/s)^2 s of what levelling corrects
#define REST_NOISE INT32_C(60398)        // (0.03 deg/s)^2 of a mean at rest
#define TILTING_LIMIT_Q25 INT32_C(2928177)    // 5 deg/s
#define TURN_MEAN_LIMIT_Q17 INT32_C(2228224)  // 17 rad/s an axis: 29.4 in all
#define TURN_LIMIT_Q25 INT32_C(439226488)     // 1.5 * 500 deg/s
#define SCALE_LIMIT_Q30 INT32_C(21474836)     // 2 %
// e of a frame to rad/s q7.25: 10 / 2^5.
#define TILTING_GAIN_Q30 INT32_C(335544320)
// rad/s q7.25 over 500 deg/s to q2_14: 2^-11 * 0.1145916.
#define TURN_GAIN_Q30 INT32_C(60079)
// Scale a rad/s of surprise, from q7.25 to q2_30: 57.29578 / 500 * 2^5, halved.
#define SCALE_GAIN_Q30 INT32_C(1968667994)

// Field. Variances in uT2 as q13_19; noise of 5 uT2 s: mostly what is uneven in the
// field of a room.
#define OWN_VARIANCE INT32_C(327680)    // (0.79 uT)^2: what a calibration leaves
#define PLACE_VARIANCE INT32_C(131072)  // (0.5 uT)^2 of a mean of 2 s at rest
#define PLACE_VARIANCE_MOVING INT32_C(4849664)  // 9.25 uT2 where there was no rest
#define FIELD_VARIANCE_MAX INT32_C(42467328)    // (9 uT)^2
#define FIELD_NOISE INT32_C(26214400)           // 5 uT2 s over 0.1 s
#define FIELD_NOISE_MAX INT32_C(471859200)      // 900 uT2
#define PLACE_WANDER INT32_C(1573)              // 0.03 uT2/s
#define OWN_WANDER INT32_C(1)                   // (0.26 uT)^2 an hour
#define OWN_WANDER_ASTRAY INT32_C(838861)       // 16 uT2/s
#define FIELD_UNIT_FINE (FIELD_UNIT * UINT32_C(64))
#define FIELD_STEP_MAX_Q18 INT32_C(1572864)     // 6 uT
#define FIELD_FAR_Q18 INT32_C(23592960)         // 30 * 3 uT
#define PLACE_LIMIT_Q18 INT32_C(943718400)      // 3600 uT
#define OWN_LIMIT_Q18 INT32_C(104857600)        // 400 uT
#define PLACE_TURNED_Q18 INT32_C(15728640)      // 60 uT
#define PLACE_SPREAD_MAX INT32_C(31457280)      // 60 uT2, below the variances' limit
#define FIELD_TURNED_Q18 INT32_C(786432)        // 3 uT
#define FIELD_TURNED_GAIN_Q30 INT32_C(1572864)  // 2 * 3 uT times uT q14_18 to 64ths
#define HORIZONTAL_MIN_Q18 INT32_C(262144)      // 1 uT
// Heading variance that a frame adds, rad2 as 2^-40ths: 0.05 deg2/s; 0.3 where no
// reading comes; 40 where readings say that it is wrong; and 20 s times the mean of the
// bias' three variances, halved.
#define HEADING_WANDER INT32_C(1674652)
#define HEADING_WANDER_ALONE INT32_C(10047910)
#define HEADING_WANDER_TURNED INT32_C(1339721268)
#define HEADING_WANDER_BIAS_Q30 INT32_C(1786295440)
// What a heading's stated variance has beside the covariance's share: the field is seen
// through a level that is 0.3 deg off.
#define LEVEL_ERROR_Q30 INT32_C(5622099)
#define COVARIANCE_SHARE_Q30 INT32_C(161061274)       // 0.15: fitted, see fuse_quality
#define HEADING_VARIANCE_MAX_Q30 INT32_C(1073741824)  // (57 deg)^2
#define HEADING_FREE_Q30 INT32_C(294380000)           // (30 deg)^2

// A stage's numbers are on the stack only while it runs.
#define NOINLINE __attribute__((noinline))

// Of VQF's tau_acc, 3 s, at FRAMES_HZ.
static const struct lowpass_gain level_gain = {INT32_C(25313025), INT32_C(1038540224),
                                               LEVEL_SETTLE};

// Of VQF's rest filter, 0.5 s, at 100 looks a second.
static const struct lowpass_gain rest_gain = {INT32_C(15186015), INT32_C(1052480291),
                                              REST_SETTLE};

// Takes the `count`th input (from 1). Needs |input| <= 1e9; the states stay below 1.1
// of the largest input.
static void lowpass_axis_step(struct lowpass_axis *axis,
                              const struct lowpass_gain *gain, int32_t input,
                              uint8_t count) {
    const int32_t error = input - axis->level;
    if (count <= gain->settle) {  // a mean as long as it settles
        axis->level += error / count;
        return;
    }
    const int32_t middle = fixed_mul_q30(
        axis->band + fixed_mul_q30(error, gain->integrator), gain->feedback);
    axis->level += 2 * fixed_mul_q30(middle, gain->integrator);
    axis->band = 2 * middle - axis->band;
}

static void lowpass_step(struct lowpass *filter, const struct lowpass_gain *gain,
                         const struct vector *input, uint8_t count) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        lowpass_axis_step(&filter->axis[axis], gain, input->axis[axis], count);
    }
}

static void lowpass_level(const struct lowpass *filter, struct vector *out) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        out->axis[axis] = filter->axis[axis].level;
    }
}

// Seconds times 2^35, so that rad/s q7_25 gives rad q2_30, within 4e-7 of them. Needs
// |us| <= 15000.
static int32_t seconds_q35(int32_t us) {
    return us * INT32_C(137439) / 4;
}

// Of a bias that nothing else is known of; what is known of the scale stays.
static void set_motion_covariance(struct fuse *fuse, int32_t bias_variance) {
    int32_t *covariance = fuse->motion_covariance;
    const int32_t scale_variance = covariance[kalman_variance(3)];
    memset(covariance, 0, sizeof fuse->motion_covariance);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        covariance[kalman_variance(axis)] = bias_variance;
    }
    covariance[kalman_variance(3)] = scale_variance;
}

void fuse_init(struct fuse *fuse, uint16_t rate_hz, uint16_t gyr_delay_us) {
    struct fuse_coefficients *coefficients = &fuse->coefficients;
    memset(fuse, 0, sizeof *fuse);
    coefficients->frame = (uint8_t)(rate_hz / FRAMES_HZ);
    coefficients->stride = (uint8_t)(rate_hz / (FRAMES_HZ * STAGES));
    coefficients->share = Q2_30_ONE / coefficients->frame;
    // A mean rate over the sample period would be half a period old.
    coefficients->lead_s_q35 =
        seconds_q35(gyr_delay_us - (int32_t)(UINT32_C(500000) / rate_hz));
    fuse->lag_s_q35 = LAG_Q35;
    fuse->lag_variance = LAG_VARIANCE;
    fuse->motion_covariance[kalman_variance(3)] = SCALE_VARIANCE_MAX;
    set_motion_covariance(fuse, BIAS_VARIANCE_MAX);
    fuse_restart(fuse);
}

void fuse_restart(struct fuse *fuse) {
    const size_t kept = offsetof(struct fuse, inertial_from_body);
    memset((uint8_t *)fuse + kept, 0, sizeof *fuse - kept);
    fuse->inertial_from_body = QUAT_IDENTITY;
    fuse->level_from_inertial = QUAT_IDENTITY;
    fuse->world_from_inertial = QUAT_IDENTITY;
    fuse->stage = STAGES;
    fuse->field_age = FIELD_ABSENT;
    fuse->heading_variance = HEADING_VARIANCE_MAX_Q30;
}

void fuse_set_bias(struct fuse *fuse, const struct vector *bias_rad_s_q25) {
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &fuse->bias_rad_s_q25);
    fuse->calibrated_rad_s_q25 = fuse->bias_rad_s_q25;
    set_motion_covariance(fuse, BIAS_VARIANCE_FOUND);
}

// True where |v - mean| is below the limit, which is at most 2^21.
static bool is_near(const struct vector *v, const struct lowpass *mean, int32_t limit) {
    struct vector away;
    lowpass_level(mean, &away);
    vector_subtract(v, &away, &away);
    if (vector_exceeds(&away, limit)) {
        return false;
    }
    // 2^9 keeps the precision of the squares.
    const uint32_t bound = (uint32_t)limit * 512;
    away = (struct vector){.x = away.x * 512, .y = away.y * 512, .z = away.z * 512};
    return vector_square_q32(&away) < fixed_umul_q32(bound, bound);
}

// Rest: rates and force have stayed near their short mean, and the mean rate near the
// calibrated bias.
NOINLINE static void look_for_rest(struct fuse *fuse,
                                   const struct measurement *measurement) {
    struct vector rate;
    struct vector wander;
    if (fuse->settled_looks <= REST_SETTLE) {
        ++fuse->settled_looks;
    }
    vector_clamp(&measurement->gyr_rad_s_q25, REST_RATE_LIMIT_Q25, &rate);
    lowpass_step(&fuse->rest_rate, &rest_gain, &rate, fuse->settled_looks);
    lowpass_step(&fuse->rest_force, &rest_gain, &measurement->acc_m_s2_q21,
                 fuse->settled_looks);
    lowpass_level(&fuse->rest_rate, &wander);
    vector_subtract(&wander, &fuse->calibrated_rad_s_q25, &wander);
    if (!is_near(&rate, &fuse->rest_rate, REST_RATE_Q25) ||
        !is_near(&measurement->acc_m_s2_q21, &fuse->rest_force, REST_FORCE_Q21) ||
        vector_exceeds(&wander, REST_RATE_Q25)) {
        fuse->rest_looks = 0;
    } else if (fuse->rest_looks < REST_LOOKS) {
        ++fuse->rest_looks;
    }
}

static bool is_at_rest(const struct fuse *fuse) {
    return fuse->rest_looks == REST_LOOKS;
}

static void turn_small(struct quat *q, const struct vector *angle_rad_q30) {
    struct quat turn;
    quat_from_small_angle(angle_rad_q30, &turn);
    quat_multiply(q, &turn, q);
}

static void integrate(struct fuse *fuse, uint32_t interval_us) {
    for (uint8_t step = 0; step < STEPS_MAX && interval_us > 0; ++step) {
        const uint32_t part = interval_us > STEP_MAX_US ? STEP_MAX_US : interval_us;
        interval_us -= part;
        struct vector angle;
        int32_t seconds = seconds_q35((int32_t)part);
        seconds += fixed_mul_q30(seconds, fuse->scale);
        vector_scale(&fuse->rate_rad_s_q25, seconds, &angle);
        turn_small(&fuse->inertial_from_body, &angle);
    }
}

// Adds v, brought to the inertial frame, to a sum over the frame, with 8 bits less.
static void add_turned(const struct matrix *inertial_from_body, const struct vector *v,
                       struct vector *sum) {
    const int32_t fine[3] = {fixed_scale_down(v->x, 8), fixed_scale_down(v->y, 8),
                             fixed_scale_down(v->z, 8)};
    int32_t turned[3];
    matrix_turn(inertial_from_body, fine, turned);
    sum->x += turned[0];
    sum->y += turned[1];
    sum->z += turned[2];
}

// The mean of a frame, each axis held within +-limit / 256, in the format of what was
// added; empties the sum.
static void take_mean(const struct fuse *fuse, struct vector *sum, int32_t limit,
                      struct vector *out) {
    vector_scale(sum, fuse->coefficients.share, out);
    vector_clamp(out, limit, out);
    *out = (struct vector){.x = out->x * 256, .y = out->y * 256, .z = out->z * 256};
    *sum = (struct vector){0};
}

// Turns the level frame so that the low-passed specific force points up. Leaves what it
// had to turn about x and y in a frame, as a rate.
static void follow_gravity(struct fuse *fuse) {
    struct quat *level = &fuse->level_from_inertial;
    struct vector up;
    int32_t norm;
    fuse->tilting_rad_s[0] = 0;
    fuse->tilting_rad_s[1] = 0;
    lowpass_level(&fuse->force, &up);
    quat_rotate(level, &up, &up);
    if (!vector_normalise(&up, &up, &norm) || norm < FORCE_MIN_Q21) {
        return;
    }
    fuse->tilting_rad_s[0] = fixed_mul_q30(up.y, TILTING_GAIN_Q30);
    fuse->tilting_rad_s[1] = -fixed_mul_q30(up.x, TILTING_GAIN_Q30);
    // The shortest turn that takes `up` to z, (1 + z, y, -x, 0) of any length; half a
    // turn about x from straight down.
    struct vector half = {.x = Q2_30_ONE / 2 + fixed_half_floor(up.z),
                          .y = fixed_half_floor(up.y),
                          .z = -fixed_half_floor(up.x)};
    struct quat turn = {0, Q2_30_ONE, 0, 0};
    if (vector_normalise(&half, &half, &norm)) {
        turn = (struct quat){half.x, half.y, half.z, 0};
    }
    quat_multiply(&turn, level, level);
    quat_renormalise(level);
}

// It has changed unseen: goes on from the one there is as from a first guess.
static void lose_orientation(struct fuse *fuse) {
    memset(&fuse->force, 0, sizeof fuse->force);
    memset(fuse->regressor, 0, sizeof fuse->regressor);
    fuse->frames = 0;
    fuse->field_learnt = 0;
    fuse->heading_variance = HEADING_VARIANCE_MAX_Q30;
}

// Stage: the vertical.
NOINLINE static void stage_level(struct fuse *fuse) {
    struct vector force;
    if (fuse->clipped >= CLIPPED_LOST) {
        lose_orientation(fuse);
    }
    fuse->clipped = 0;
    if (fuse->unsettled > 0) {
        --fuse->unsettled;
    }
    if (fuse->frames < UINT8_MAX) {
        ++fuse->frames;
    }
    take_mean(fuse, &fuse->force_sum_q13, FORCE_LIMIT_Q13, &force);
    lowpass_step(&fuse->force, &level_gain, &force, fuse->frames);
    follow_gravity(fuse);
}

// A reading of the field is old: it is kept with the attitude of then, which the last
// rate leads back to. Angles are held within 0.3 rad an axis.
NOINLINE static void take_reading(struct fuse *fuse,
                                  const struct vector *field_ut_q18) {
    struct vector angle;
    vector_clamp(&fuse->rate_rad_s_q25, LAG_RATE_Q25, &angle);
    memcpy(fuse->reading_rad_s, angle.axis, sizeof fuse->reading_rad_s);
    vector_scale(&fuse->rate_rad_s_q25, -fuse->lag_s_q35, &angle);
    vector_clamp(&angle, INT32_C(322122547), &angle);
    fuse->reading_attitude = fuse->inertial_from_body;
    turn_small(&fuse->reading_attitude, &angle);
    memcpy(fuse->reading_ut, field_ut_q18->axis, sizeof fuse->reading_ut);
    fuse->has_reading = true;
}

// Stage: how errors of the gyroscope would tilt: two rows of the attitude (of -1 to 1
// as 2^29ths) for its bias, and the frame's mean rate for its scale.
NOINLINE static void stage_regressors(struct fuse *fuse) {
    struct vector turn;
    struct quat attitude;
    struct matrix level_from_body;
    const uint32_t square = vector_square_q32(&fuse->rate_rad_s_q25);
    fuse->rate_square += ((int32_t)square - fuse->rate_square) / LEVEL_SETTLE;
    take_mean(fuse, &fuse->turn_sum_q17, TURN_MEAN_LIMIT_Q17, &turn);
    quat_rotate(&fuse->level_from_inertial, &turn, &turn);
    quat_multiply(&fuse->level_from_inertial, &fuse->inertial_from_body, &attitude);
    matrix_from_quat(&attitude, &level_from_body);
    const int32_t turns[2] = {turn.x, turn.y};
    struct lowpass_axis *regressor = fuse->regressor;
    for (uint8_t row = 0; row < 2; ++row) {
        for (uint8_t axis = 0; axis < 3; ++axis) {
            lowpass_axis_step(regressor, &level_gain,
                              level_from_body.row[row][axis] * -INT32_C(32768),
                              fuse->frames);
            ++regressor;
        }
        lowpass_axis_step(regressor, &level_gain, turns[row], fuse->frames);
        ++regressor;
    }
    for (uint8_t state = 0; state < FUSE_MOTION_STATES; ++state) {
        int32_t *variance = &fuse->motion_covariance[kalman_variance(state)];
        const int32_t limit = state < 3 ? BIAS_VARIANCE_MAX : SCALE_VARIANCE_MAX;
        *variance = fixed_clamp(*variance + MOTION_WANDER, limit);
    }
}

static void to_level(const struct fuse *fuse, int32_t v[3]) {
    const int32_t body[3] = {v[0], v[1], v[2]};
    matrix_turn(&fuse->level_from_body, body, v);
}

// Stage: the reading in the level frame.
NOINLINE static void stage_reading(struct fuse *fuse) {
    struct quat attitude;
    if (!fuse->has_reading) {
        return;
    }
    quat_multiply(&fuse->level_from_inertial, &fuse->reading_attitude, &attitude);
    quat_renormalise(&attitude);
    matrix_from_quat(&attitude, &fuse->level_from_body);
    to_level(fuse, fuse->reading_ut);
    to_level(fuse, fuse->reading_rad_s);
}

// A reading of bias and scale that surprises by `surprise_rad_s`.
static void read_motion(struct fuse *fuse, const q2_14_t row[], int32_t noise,
                        q7_25_t surprise_rad_s) {
    q2_30_t gain[KALMAN_STATES];
    kalman_read(fuse->motion_covariance, FUSE_MOTION_STATES, row, noise, gain);
    int32_t *bias = fuse->bias_rad_s_q25.axis;
    for (uint8_t i = 0; i < 3; ++i) {
        bias[i] = fixed_clamp(bias[i] + fixed_mul_q30(gain[i], surprise_rad_s),
                              BIAS_LIMIT_Q25);
    }
    const int32_t scale_step =
        fixed_mul_q30(fixed_mul_q30(gain[3], surprise_rad_s), SCALE_GAIN_Q30) * 2;
    fuse->scale = fixed_clamp(fuse->scale + scale_step, SCALE_LIMIT_Q30);
}

// Stage: at rest the mean rate is the bias, one axis a frame.
NOINLINE static void stage_rest(struct fuse *fuse) {
    q2_14_t row[KALMAN_STATES] = {0};
    const uint8_t axis = fuse->rest_axis;
    row[axis] = Q2_14_ONE;
    read_motion(fuse, row, REST_NOISE,
                fuse->rest_rate.axis[axis].level - fuse->bias_rad_s_q25.axis[axis]);
    fuse->rest_axis = (uint8_t)(axis == 2 ? 0 : axis + 1);
}

// Stage: in motion, what levelling had to correct about an axis tells of bias and
// scale.
NOINLINE static void stage_motion(struct fuse *fuse, uint8_t axis) {
    const struct lowpass_axis *regressor = &fuse->regressor[axis * FUSE_MOTION_STATES];
    if (fuse->frames <= LEVEL_SETTLE || fuse->unsettled > 0) {
        return;
    }
    q2_14_t row[KALMAN_STATES] = {0};
    for (uint8_t i = 0; i < 3; ++i) {
        row[i] = (q2_14_t)fixed_scale_down(regressor[i].level, 15);
    }
    row[3] = (q2_14_t)fixed_mul_q30(fixed_clamp(regressor[3].level, TURN_LIMIT_Q25),
                                    TURN_GAIN_Q30);
    read_motion(fuse, row, MOTION_NOISE,
                fixed_clamp(fuse->tilting_rad_s[axis], TILTING_LIMIT_Q25));
}

// An axis of the reading less what was expected of place + level_from_body * own;
// |.| < 8192 uT.
static q14_18_t field_away(const struct fuse *fuse, uint8_t axis) {
    return fuse->reading_ut[axis] - fuse->field_ut[axis] -
           fixed_dot3_q14(fuse->field_ut + 3, fuse->level_from_body.row[axis]);
}

// The same as far as a reading may move anything.
static q14_18_t field_step(const struct fuse *fuse, uint8_t axis) {
    return fixed_clamp(field_away(fuse, axis), FIELD_STEP_MAX_Q18);
}

// The first readings' mean is the field of the place, as uncertain as that of the probe
// itself, and correlated with it.
NOINLINE static void learn_place(struct fuse *fuse) {
    int32_t *pair = fuse->field_covariance;
    ++fuse->field_learnt;
    for (uint8_t row = 0; row < KALMAN_STATES; ++row) {
        if (row < 3) {
            fuse->field_ut[row] += field_away(fuse, row) / fuse->field_learnt;
        }
        for (uint8_t column = 0; column < row; ++column) {
            *pair = row < 3 || column > 2 ? 0
                                          : fuse->level_from_body.row[column][row - 3] *
                                                (-OWN_VARIANCE / Q2_14_ONE);
            ++pair;
        }
        *pair = OWN_VARIANCE;
        if (row < 3) {
            *pair += is_at_rest(fuse) ? PLACE_VARIANCE : PLACE_VARIANCE_MOVING;
        }
        ++pair;
    }
}

// Time passes: the place's field turns with an error of the heading, both fields
// wander, and the probe's the more where readings keep surprising.
NOINLINE static void predict_field(struct fuse *fuse) {
    int32_t *covariance = fuse->field_covariance;
    const int32_t *motion = fuse->motion_covariance;
    const int32_t bias_variance = motion[kalman_variance(0)] +
                                  motion[kalman_variance(1)] +
                                  motion[kalman_variance(2)];
    const int32_t turn_q40 = (!fuse->has_reading ? HEADING_WANDER_ALONE
                              : fuse->is_turned  ? HEADING_WANDER_TURNED
                                                 : HEADING_WANDER) +
                             fixed_mul_q30(bias_variance, HEADING_WANDER_BIAS_Q30) * 2;
    if (!fuse->has_reading) {
        fuse->heading_variance =
            fixed_clamp(fuse->heading_variance + fixed_scale_down(turn_q40, 10),
                        HEADING_VARIANCE_MAX_Q30);
    }
    // Of the horizontal field, at most 60 uT, halved and times the turn as 2^32ths.
    const int32_t x = fixed_clamp(fuse->field_ut[0], PLACE_TURNED_Q18);
    const int32_t y = fixed_clamp(fuse->field_ut[1], PLACE_TURNED_Q18);
    const int32_t half_x = fixed_half_floor(x);
    const int32_t half_y = fixed_half_floor(y);
    const int32_t turned_x = fixed_mul_q30(x * 16, turn_q40);
    const int32_t turned_y = fixed_mul_q30(y * 16, turn_q40);
    if (covariance[0] + covariance[2] < PLACE_SPREAD_MAX) {
        covariance[0] += fixed_mul_q30(half_y, turned_y);
        covariance[1] -= fixed_mul_q30(half_x, turned_y);
        covariance[2] += fixed_mul_q30(half_x, turned_x);
    }
    const bool is_astray = fuse->field_astray > FIELD_ASTRAY && !is_at_rest(fuse);
    for (uint8_t state = 0; state < KALMAN_STATES; ++state) {
        int32_t *variance = &covariance[kalman_variance(state)];
        *variance += state < 3   ? PLACE_WANDER
                     : is_astray ? OWN_WANDER_ASTRAY
                                 : OWN_WANDER;
        *variance = fixed_clamp(*variance, FIELD_VARIANCE_MAX);
    }
}

// The place's field moves by place x rate in a body that turns: what of that the
// reading surprises by is an error of its lag.
NOINLINE static void follow_lag(struct fuse *fuse) {
    const q7_25_t *rate = fuse->reading_rad_s;
    struct vector place;
    int32_t norm;
    vector_clamp(&(struct vector){.x = fuse->field_ut[0],
                                  .y = fuse->field_ut[1],
                                  .z = fuse->field_ut[2]},
                 LAG_FIELD_Q18, &place);
    // uT/s as q18_13, at most 346 * 62.4.
    struct vector slope = {
        .x = fixed_mul_q30(place.y, rate[2]) - fixed_mul_q30(place.z, rate[1]),
        .y = fixed_mul_q30(place.z, rate[0]) - fixed_mul_q30(place.x, rate[2]),
        .z = fixed_mul_q30(place.x, rate[1]) - fixed_mul_q30(place.y, rate[0])};
    if (!vector_normalise(&slope, &slope, &norm)) {
        return;
    }
    // 2^14 / 1000 / 2^13 of it, which is in uT/ms; at most 2.
    q2_14_t row[KALMAN_STATES] = {(q2_14_t)(fixed_clamp(norm, LAG_SLOPE_MAX) / 500)};
    q2_30_t gain[KALMAN_STATES];
    kalman_read(&fuse->lag_variance, 1, row, fuse->field_noise, gain);
    q14_18_t along = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        along += fixed_mul_q30(slope.axis[axis], field_step(fuse, axis));
    }
    const int32_t lag = fuse->lag_s_q35 - fixed_mul_q30(gain[0], along) * LAG_MS_Q17;
    fuse->lag_s_q35 = fixed_clamp(lag > 0 ? lag : 0, LAG_MAX_Q35);
}

// How far the reading is from what was expected, and its noise by that: the further,
// the less it weighs.
NOINLINE static void weigh_field(struct fuse *fuse) {
    uint32_t square = 0;  // 4096ths of 1 uT2, at most 90 uT an axis
    int32_t longer = 0;   // the horizontal field's square, 64ths of 1 uT2
    int32_t off = 0;
    uint32_t horizontal = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        off = fixed_clamp(field_away(fuse, axis), FIELD_FAR_Q18);
        square += (uint32_t)fixed_mul_q30(off * 8, off * 8);
        if (axis < 2) {
            const int32_t place = fixed_clamp(fuse->field_ut[axis], PLACE_TURNED_Q18);
            longer += fixed_mul_q30(off, off + 2 * place);
            horizontal += fixed_magnitude(place);
        }
    }
    // As long as it was, and as steep: it is the heading that is wrong.
    fuse->is_turned =
        square > FIELD_UNIT_FINE * 8 &&
        fixed_magnitude(off) < (uint32_t)FIELD_TURNED_Q18 &&
        fixed_magnitude(longer) <
            (uint32_t)fixed_mul_q30((int32_t)horizontal, FIELD_TURNED_GAIN_Q30);
    const uint16_t coarse =
        square < UINT16_MAX * UINT32_C(64) ? (uint16_t)(square / 64) : UINT16_MAX;
    fuse->field_surprise =
        (uint16_t)(fuse->field_surprise - fuse->field_surprise / 4 + coarse / 4);
    // sqrt(1 + square / unit), times 768
    int32_t noise =
        FIELD_NOISE / 768 * (int32_t)fixed_sqrt((FIELD_UNIT_FINE + square) * 16);
    if (is_at_rest(fuse)) {
        // Still readings tell the same again and again.
        noise = fixed_clamp(noise, FIELD_NOISE_MAX / 4) * 4;
    } else {
        // A mean over 1.6 s.
        fuse->field_astray =
            (uint16_t)(fuse->field_astray - fuse->field_astray / 16 +
                       (square > FIELD_UNIT_FINE && !fuse->is_turned ? UINT16_MAX / 16
                                                                     : 0));
    }
    fuse->field_noise = fixed_clamp(noise, FIELD_NOISE_MAX);
}

static bool is_heading_free(const struct fuse *fuse) {
    return fuse->heading_variance > HEADING_FREE_Q30;
}

// Stage: before the reading is taken up.
NOINLINE static void stage_field(struct fuse *fuse) {
    if (!fuse->has_reading) {
        if (fuse->field_age < UINT8_MAX) {
            ++fuse->field_age;
        }
        predict_field(fuse);
        return;
    }
    if (fuse->field_age == UINT8_MAX && is_heading_free(fuse)) {
        fuse->field_learnt = 0;  // after so long it is a first reading again
    }
    if (fuse->frames == LEVEL_SETTLE && !is_at_rest(fuse)) {
        fuse->field_learnt = 0;  // what was read in motion had no good level
    }
    fuse->field_age = 0;
    if (fuse->field_learnt < FIELD_LEARN) {
        learn_place(fuse);
        fuse->has_reading = false;
        return;
    }
    predict_field(fuse);
    weigh_field(fuse);
}

// Stage: one axis of the reading.
NOINLINE static void stage_field_axis(struct fuse *fuse, uint8_t axis) {
    if (!fuse->has_reading) {
        return;
    }
    q2_30_t gain[KALMAN_STATES];
    q2_14_t row[KALMAN_STATES] = {0};
    row[axis] = Q2_14_ONE;
    memcpy(row + 3, fuse->level_from_body.row[axis], 3 * sizeof *row);
    const q14_18_t away = field_step(fuse, axis);
    kalman_read(fuse->field_covariance, KALMAN_STATES, row, fuse->field_noise, gain);
    for (uint8_t state = 0; state < KALMAN_STATES; ++state) {
        fuse->field_ut[state] =
            fixed_clamp(fuse->field_ut[state] + fixed_mul_q30(gain[state], away),
                        state < 3 ? PLACE_LIMIT_Q18 : OWN_LIMIT_Q18);
    }
}

// The variance of the heading by the field's, north in the level frame being (x, y) and
// the horizontal field `norm` long.
static q2_30_t heading_variance_of(const struct fuse *fuse, const struct vector *north,
                                   q14_18_t norm) {
    const int32_t *covariance = fuse->field_covariance;
    const int32_t across_y =
        fixed_mul_q30(covariance[0], north->y) - fixed_mul_q30(covariance[1], north->x);
    const int32_t across_x =
        fixed_mul_q30(covariance[2], north->x) - fixed_mul_q30(covariance[1], north->y);
    const int32_t across =
        fixed_mul_q30(across_y, north->y) + fixed_mul_q30(across_x, north->x);
    // The vertical field seen through an error of the level, at most 19 uT, as 2^26ths.
    const int32_t leaning = fixed_mul_q30(fuse->field_ut[2], LEVEL_ERROR_Q30) * 256;
    const int32_t total_q19 = fixed_mul_q30(across, COVARIANCE_SHARE_Q30) +
                              fixed_scale_down(fixed_mul_q30(leaning, leaning), 3);
    const uint32_t total_q18 = (uint32_t)(total_q19 > 0 ? total_q19 : 0) / 2;
    if (total_q18 >= (uint32_t)norm) {
        return HEADING_VARIANCE_MAX_Q30;
    }
    const int32_t once = fixed_ratio(total_q18, (uint32_t)norm);
    return fixed_ratio((uint32_t)fixed_scale_down(once, 12), (uint32_t)norm);
}

// Stage: level and heading as one rotation, which poses are made with for a frame.
NOINLINE static void stage_world(struct fuse *fuse) {
    struct vector north = {.x = fuse->field_ut[0], .y = fuse->field_ut[1], .z = 0};
    struct quat turn = QUAT_IDENTITY;
    int32_t norm;
    if (fuse->field_learnt > 0 && vector_normalise(&north, &north, &norm)) {
        // The angle that brings the horizontal field to north, y.
        quat_about_z(north.y, north.x, &turn);
        if (norm < HORIZONTAL_MIN_Q18) {
            // It points along the vertical: the next reading is a first one.
            fuse->field_learnt = 0;
            fuse->heading_variance = HEADING_VARIANCE_MAX_Q30;
        } else if (fuse->field_age == 0) {
            fuse->heading_variance = heading_variance_of(fuse, &north, norm);
        }
    }
    fuse->has_reading = false;
    quat_multiply(&turn, &fuse->level_from_inertial, &fuse->world_from_inertial);
    quat_renormalise(&fuse->world_from_inertial);
}

static void run_stage(struct fuse *fuse) {
    const bool at_rest = is_at_rest(fuse);
    switch (fuse->stage) {
    case 0:
        stage_level(fuse);
        break;
    case 1:
        stage_regressors(fuse);
        break;
    case 2:
        stage_reading(fuse);
        break;
    case 3:
        if (at_rest) {
            stage_rest(fuse);
        } else {
            stage_motion(fuse, 0);
        }
        break;
    case 4:
        if (!at_rest) {
            stage_motion(fuse, 1);
        }
        break;
    case 5:
        stage_field(fuse);
        if (fuse->has_reading && !at_rest) {
            follow_lag(fuse);
        }
        break;
    case 9:
        stage_world(fuse);
        break;
    default:
        stage_field_axis(fuse, (uint8_t)(fuse->stage - 6));
        break;
    }
    ++fuse->stage;
}

// The first sample is levelled at once.
static void level_first(struct fuse *fuse, const struct vector *force_body) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fuse->force.axis[axis].level = force_body->axis[axis];
    }
    follow_gravity(fuse);
    fuse->world_from_inertial = fuse->level_from_inertial;
}

void fuse_step(struct fuse *fuse, const struct measurement *measurement,
               uint32_t interval_us) {
    const struct fuse_coefficients *coefficients = &fuse->coefficients;
    const struct vector *rate = &fuse->rate_rad_s_q25;
    struct matrix inertial_from_body;
    const bool is_first = fuse->frames == 0 && fuse->in_frame == 0;
    vector_subtract(&measurement->gyr_rad_s_q25, &fuse->bias_rad_s_q25,
                    &fuse->rate_rad_s_q25);
    if (is_first) {
        level_first(fuse, &measurement->acc_m_s2_q21);
    } else {
        integrate(fuse, interval_us);
    }
    if (measurement->gyr_clipped && fuse->clipped < UINT8_MAX) {
        ++fuse->clipped;
    }
    if (interval_us > (uint32_t)STEP_MAX_US * STEPS_MAX && !is_first) {
        fuse->clipped = CLIPPED_LOST;
    }
    if (measurement->acc_clipped || fuse->clipped > 0) {
        fuse->unsettled = UNSETTLED;
    }
    matrix_from_quat(&fuse->inertial_from_body, &inertial_from_body);
    add_turned(&inertial_from_body, &measurement->acc_m_s2_q21, &fuse->force_sum_q13);
    add_turned(&inertial_from_body, rate, &fuse->turn_sum_q17);
    const struct vector *field = &measurement->mag_ut_q18;
    if (measurement->has_mag && !fuse->has_reading &&
        (fuse->stage == 1 || fuse->stage == 2) &&
        (field->x | field->y | field->z) != 0) {  // all zeros: no field at all
        take_reading(fuse, field);
    }
    // Of two samples in a row, one runs a stage and one looks for rest.
    ++fuse->in_frame;
    if (fuse->in_frame == coefficients->frame) {
        fuse->in_frame = 0;
        fuse->stage = 0;
        quat_renormalise(&fuse->inertial_from_body);
    }
    const uint8_t in_stride = (uint8_t)(fuse->in_frame % coefficients->stride);
    if (in_stride == 0 && fuse->stage < STAGES) {
        run_stage(fuse);
    }
    if (in_stride == coefficients->stride - 1) {
        look_for_rest(fuse, measurement);
    }
}

void fuse_orientation(const struct fuse *fuse, struct quat *out) {
    struct vector angle;
    quat_multiply(&fuse->world_from_inertial, &fuse->inertial_from_body, out);
    // The gyroscope's low-pass still holds back the last few milliseconds: they are
    // made up with the last rate.
    vector_scale(&fuse->rate_rad_s_q25, fuse->coefficients.lead_s_q35, &angle);
    turn_small(out, &angle);
    quat_renormalise(out);
}

void fuse_quality(const struct fuse *fuse, struct attitude_quality *out) {
    out->is_starting = fuse->frames < LEVEL_SETTLE ||
                       (fuse->field_learnt > 0 && fuse->field_learnt < FIELD_LEARN);
    out->is_at_rest = is_at_rest(fuse);
    out->is_mag_absent = fuse->field_age >= FIELD_ABSENT;
    out->is_mag_disturbed = !out->is_mag_absent && fuse->field_surprise > FIELD_UNIT;
    out->is_heading_free = is_heading_free(fuse);
    // 0.28^2 + (0.20 W / 100 deg/s)^2 deg2, W the rms rate over 3 s, as 1e-4 deg2:
    // 784 + 131.3 (rad/s)^2. Fitted to recordings with optical truth.
    const uint32_t tilt = 784 + fixed_umul_q32((uint32_t)fuse->rate_square, 2151420);
    out->tilt_sigma_cdeg = out->is_starting ? UINT16_MAX : fixed_sqrt(tilt);
    // 0.6 deg, and the variance: rad2 q2_30 to 1e-4 deg2 is 0.030573.
    const uint32_t heading =
        3600 + fixed_umul_q32((uint32_t)fuse->heading_variance, 131310000);
    out->heading_sigma_cdeg =
        out->is_starting || out->is_heading_free ? UINT16_MAX : fixed_sqrt(heading);
}
