// SPDX-License-Identifier: MIT
// Sample to measurement; see calibrate.h for units and bounds.
#include "core/fusion/calibrate.h"

enum {
    ONE = 16384,      // 1 as q2_14
    ROW_MAX = 27852,  // 1.7 as q2_14
};

static void sensor_clear(struct calibration_of_sensor *sensor) {
    sensor->sigma = UINT16_MAX;
    for (uint8_t row = 0; row < 3; ++row) {
        sensor->bias[row] = 0;
        for (uint8_t column = 0; column < 3; ++column) {
            sensor->matrix[row][column] = row == column ? ONE : 0;
        }
    }
}

void calibration_clear(struct calibration *calibration) {
    for (uint8_t i = 0; i < 3; ++i) {
        sensor_clear(&calibration->sensors[i]);
    }
}

bool calibration_of_sensor_is_valid(const struct calibration_of_sensor *sensor) {
    for (uint8_t row = 0; row < 3; ++row) {
        uint32_t sum = 0;
        for (uint8_t column = 0; column < 3; ++column) {
            sum += fixed_magnitude(sensor->matrix[row][column]);
        }
        if (sum > ROW_MAX ||
            fixed_magnitude(sensor->bias[row]) > UINT32_C(16384) * 16384) {
            return false;
        }
    }
    return true;
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

struct calibration_scale calibration_scale_of(const struct sensor_identity *identity) {
    // From q18_14 counts to q7_25, q11_21 and q14_18.
    return (struct calibration_scale){
        scale_from_nano(identity->gyr_lsb_nrad_s, 11),
        scale_from_nano(identity->acc_lsb_nm_s2, 7),
        scale_from_nano(identity->mag_lsb_pt * 1000, 4),
    };
}

// matrix * (counts - bias), then twice the scale. |counts - bias| <= 2^29 + 2^28, a row
// of at most 1.7 and a scale of at most 1.26 keep each step below 2^31; `limit` bounds
// the result before it is doubled.
static void apply(const struct calibration_of_sensor *sensor, const q16_16_t counts[3],
                  q2_30_t scale, int32_t limit, struct vector *out) {
    q18_14_t centred[3];
    for (uint8_t axis = 0; axis < 3; ++axis) {
        centred[axis] =
            fixed_half_floor(fixed_half_floor(counts[axis])) - sensor->bias[axis];
    }
    for (uint8_t row = 0; row < 3; ++row) {
        const int32_t sum = fixed_dot3_q14(centred, sensor->matrix[row]);
        out->axis[row] = fixed_clamp(fixed_mul_q30(sum, scale), limit) * 2;
    }
}

static void apply_to_counts(const struct calibration_of_sensor *sensor,
                            const struct counts *counts, q2_30_t scale, int32_t limit,
                            struct vector *out) {
    q16_16_t fine[3];  // from which the AVR comes to q18_14 sooner than from counts
    for (uint8_t axis = 0; axis < 3; ++axis) {
        fine[axis] = counts->axis[axis] * INT32_C(65536);
    }
    apply(sensor, fine, scale, limit, out);
}

#define GYR_LIMIT_HALF INT32_C(637534208)  // 19 rad/s as q7_25
#define ACC_LIMIT_HALF INT32_C(283115520)  // 135 m/s2 as q11_21
#define MAG_LIMIT_HALF INT32_C(268435456)  // 1024 uT as q14_18

void calibrate(const struct calibration *calibration,
               const struct calibration_scale *scale, const struct sample *sample,
               struct measurement *out) {
    apply_to_counts(&calibration->gyr, &sample->gyr, scale->gyr, GYR_LIMIT_HALF,
                    &out->gyr_rad_s_q25);
    apply_to_counts(&calibration->acc, &sample->acc, scale->acc, ACC_LIMIT_HALF,
                    &out->acc_m_s2_q21);
    out->has_mag = sample->has_mag;
    out->acc_clipped = sample->acc_clipped;
    out->gyr_clipped = sample->gyr_clipped;
    if (sample->has_mag) {
        apply_to_counts(&calibration->mag, &sample->mag, scale->mag, MAG_LIMIT_HALF,
                        &out->mag_ut_q18);
    }
}

void calibrate_rate(const struct calibration *calibration,
                    const struct calibration_scale *scale,
                    const q16_16_t mean_counts[3], struct vector *out) {
    apply(&calibration->gyr, mean_counts, scale->gyr, GYR_LIMIT_HALF, out);
}

void gyro_calibrator_begin(struct gyro_calibrator *calibrator) {
    *calibrator = (struct gyro_calibrator){.count = 0};
}

// In units of 2^10 nano (of rad/s or m/s2) a check is a product of 16 bits each.
#define SPAN_MAX UINT32_C(51133)   // 3 deg/s
#define BIAS_MAX UINT32_C(681770)  // 40 deg/s
#define TURN_MAX UINT32_C(83571)   // 0.5 deg of 1 g

// Not inline: three copies would take 60 bytes more of the AVR's flash.
__attribute__((noinline)) static bool exceeds(uint16_t counts, uint32_t lsb_nano,
                                              uint32_t limit) {
    return (uint32_t)counts * (uint16_t)(lsb_nano / 1024) > limit;
}

// Adds the `count`th sample of one axis, from 0 on. Not inline: the AVR then has the
// axis at hand in a register.
__attribute__((noinline)) static void add_sample(struct gyro_calibrator_axis *axis,
                                                 uint16_t count, int16_t rate,
                                                 int16_t force) {
    if (count == 0) {
        *axis = (struct gyro_calibrator_axis){0, 0, rate, rate};
    }
    fixed_add(rate, &axis->sum);
    if (count == CALIBRATOR_SAMPLES / 2) {
        axis->turn = -axis->turn;  // from here on the second half
    }
    fixed_add(force, &axis->turn);
    if (rate < axis->low) {
        axis->low = rate;
    }
    if (rate > axis->high) {
        axis->high = rate;
    }
}

static bool has_turned(const struct gyro_calibrator *calibrator,
                       const struct sensor_identity *identity) {
    for (uint8_t i = 0; i < 3; ++i) {
        // At most 65535: 256 times -32768, less 256 times 32767.
        const uint16_t turn =
            (uint16_t)(fixed_magnitude(calibrator->axes[i].turn) / 256);
        if (exceeds(turn, identity->acc_lsb_nm_s2, TURN_MAX)) {
            return true;
        }
    }
    return false;
}

enum calibrator_result gyro_calibrator_step(struct gyro_calibrator *calibrator,
                                            const struct sample *sample,
                                            const struct sensor_identity *identity,
                                            q16_16_t mean_counts[3]) {
    const uint16_t count = calibrator->count;
    uint16_t span = 0;      // of the widest axis
    uint16_t furthest = 0;  // from zero
    for (uint8_t i = 0; i < 3; ++i) {
        struct gyro_calibrator_axis *axis = &calibrator->axes[i];
        const int16_t rate = sample->gyr.axis[i];
        add_sample(axis, count, rate, sample->acc.axis[i]);
        const uint16_t axis_span = (uint16_t)(axis->high - axis->low);
        if (axis_span > span) {
            span = axis_span;
        }
        const uint16_t size = (uint16_t)fixed_magnitude(rate);
        if (size > furthest) {
            furthest = size;
        }
    }
    const bool is_last = count == CALIBRATOR_SAMPLES - 1;
    calibrator->count = (uint16_t)(count + 1);
    if (sample->gyr_clipped || sample->has_gap ||
        exceeds(span, identity->gyr_lsb_nrad_s, SPAN_MAX) ||
        exceeds(furthest, identity->gyr_lsb_nrad_s, BIAS_MAX) ||
        (is_last && has_turned(calibrator, identity))) {
        calibrator->count = 0;
        calibrator->span_counts = span;
        return CALIBRATOR_MOVED;
    }
    if (!is_last) {
        return CALIBRATOR_PENDING;
    }
    for (uint8_t i = 0; i < 3; ++i) {
        // sum * 2^16 / 512: |sum| / 512 is below the limit of a bias
        mean_counts[i] = calibrator->axes[i].sum * (65536 / CALIBRATOR_SAMPLES);
    }
    return CALIBRATOR_DONE;
}
