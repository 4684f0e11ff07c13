// SPDX-License-Identifier: MIT
// Sample to measurement; see calibrate.h for units and bounds.
#include "core/fusion/calibrate.h"

#include <string.h>

#include "core/math/constant.h"
#include "core/math/matrix.h"

enum {
    ONE = 16384,      // 1 as q2_14
    ROW_MAX = 27852,  // 1.7 as q2_14
};

static const struct vector *bias_of(const struct calibration_of_sensor *sensor) {
    _Static_assert(sizeof(struct vector) == sizeof sensor->bias, "x, y, z");
    return (const struct vector *)sensor->bias;
}

static void sensor_clear(struct calibration_of_sensor *sensor) {
    memset(sensor, 0, sizeof *sensor);
    sensor->sigma = UINT16_MAX;
    for (uint8_t row = 0; row < 3; ++row) {
        sensor->matrix[row][row] = ONE;
    }
}

void calibration_clear(struct calibration *calibration) {
    for (uint8_t i = 0; i < 3; ++i) {
        sensor_clear(&calibration->sensors[i]);
    }
    calibration->field_north = CALIBRATION_NO_FIELD;
    calibration->temperature = SAMPLE_NO_TEMPERATURE;
    calibration->drift = CALIBRATION_DRIFT;
}

bool calibration_of_sensor_is_valid(const struct calibration_of_sensor *sensor) {
    for (uint8_t row = 0; row < 3; ++row) {
        uint32_t sum = 0;
        for (uint8_t column = 0; column < 3; ++column) {
            sum += fixed_magnitude(sensor->matrix[row][column]);
        }
        if (sum > ROW_MAX) {
            return false;
        }
    }
    return !vector_exceeds(bias_of(sensor), INT32_C(16384) * 16384);
}

bool calibration_is_valid(const struct calibration *calibration) {
    return calibration_of_sensor_is_valid(&calibration->acc) &&
           calibration_of_sensor_is_valid(&calibration->gyr) &&
           calibration_of_sensor_is_valid(&calibration->mag);
}

// Half of nano * 1e-9 * 2^bits, as q2_30: nano * 2^30 / 1e9 * 2^(bits - 1), with
// 2^30 / 1e9 = 1 + 316718722 / 2^32. Below 2 for every sensor in the house.
static q2_30_t scale_from_nano(uint32_t nano, uint8_t bits) {
    const uint32_t steps = nano + fixed_umul_q32(nano, UINT32_C(316718722));
    return fixed_scale_up((int32_t)steps, (uint8_t)(bits - 1));
}

void calibration_scale_of(const struct sensor_identity *identity,
                          struct calibration_scale *out) {
    // From q18_14 counts to q7_25, q11_21 and q14_18.
    out->gyr = scale_from_nano(identity->gyr_lsb_nrad_s, 11);
    out->acc = scale_from_nano(identity->acc_lsb_nm_s2, 7);
    out->mag = scale_from_nano(identity->mag_lsb_pt * 1000, 4);
}

// Counts, q18_14, become matrix * (counts - bias), then twice the scale.
// |counts - bias| <= 2^29 + 2^28, a row of at most 1.7 and a scale of at most 1.26 keep
// each step below 2^31; limit_high * 2^16 bounds the result before it is doubled.
static void apply(const struct calibration_of_sensor *sensor, const q2_30_t *scale,
                  int16_t limit_high, struct vector *v) {
    const struct matrix *matrix = (const struct matrix *)sensor->matrix;
    _Static_assert(sizeof *matrix == sizeof sensor->matrix, "rows");
    vector_subtract(v, bias_of(sensor), v);
    matrix_turn(matrix, v->axis, v->axis);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        v->axis[axis] =
            fixed_clamp_high(fixed_mul_at(&v->axis[axis], scale), limit_high) * 2;
    }
}

static void apply_to_counts(const struct calibration_of_sensor *sensor,
                            const struct counts *counts, const q2_30_t *scale,
                            int16_t limit_high, struct vector *out) {
    for (uint8_t axis = 0; axis < 3; ++axis) {
        // To q18_14 by fewer shifts than from counts.
        out->axis[axis] =
            fixed_half_floor(fixed_half_floor(counts->axis[axis] * INT32_C(65536)));
    }
    apply(sensor, scale, limit_high, out);
}

#define GYR_LIMIT_HALF FIXED_HIGH(Q25(19))    // rad/s
#define ACC_LIMIT_HALF FIXED_HIGH(Q21(135))   // m/s2
#define MAG_LIMIT_HALF FIXED_HIGH(Q18(1024))  // uT

// 128 K: chips work from -40 to 85 degC. What is not known is further away.
#define WARMTH_MAX 99

// How far the temperature of the sample is from that of the calibration, 1.28 K; 0: one
// of them is not known.
static uint8_t warmth_of(int16_t now, int16_t then) {
    const uint16_t apart = now > then ? (uint16_t)((uint16_t)now - (uint16_t)then)
                                      : (uint16_t)((uint16_t)then - (uint16_t)now);
    const uint16_t warmth = apart / 128;
    return (uint8_t)(warmth > WARMTH_MAX ? 0 : warmth);
}

