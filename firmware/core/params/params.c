// SPDX-License-Identifier: MIT
// Records to values; see params.h.
#include "core/params/params.h"

#include <stddef.h>
#include <string.h>

#include "core/wire/messages.h"

// A calibration is taken as it lies in its record.
_Static_assert(offsetof(struct calibration_of_sensor, matrix) ==
                   offsetof(struct record_acc, matrix),
               "bias and matrix begin a record");
enum {
    VALUES_SIZE = offsetof(struct record_acc, sigma),
    TAGS_MAX = 8,  // of the records that are known, and of those that may not be double
};

void params_clear(struct params *out) {
    memset(out, 0, sizeof *out);
    calibration_clear(&out->calibration);
}

static void copy(const struct params_source *source, uint16_t at, uint8_t length,
                 void *out) {
    for (uint8_t i = 0; i < length; ++i) {
        ((uint8_t *)out)[i] = source->read(source->context, (uint16_t)(at + i));
    }
}

// Takes the record of `length` bytes at `at` into `out`.
static enum params_fault take(const struct params_source *source, uint8_t tag,
                              uint16_t at, uint8_t length, struct params *out) {
    if (tag == PARAMS_OPTIONS) {
        if (length < PARAMS_OPTIONS_SIZE) {
            return PARAMS_WRONG_LENGTH;
        }
        copy(source, at, PARAMS_OPTIONS_SIZE, &out->button_does);
        return out->button_does <= BUTTON_DOES_TELL && out->reference <= REFERENCE_FULL
                   ? PARAMS_FINE
                   : PARAMS_OUT_OF_RANGE;
    }
    struct calibration_of_sensor *sensor = &out->calibration.acc;
    switch (tag) {
    case PARAMS_ACC:
        break;
    case PARAMS_GYR:
        sensor = &out->calibration.gyr;
        break;
    case PARAMS_MAG:
        sensor = &out->calibration.mag;
        break;
    default:
        return PARAMS_FINE;
    }
    if (length < VALUES_SIZE) {
        return PARAMS_WRONG_LENGTH;
    }
    copy(source, at, VALUES_SIZE, sensor);
    return calibration_of_sensor_is_valid(sensor) ? PARAMS_FINE : PARAMS_OUT_OF_RANGE;
}

enum params_fault params_read(const struct params_source *source, struct params *out,
                              uint8_t *tag) {
    struct params read;
    params_clear(&read);
    bool is_seen[TAGS_MAX] = {false};
    uint16_t at = 0;
    while (at < source->length) {
        const uint16_t left = (uint16_t)(source->length - at);
        *tag = source->read(source->context, at);
        const uint8_t length =
            left > 1 ? source->read(source->context, (uint16_t)(at + 1)) : 0;
        if (left < 2 || length > left - 2) {
            return PARAMS_WRONG_LENGTH;
        }
        if (*tag < TAGS_MAX) {
            if (is_seen[*tag]) {
                return PARAMS_DOUBLED;
            }
            is_seen[*tag] = true;
        }
        const enum params_fault fault =
            take(source, *tag, (uint16_t)(at + 2), length, &read);
        if (fault != PARAMS_FINE) {
            return fault;
        }
        at = (uint16_t)(at + 2 + length);
    }
    *out = read;
    return PARAMS_FINE;
}
