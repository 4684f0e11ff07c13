// SPDX-License-Identifier: MIT
// Any counts at any intervals, with any valid calibration and any commands between: a
// unit quaternion comes out, and what is not known is null.
#include "core/fusion/paper_filter.h"
#include "core/fusion/pose.h"
#include "fuzz.h"

enum { STEPS_MAX = 6000 };  // of one input, 30 s: repeats make long runs of few bytes
// Without these flags a pose of the main filter has a heading.
#define NO_HEADING                                                                     \
    (POSE_STARTING | POSE_HEADING_FREE | POSE_FIELD_IMPOSSIBLE | POSE_FIELD_UNLIKE |   \
     POSE_FORCE_IMPOSSIBLE)

static const uint16_t rates_hz[] = {100, 200, 250, 380, 499, 760, 800, 333};
static const uint16_t delays_us[] = {0, 2500, 3900, 7500};

// A matrix and a bias from the input; none where they aren't valid.
static void take_calibration(struct input *input, struct calibration *out) {
    calibration_clear(out);
    struct calibration taken = *out;
    struct calibration_of_sensor *const sensors[] = {&taken.acc, &taken.gyr,
                                                     &taken.mag};
    for (uint8_t sensor = 0; sensor < 3; ++sensor) {
        for (uint8_t row = 0; row < 3; ++row) {
            sensors[sensor]->bias[row] = (q18_14_t)input_u32(input);
            for (uint8_t column = 0; column < 3; ++column) {
                sensors[sensor]->matrix[row][column] = (q2_14_t)input_u16(input);
            }
        }
    }
    if (calibration_is_valid(&taken)) {
        *out = taken;
    }
}

static void take_counts(struct input *input, struct counts *out) {
    out->x = (int16_t)input_u16(input);
    out->y = (int16_t)input_u16(input);
    out->z = (int16_t)input_u16(input);
}

// What the last reading latched must be in the next one and in no other.
struct expected {
    bool is_clipped, has_gap, is_tared;
};

static bool has(const struct message_pose *pose, unsigned flag) {
    return (pose->pose_flags & flag) != 0;
}

static void check_quaternion(const int32_t q[4]) {
    int64_t square = 0;
    for (uint8_t i = 0; i < 4; ++i) {
        CHECK(q[i] <= Q2_30_ONE + 1074 && q[i] >= -Q2_30_ONE - 1074);
        square += (int64_t)q[i] * q[i];
    }
    // |q| within 1e-6 of 1.
    const int64_t one = INT64_C(1) << 60;
    CHECK(square - one < one / 500000 && one - square < one / 500000);
}

static void check_rows(const int32_t q[4]) {
    const struct quat quat = {q[0], q[1], q[2], q[3]};
    struct vector rows[3];
    struct quat back;
    quat_to_rows(&quat, rows);
    quat_from_rows(rows, &back);
    // The same attitude, with either sign: |<q, back>| is 1.
    const int64_t along = (int64_t)quat.w * back.w + (int64_t)quat.x * back.x +
                          (int64_t)quat.y * back.y + (int64_t)quat.z * back.z;
    const int64_t one = INT64_C(1) << 60;
    const int64_t off = (along < 0 ? -along : along) - one;
    CHECK(off < one / 500000 && off > -one / 500000);
}