void calibrate(const struct calibration *calibration,
               const struct calibration_scale *scale, const struct sample *sample,
               struct measurement *out) {
    apply_to_counts(&calibration->gyr, &sample->gyr, &scale->gyr, GYR_LIMIT_HALF,
                    &out->gyr_rad_s_q25);
    apply_to_counts(&calibration->acc, &sample->acc, &scale->acc, ACC_LIMIT_HALF,
                    &out->acc_m_s2_q21);
    out->has_mag = sample->has_mag;
    out->acc_clipped = sample->acc_clipped;
    out->gyr_clipped = sample->gyr_clipped;
    out->warmth = warmth_of(sample->temperature_cdeg, calibration->temperature);
    if (sample->has_mag) {
        apply_to_counts(&calibration->mag, &sample->mag, &scale->mag, MAG_LIMIT_HALF,
                        &out->mag_ut_q18);
    }
}

void calibrate_rate(const struct calibration *calibration,
                    const struct calibration_scale *scale, struct vector *rate) {
    apply(&calibration->gyr, &scale->gyr, GYR_LIMIT_HALF, rate);
}

void gyro_calibrator_begin(struct gyro_calibrator *calibrator) {
    *calibrator = (struct gyro_calibrator){.count = 0};
}

// One copy: three would take 60 bytes more of the AVR's flash.
#define NOINLINE __attribute__((noinline))

// In units of 2^10 nano (of rad/s or m/s2) or pico (of T) a check is a product of 16
// bits each.
#define UNITS(degrees) ((uint32_t)Q_RAD((degrees) * (1e9 / 1048576), 10))
#define SPAN_MAX UNITS(3)                   // deg/s
#define BIAS_MAX UNITS(40)                  // deg/s
#define TURN_MAX UNITS(0.5 * GRAVITY_M_S2)  // half a degree of 1 g
// A 256th of what 128 readings of the MPU-9250 differ by in all. It is reached at 0.3
// uT a reading; with the LSM9DS0, which gives 67, at 0.5.
#define FIELD_MAX ROUNDED(0.13e6 / 1024)

enum { EARLY_SAMPLES = 8 };  // among them is a reading of the magnetometer

NOINLINE static bool exceeds(uint16_t counts, const uint32_t *lsb_nano,
                             uint32_t limit) {
    return (uint32_t)counts * (uint16_t)(*lsb_nano / 1024) > limit;
}

// Readings of the magnetometer are added less an early one, so that halves that do not
// have the same number of them differ by their noise only.
NOINLINE static void add_field(struct gyro_calibrator_axis *axis, uint16_t count,
                               int16_t mag) {
    if (count < EARLY_SAMPLES) {
        axis->early_mag = mag;
        axis->field = 0;
    }
    axis->field = (int16_t)(axis->field + mag - axis->early_mag);
}

// Adds the `count`th sample of one axis, from 0 on; true if that axis is not at rest.
// Not inline: the AVR then has the axis at hand in a register.
NOINLINE static bool add_sample(struct gyro_calibrator_axis *axis, uint16_t count,
                                int16_t rate, int16_t force,
                                const struct sensor_identity *identity) {
    if (count == 0) {
        axis->sum = 0;
        axis->turn = 0;
        axis->field = 0;
        axis->low = rate;
        axis->high = rate;
    }
    fixed_add(rate, &axis->sum);
    if (count == CALIBRATOR_SAMPLES / 2) {
        axis->turn = -axis->turn;  // from here on the second half
        axis->field = (int16_t)-axis->field;
    }
    fixed_add(force, &axis->turn);
    if (rate < axis->low) {
        axis->low = rate;
    }
    if (rate > axis->high) {
        axis->high = rate;
    }
    // At most 65535: 256 times -32768, less 256 times 32767; at most half of that.
    const uint16_t turn = (uint16_t)(fixed_magnitude(axis->turn) / 256);
    const uint16_t field = (uint16_t)(fixed_magnitude(axis->field) / 256);
    return exceeds((uint16_t)(axis->high - axis->low), &identity->gyr_lsb_nrad_s,
                   SPAN_MAX) ||
           exceeds((uint16_t)fixed_magnitude(rate), &identity->gyr_lsb_nrad_s,
                   BIAS_MAX) ||
           (count == CALIBRATOR_SAMPLES - 1 &&
            (exceeds(turn, &identity->acc_lsb_nm_s2, TURN_MAX) ||
             exceeds(field, &identity->mag_lsb_pt, FIELD_MAX)));
}

enum calibrator_result gyro_calibrator_step(struct gyro_calibrator *calibrator,
                                            const struct sample *sample,
                                            const struct sensor_identity *identity,
                                            struct vector *mean_counts) {
    const uint16_t count = calibrator->count;
    bool has_moved = sample->gyr_clipped || sample->has_gap;
    uint16_t span = 0;  // of the widest axis
    for (uint8_t i = 0; i < 3; ++i) {
        struct gyro_calibrator_axis *axis = &calibrator->axes[i];
        if (sample->has_mag) {
            add_field(axis, count, sample->mag.axis[i]);
        }
        has_moved |=
            add_sample(axis, count, sample->gyr.axis[i], sample->acc.axis[i], identity);
        const uint16_t axis_span = (uint16_t)(axis->high - axis->low);
        if (axis_span > span) {
            span = axis_span;
        }
        // sum * 2^14 / 512: |sum| / 512 is below the limit of a bias
        mean_counts->axis[i] = fixed_scale_up(axis->sum, 5);
    }
    calibrator->count = (uint16_t)(count + 1);
    if (has_moved) {
        calibrator->count = 0;
        calibrator->span_counts = span;
        return CALIBRATOR_MOVED;
    }
    return count == CALIBRATOR_SAMPLES - 1 ? CALIBRATOR_DONE : CALIBRATOR_PENDING;
}
