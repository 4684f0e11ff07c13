// SPDX-License-Identifier: MIT
// Sample to measurement; see calibrate.h for units and bounds.
#include "calibrate.h"

enum {
    ONE = 16384,      // 1 as q2_14
    ROW_MAX = 27852,  // 1.7 as q2_14
};

static void sensor_clear(struct calibration_of_sensor *sensor) {
    for (uint8_t row = 0; row < 3; ++row) {
        sensor->bias[row] = 0;
        for (uint8_t column = 0; column < 3; ++column) {
            sensor->matrix[row][column] = row == column ? ONE : 0;
        }
    }
}

void calibration_clear(struct calibration *calibration) {
    sensor_clear(&calibration->acc);
    sensor_clear(&calibration->gyr);
    sensor_clear(&calibration->mag);
}

static bool sensor_is_valid(const struct calibration_of_sensor *sensor) {
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
    return sensor_is_valid(&calibration->acc) && sensor_is_valid(&calibration->gyr) &&
           sensor_is_valid(&calibration->mag);
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
static void apply(const struct calibration_of_sensor *sensor, const q18_14_t counts[3],
                  q2_30_t scale, int32_t limit, struct vector *out) {
    int32_t centred[3];
    for (uint8_t axis = 0; axis < 3; ++axis) {
        centred[axis] = counts[axis] - sensor->bias[axis];
    }
    int32_t *const result[3] = {&out->x, &out->y, &out->z};
    for (uint8_t row = 0; row < 3; ++row) {
        const int32_t sum = fixed_dot3_q14(centred, sensor->matrix[row]);
        *result[row] = fixed_clamp(fixed_mul_q30(sum, scale), limit) * 2;
    }
}

static void apply_to_counts(const struct calibration_of_sensor *sensor,
                            const struct counts *counts, q2_30_t scale, int32_t limit,
                            struct vector *out) {
    const q18_14_t fine[3] = {counts->x * INT32_C(16384), counts->y * INT32_C(16384),
                              counts->z * INT32_C(16384)};
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
    if (sample->has_mag) {
        apply_to_counts(&calibration->mag, &sample->mag, scale->mag, MAG_LIMIT_HALF,
                        &out->mag_ut_q18);
    }
}

void calibrate_rate(const struct calibration *calibration,
                    const struct calibration_scale *scale,
                    const q18_14_t mean_counts[3], struct vector *out) {
    apply(&calibration->gyr, mean_counts, scale->gyr, GYR_LIMIT_HALF, out);
}

void gyro_calibrator_begin(struct gyro_calibrator *calibrator) {
    *calibrator = (struct gyro_calibrator){.count = 0};
}

// Counts in a limit given in units of 1e-6: limits and counts of the physical unit.
static int16_t counts_in(uint32_t limit_micro, uint32_t lsb_nano) {
    return (int16_t)(limit_micro / (lsb_nano / 1000 + 1));
}

enum calibrator_result gyro_calibrator_step(struct gyro_calibrator *calibrator,
                                            const struct sample *sample,
                                            const struct sensor_identity *identity,
                                            q18_14_t mean_counts[3]) {
    const int16_t gyr[3] = {sample->gyr.x, sample->gyr.y, sample->gyr.z};
    const int16_t acc[3] = {sample->acc.x, sample->acc.y, sample->acc.z};
    // 3 deg/s and 20 deg/s, 0.5 deg of 1 g.
    const int16_t span_max = counts_in(52360, identity->gyr_lsb_nrad_s);
    const int16_t bias_max = counts_in(349066, identity->gyr_lsb_nrad_s);
    const int32_t turn_max =
        (int32_t)counts_in(85577, identity->acc_lsb_nm_s2) * (CALIBRATOR_SAMPLES / 2);
    const bool is_first = calibrator->count == 0;
    const bool is_second_half = calibrator->count >= CALIBRATOR_SAMPLES / 2;
    ++calibrator->count;
    const bool is_last = calibrator->count == CALIBRATOR_SAMPLES;
    bool has_moved = sample->gyr_clipped || sample->has_gap;
    int32_t widest = 0;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        calibrator->sum[axis] += gyr[axis];
        calibrator->acc_sum[axis] += is_second_half ? -acc[axis] : acc[axis];
        if (is_first || gyr[axis] < calibrator->low[axis]) {
            calibrator->low[axis] = gyr[axis];
        }
        if (is_first || gyr[axis] > calibrator->high[axis]) {
            calibrator->high[axis] = gyr[axis];
        }
        const int32_t span = (int32_t)calibrator->high[axis] - calibrator->low[axis];
        const bool is_out = span > span_max || gyr[axis] > bias_max ||
                            gyr[axis] < -bias_max ||
                            (is_last && fixed_magnitude(calibrator->acc_sum[axis]) >
                                            (uint32_t)turn_max);
        if (is_out) {
            has_moved = true;
        }
        if (span > widest) {
            widest = span;
        }
    }
    if (has_moved) {
        gyro_calibrator_begin(calibrator);
        calibrator->span_counts = (uint16_t)widest;
        return CALIBRATOR_MOVED;
    }
    if (!is_last) {
        return CALIBRATOR_PENDING;
    }
    for (uint8_t axis = 0; axis < 3; ++axis) {
        // sum * 2^14 / 512
        mean_counts[axis] = calibrator->sum[axis] * (16384 / CALIBRATOR_SAMPLES);
    }
    return CALIBRATOR_DONE;
}