static void check_pose(struct pose_tracker *tracker, struct expected *expected) {
    struct message_pose pose;
    struct message_pose again;
    pose_read(tracker, &pose);
    check_quaternion(pose.q);
    check_rows(pose.q);
    for (uint8_t axis = 0; axis < 3; ++axis) {
        CHECK(pose.position[axis] == POSE_POSITION_NULL);
        CHECK(pose.normal[axis] == POSE_NORMAL_NULL);
    }
    CHECK(has(&pose, POSE_CLIPPED) == expected->is_clipped);
    CHECK(has(&pose, POSE_GAP) == expected->has_gap);
    CHECK(has(&pose, POSE_TARED) == expected->is_tared);
    CHECK(has(&pose, POSE_UNCALIBRATED) != tracker->is_calibrated);
    CHECK(!(has(&pose, POSE_MAG_ABSENT) && has(&pose, POSE_MAG_DISTURBED)));
    // A number where it is known, null where it is not.
    const bool has_heading = (pose.pose_flags & NO_HEADING) == 0;
    if (has(&pose, POSE_FORCE_IMPOSSIBLE)) {
        CHECK(pose.tilt_sigma == POSE_TILT_SIGMA_NULL);
    }
    if (!has_heading) {
        CHECK(pose.heading_sigma == POSE_HEADING_SIGMA_NULL);
    }
    if (attitude_kind(&tracker->attitude) == FILTER_FUSE) {
        // The tilt may be known while the heading still starts.
        CHECK(pose.tilt_sigma != POSE_TILT_SIGMA_NULL || has(&pose, POSE_STARTING) ||
              has(&pose, POSE_FORCE_IMPOSSIBLE));
        CHECK(has_heading == (pose.heading_sigma != POSE_HEADING_SIGMA_NULL));
    }
    pose_read(tracker, &again);
    CHECK(again.pose_flags == (pose.pose_flags & ~(POSE_CLIPPED | POSE_GAP)));
    for (uint8_t i = 0; i < 4; ++i) {
        CHECK(again.q[i] == pose.q[i]);
    }
    *expected = (struct expected){.is_tared = expected->is_tared};
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct input input = {data, data + size};
    const uint8_t setup = input_u8(&input);
    const uint8_t kinds = input_u8(&input);
    const struct sensor_identity identity = {
        .kind = SENSOR_MPU9250,
        .rate_hz = rates_hz[setup % 8],
        .gyr_delay_us = delays_us[setup / 8 % 4],
        .gyr_lsb_nrad_s = setup & 32 ? 1221730 : 1065264,
        .acc_lsb_nm_s2 = setup & 64 ? 7178466 : 4788403,
        .mag_lsb_pt = 150000,
    };
    struct calibration calibration;
    if (setup & 128) {
        take_calibration(&input, &calibration);
    } else {
        calibration_clear(&calibration);
    }
    static struct pose_tracker tracker;
    if (!pose_begin(&tracker, &calibration, &identity, kinds % 8)) {
        return 0;
    }
    const uint32_t period_us = UINT32_C(1000000) / identity.rate_hz;
    struct expected expected = {false, false, false};
    struct sample sample = {.temperature_cdeg = SAMPLE_NO_TEMPERATURE};
    for (unsigned steps = 0; input.next < input.end && steps < STEPS_MAX;) {
        const uint8_t what = input_u8(&input);
        uint32_t interval_us = period_us;
        sample.has_gap = false;
        switch (what & 3) {
        case 1:
            interval_us = input_u16(&input);
            break;
        case 2:
            interval_us = input_u32(&input);
            sample.has_gap = true;
            break;
        case 3: {
            const uint8_t command = input_u8(&input);
            sample.acc_clipped = command & 1;
            sample.gyr_clipped = command & 2;
            if (command & 4) {
                const enum pose_origin origin = (enum pose_origin)(command / 8 % 3);
                pose_set_origin(&tracker, origin);
                expected.is_tared = origin != POSE_ORIGIN_NONE;
            }
            if (command & 64) {
                pose_begin(&tracker, &calibration, &identity, command % 8);
                expected =
                    (struct expected){false, false, tracker.origin != POSE_ORIGIN_NONE};
            }
            break;
        }
        default:
            break;
        }
        if (what & 4) {
            take_counts(&input, &sample.gyr);
        }
        if (what & 8) {
            take_counts(&input, &sample.acc);
        }
        if (what & 16) {
            take_counts(&input, &sample.mag);
        }
        const unsigned repeats = what & 64 ? 1U + input_u8(&input) : 1U;
        const bool is_seldom = what & 128;  // read once, after the last of them
        for (unsigned i = 0; i < repeats; ++i) {
            sample.time_us += interval_us;
            // Each one, or each other as of a chip at 200 samples a second.
            sample.has_mag = (what & 16) != 0 || ((what & 32) != 0 && i % 2 == 1);
            pose_step(&tracker, &sample);
            expected.is_clipped |= sample.acc_clipped || sample.gyr_clipped;
            expected.has_gap |= sample.has_gap;
            if (!is_seldom || i + 1 == repeats) {
                check_pose(&tracker, &expected);
            }
            ++steps;
        }
    }
    return 0;
}
