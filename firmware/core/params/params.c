// SPDX-License-Identifier: MIT
// Records to values; see params.h.
#include "core/params/params.h"

#include <stddef.h>
#include <string.h>

#include "core/storage/crc32.h"
#include "core/wire/messages.h"

// A calibration is taken as it lies in its record.
_Static_assert(offsetof(struct calibration_of_sensor, matrix) ==
                       offsetof(struct record_acc, matrix) &&
                   offsetof(struct calibration_of_sensor, sigma) ==
                       offsetof(struct record_acc, sigma),
               "bias, matrix and sigma begin a record");
_Static_assert(offsetof(struct calibration, field_up) ==
                   offsetof(struct calibration, field_north) + sizeof(int16_t),
               "as the record has them");
_Static_assert(CALIBRATION_DRIFT == ACC_DRIFT_NULL, "what is assumed is not known");
_Static_assert(PARAMS_ACC == 1 && PARAMS_GYR == 2 && PARAMS_MAG == 3, "as sensors[]");
enum {
    VALUES_SIZE = offsetof(struct record_acc, sigma),  // at least
    VALUES_ALL = offsetof(struct record_acc, residual),
    // In the record, whose parts follow each other without gaps.
    TEMPERATURE_AT = VALUES_ALL + 2,
    TEMPERATURE_SIZE = 2,
    DRIFT_AT = TEMPERATURE_AT + 5,  // after day and method
    FIELD_AT = VALUES_ALL + 13,
    FIELD_SIZE = 4,
    TAGS_MAX = 8,  // of the records that are known, and of those that may not be double
    AXIS_MAX = 16400,  // of a unit vector, rounded
};

#ifndef POSE_WITHOUT_STROKES
enum {
    BUTTON_DOES_MAX = BUTTON_DOES_STROKE,
    TIP_MAX_UM = 2000000,
    TIP_VALUES_SIZE = offsetof(struct record_tip, sigma)
};
_Static_assert(offsetof(struct pose_tip, axis) == offsetof(struct record_tip, axis),
               "offset and axis begin a record, with its nulls");

static void clear_tip(struct params *params) {
    params->tip.offset_um[0] = TIP_OFFSET_NULL;
    params->tip.axis[0] = TIP_AXIS_NULL;
}

// A tip outside its limits is unknown. Nulls are also outside them.
static void check_tip(struct params *params) {
    struct pose_tip *tip = &params->tip;
    for (uint8_t axis = 0; axis < 3; ++axis) {
        if (fixed_magnitude(tip->offset_um[axis]) > TIP_MAX_UM) {
            tip->offset_um[0] = TIP_OFFSET_NULL;
        }
        if (fixed_magnitude(tip->axis[axis]) > AXIS_MAX) {
            tip->axis[0] = TIP_AXIS_NULL;
        }
    }
}
#else
enum { BUTTON_DOES_MAX = BUTTON_DOES_TELL };
#define clear_tip(params) ((void)(params))
#define check_tip(params) ((void)(params))
#endif

// A bit for each of those tags, none for others.
static uint8_t bit_of(uint8_t tag) {
    uint8_t bit = tag < TAGS_MAX ? 1 : 0;
    for (; tag > 0; --tag) {
        bit = (uint8_t)(2 * bit);
    }
    return bit;
}

// In which a sensor was calibrated, of a record with this tag and length.
static void read_conditions(const IN_FLASH struct memory *memory, uint16_t offset,
                            const uint8_t head[2], struct calibration *out) {
    if (head[0] == PARAMS_MAG && head[1] >= FIELD_AT + FIELD_SIZE) {
        memory_copy(memory, (uint16_t)(offset + FIELD_AT), &out->field_north,
                    FIELD_SIZE);
    }
    if (head[0] == PARAMS_ACC && head[1] >= TEMPERATURE_AT + TEMPERATURE_SIZE) {
        memory_copy(memory, (uint16_t)(offset + TEMPERATURE_AT), &out->temperature,
                    TEMPERATURE_SIZE);
        if (head[1] > DRIFT_AT) {
            memory_copy(memory, (uint16_t)(offset + DRIFT_AT), &out->drift, 1);
        }
    }
}

enum params_fault params_read(const IN_FLASH struct memory *memory, uint16_t offset,
                              uint8_t length, struct params *out, uint8_t *tag) {
    uint8_t seen = 0;  // a bit for each tag
    const uint16_t end = (uint16_t)(offset + length);
    memset(out, 0, sizeof *out);
    calibration_clear(&out->calibration);
    clear_tip(out);
    while (offset < end) {
        uint8_t head[2];  // tag, length
        memory_copy(memory, offset, head, sizeof head);
        offset = (uint16_t)(offset + 2);
        *tag = head[0];
        if (offset + head[1] > end) {
            return PARAMS_WRONG_LENGTH;
        }
        const uint8_t bit = bit_of(head[0]);
        if ((seen & bit) != 0) {
            return PARAMS_DOUBLED;
        }
        seen |= bit;
        struct calibration_of_sensor *sensor = NULL;
        uint8_t *to = &out->button_does;
        uint8_t size = 0;
        if (head[0] == PARAMS_OPTIONS) {
            size = PARAMS_OPTIONS_SIZE;
        } else if (head[0] >= PARAMS_ACC && head[0] <= PARAMS_MAG) {
            sensor = &out->calibration.sensors[head[0] - PARAMS_ACC];
            to = (uint8_t *)sensor;
            size = VALUES_SIZE;
        }
#ifndef POSE_WITHOUT_STROKES
        // Without the parts that say where it is, the tip is not known.
        if (head[0] == PARAMS_TIP && head[1] >= TIP_VALUES_SIZE) {
            to = (uint8_t *)&out->tip;
            size = TIP_VALUES_SIZE;
        }
#endif
        if (head[1] < size) {
            return PARAMS_WRONG_LENGTH;
        }
        if (head[1] >= VALUES_ALL && size == VALUES_SIZE) {
            size = VALUES_ALL;
        }
        memory_copy(memory, offset, to, size);
        read_conditions(memory, offset, head, &out->calibration);
        if ((sensor != NULL && !calibration_of_sensor_is_valid(sensor)) ||
            out->button_does > BUTTON_DOES_MAX || out->reference > REFERENCE_FULL) {
            return PARAMS_OUT_OF_RANGE;
        }
        offset = (uint16_t)(offset + head[1]);
    }
    check_tip(out);
    const uint8_t *bytes = (const uint8_t *)&out->calibration;
    for (uint8_t i = 0; i < sizeof out->calibration; ++i) {
        crc32_add(&out->digest, bytes[i]);
    }
    return PARAMS_FINE;
}
