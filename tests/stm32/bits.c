// SPDX-License-Identifier: MIT
// The samples: at rest, then turning and shaken by a random walk, with a reading of the
// magnetometer in every fourth.
#include "bits.h"

#include "core/fusion/pose.h"

enum { RATE_HZ = 380, PERIOD_US = 1000000 / RATE_HZ, AT_REST = 700 };

static const struct sensor_identity sensor = {
    .rate_hz = RATE_HZ,
    .gyr_delay_us = 2251,
    .gyr_lsb_nrad_s = 1221730,
    .acc_lsb_nm_s2 = 7178468,
    .mag_lsb_pt = 8000,
};
static struct calibration calibration;
static struct pose_tracker tracker;
static struct counts gyr;
static uint32_t number, noise, digest;

static int16_t random_within(int16_t bound) {
    noise ^= noise << 13;
    noise ^= noise >> 17;
    noise ^= noise << 5;
    return (int16_t)((int32_t)(noise % (2U * (uint32_t)bound + 1)) - bound);
}

static int16_t wander(int16_t from) {
    const int32_t to = from + random_within(200);
    return (int16_t)(to > 20000 ? 20000 : to < -20000 ? -20000 : to);
}

void bits_begin(int32_t filter) {
    number = 0;
    noise = 2463534242U;
    digest = 2166136261U;
    gyr = (struct counts){.x = 0};
    calibration_clear(&calibration);
    (void)pose_begin(&tracker, &calibration, &sensor, filter);
}

static void take_up(int32_t value) {
    for (uint8_t byte = 0; byte < 4; byte++) {
        digest = (digest ^ ((uint32_t)value >> (8 * byte) & 0xFF)) * 16777619U;
    }
}

void bits_step(void) {
    struct sample sample = {
        .time_us = number * PERIOD_US,
        .acc = {.x = random_within(5),
                .y = random_within(5),
                .z = (int16_t)(1366 + random_within(5))},
        .gyr = {.x = random_within(3), .y = random_within(3), .z = random_within(3)},
        .temperature_cdeg = 2500,
        .has_mag = number % 4 == 0,
    };
    if (number > AT_REST) {
        gyr =
            (struct counts){.x = wander(gyr.x), .y = wander(gyr.y), .z = wander(gyr.z)};
        sample.gyr = gyr;
        sample.acc.x = (int16_t)(sample.acc.x + random_within(800));
        sample.acc.y = (int16_t)(sample.acc.y + random_within(800));
        sample.acc.z = random_within(2000);
    }
    if (sample.has_mag) {
        sample.mag = (struct counts){.x = (int16_t)(2400 + random_within(900)),
                                     .y = random_within(900),
                                     .z = (int16_t)(-5200 + random_within(900))};
    }
    number++;
    (void)pose_step(&tracker, &sample);
    struct message_pose pose;
    pose_read(&tracker, &pose);
    for (uint8_t i = 0; i < 4; i++) {
        take_up(pose.q[i]);
    }
    take_up(pose.tilt_sigma);
    take_up(pose.heading_sigma);
    take_up(pose.pose_flags);
}

uint32_t bits_digest(void) {
    return digest;
}
