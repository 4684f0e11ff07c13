// SPDX-License-Identifier: MIT
// The records of the params. Generated from schema.toml by
// protocol/generate.py; what each part means is in PROTOCOL.md.
#ifndef RECORDS_H
#define RECORDS_H

#include <stdint.h>

// Tags.
enum params_record {
    PARAMS_ACC = 1,
    PARAMS_GYR = 2,
    PARAMS_MAG = 3,
    PARAMS_TIP = 4,
    PARAMS_OPTIONS = 5,
    PARAMS_NAME = 6,
    PARAMS_NOISE = 8,
};

// Bytes of the parts.
enum {
    PARAMS_ACC_SIZE = 40,
    PARAMS_GYR_SIZE = 39,
    PARAMS_MAG_SIZE = 49,
    PARAMS_TIP_SIZE = 23,
    PARAMS_OPTIONS_SIZE = 2,
    PARAMS_NAME_SIZE = 24,
    PARAMS_NOISE_SIZE = 4,
};

// Numbers that say "not known", in every value of a part.
#define ACC_SIGMA_NULL UINT16_MAX
#define ACC_RESIDUAL_NULL UINT16_MAX
#define ACC_TEMPERATURE_NULL INT16_MIN
#define ACC_DAY_NULL UINT16_MAX
#define ACC_DRIFT_NULL UINT8_C(94)
#define GYR_SIGMA_NULL UINT16_MAX
#define GYR_RESIDUAL_NULL UINT16_MAX
#define GYR_TEMPERATURE_NULL INT16_MIN
#define GYR_DAY_NULL UINT16_MAX
#define MAG_SIGMA_NULL UINT16_MAX
#define MAG_RESIDUAL_NULL UINT16_MAX
#define MAG_TEMPERATURE_NULL INT16_MIN
#define MAG_DAY_NULL UINT16_MAX
#define MAG_NORM_NULL UINT16_MAX
#define MAG_DIP_NULL INT16_MIN
#define MAG_LAG_NULL INT16_MIN
#define MAG_NORTH_NULL INT16_MIN
#define MAG_UP_NULL INT16_MIN
#define TIP_OFFSET_NULL INT32_MIN
#define TIP_AXIS_NULL INT16_MIN
#define TIP_SIGMA_NULL UINT16_MAX
#define TIP_DAY_NULL UINT16_MAX
#define NOISE_ACC_NULL UINT16_MAX
#define NOISE_GYR_NULL UINT16_MAX

struct record_acc {
    int32_t bias[3];      // 2^-14 counts
    int16_t matrix[9];    // 2^-14
    uint16_t sigma;       // 1e-4 m/s2
    uint16_t residual;    // 1e-4 m/s2
    int16_t temperature;  // 0.01 degC
    uint16_t day;         // days
    uint8_t method;       // enum method
    uint8_t drift;        // 78125e-9 m/s2/K
};

struct record_gyr {
    int32_t bias[3];      // 2^-14 counts
    int16_t matrix[9];    // 2^-14
    uint16_t sigma;       // 1e-5
    uint16_t residual;    // 1e-5 rad
    int16_t temperature;  // 0.01 degC
    uint16_t day;         // days
    uint8_t method;       // enum method
};

struct record_mag {
    int32_t bias[3];      // 2^-14 counts
    int16_t matrix[9];    // 2^-14
    uint16_t sigma;       // 0.01 uT
    uint16_t residual;    // 0.01 uT
    int16_t temperature;  // 0.01 degC
    uint16_t day;         // days
    uint8_t method;       // enum method
    uint16_t norm;        // 0.01 uT
    int16_t dip;          // 0.01 deg
    int16_t lag;          // 1e-6 s
    int16_t north;        // 0.25 uT
    int16_t up;           // 0.25 uT
};

struct record_tip {
    int32_t offset[3];  // 1e-6 m
    int16_t axis[3];    // 2^-14
    uint16_t sigma;     // 1e-5 m
    uint16_t day;       // days
    uint8_t method;     // enum method
};

struct record_options {
    uint8_t button_does;  // enum button_does
    uint8_t reference;    // enum reference
};

struct record_name {
    uint8_t text[24];
};

struct record_noise {
    uint16_t acc;  // 1e-6 m/s2/rtHz
    uint16_t gyr;  // 1e-7 rad/s/rtHz
};

#endif
