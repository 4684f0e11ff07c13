// SPDX-License-Identifier: MIT
// Counts to physical units in the body frame, and the gyroscope's bias at start-up.
#ifndef CALIBRATE_H
#define CALIBRATE_H

#include "core/drivers/sample.h"
#include "core/drivers/sensor.h"
#include "core/math/vector.h"

// v = matrix * (counts - bias), then the sensor's scale. The sum of magnitudes of each
// row must not exceed 1.7, |bias| not 16384 counts: then no step overflows.
struct calibration_of_sensor {
    q18_14_t bias[3];      // counts
    q2_14_t matrix[3][3];  // rows
    // One-sigma error that remains, in the units of the params' records: 1e-4 m/s2 of
    // an axis, 1e-5 of the scale, 0.01 uT of an axis. UINT16_MAX: not known.
    uint16_t sigma;
};

enum {
    CALIBRATION_NO_FIELD = INT16_MIN,
    // Where it is not known: 0.75 mg/K; PS-MPU-9250A-01, table 2, has 1.5 as a limit.
    CALIBRATION_DRIFT = 94,
};

struct calibration {
    // The field that the magnetometer was calibrated in, to the north and up, 0.25 uT,
    // CALIBRATION_NO_FIELD: not known.
    int16_t field_north;
    int16_t field_up;
    // Of the accelerometer's calibration, as its record has them: 0.01 degC or
    // SAMPLE_NO_TEMPERATURE; and what each kelvin from there adds to its sigma,
    // 1e-4 m/s2 for 1.28 K.
    int16_t temperature;
    uint8_t drift;
    union {
        struct {
            struct calibration_of_sensor acc, gyr, mag;
        };
        struct calibration_of_sensor sensors[3];  // the same, to be counted
    };
};

// Counts as they are: no bias, matrices of one, errors not known. A function, since a
// constant would take 90 bytes of the AVR's RAM.
void calibration_clear(struct calibration *calibration);

// True where the bounds above hold.
bool calibration_of_sensor_is_valid(const struct calibration_of_sensor *sensor);
bool calibration_is_valid(const struct calibration *calibration);

// One sample in physical units, body frame.
struct measurement {
    struct vector gyr_rad_s_q25;  // q7_25, each held within +-38 rad/s
    struct vector acc_m_s2_q21;   // q11_21, |acc| < 470 m/s2
    struct vector mag_ut_q18;     // q14_18, each held within +-2048 uT; where has_mag
    bool has_mag;
    bool acc_clipped, gyr_clipped;  // at the end of its range
    uint8_t warmth;  // 1.28 K from the temperature of the accelerometer's calibration
};

// Scales of one count, derived from the sensor's identity.
struct calibration_scale {
    q2_30_t gyr, acc, mag;
};

void calibration_scale_of(const struct sensor_identity *identity,
                          struct calibration_scale *out);

void calibrate(const struct calibration *calibration,
               const struct calibration_scale *scale, const struct sample *sample,
               struct measurement *out);

// Makes mean counts of the gyroscope, q18_14, the rate that they stand for, q7_25
// rad/s.
void calibrate_rate(const struct calibration *calibration,
                    const struct calibration_scale *scale, struct vector *rate);

// The start-up calibration: 512 samples at rest give the gyroscope's bias.
enum calibrator_result {
    CALIBRATOR_DONE = 0,
    CALIBRATOR_PENDING = 1,
    CALIBRATOR_MOVED = -1,  // refused: the window starts over
};

enum { CALIBRATOR_SAMPLES = 512 };

struct gyro_calibrator_axis {
    int32_t sum;        // of the rates, counts
    int32_t turn;       // specific force, one half less the other, counts
    int16_t low, high;  // rates, counts
    int16_t early_mag;  // a reading, counts
    int16_t field;      // of readings less that one, as above
};

struct gyro_calibrator {
    struct gyro_calibrator_axis axes[3];
    uint16_t count;
    uint16_t span_counts;  // of the widest axis when it was last refused
};

void gyro_calibrator_begin(struct gyro_calibrator *calibrator);

// Takes a sample. With DONE the mean counts are those of all samples, q18_14; MOVED
// says that the probe is not at rest: a rate spans more than 3 deg/s peak to peak (5
// times what the MPU-9250's noise gives in a window), or exceeds 40 deg/s (the LSM9DS0
// has a zero rate of +-25 as it comes, data sheet table 3, "TyOff"), or between the
// halves of the window the vertical turns by more than half a degree, or the mean of an
// axis of the magnetic field changes by 0.3 uT: that is a slow turn about the vertical.
enum calibrator_result gyro_calibrator_step(struct gyro_calibrator *calibrator,
                                            const struct sample *sample,
                                            const struct sensor_identity *identity,
                                            struct vector *mean_counts);

#endif
