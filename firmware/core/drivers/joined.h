// SPDX-License-Identifier: MIT
// A sensor of two chips on one bus, an inertial one and a magnetometer: what joins them
// is a description of the module that they are on.
#ifndef JOINED_H
#define JOINED_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/part.h"

// Three axes among the bytes of a burst, little-endian: where they begin, and the size
// in counts that is beyond their range.
struct joined_axes {
    uint8_t place;
    uint16_t beyond;
};

// The interface of an inertial chip's driver. Its burst begins with the temperature.
struct joined_inertial {
    const IN_FLASH struct part_chip *chip;
    struct bus_burst burst;  // these two without an address
    struct sensor_ready ready;
    struct joined_axes acc, gyr;
    int16_t temperature_zero_cdeg;
    int16_t temperature_cdeg_q8;  // a count, times 256
};

// The interface of a magnetometer's driver. Its burst begins with a status.
struct joined_magnetic {
    const IN_FLASH struct part_chip *chip;
    uint32_t mag_lsb_pt;
    struct bus_burst burst;  // without an address
    uint8_t fresh;           // bits of the status: a field that was not there before
    struct joined_axes mag;
};

// The module. Each chip has been given the number of one of its axes for each of
// the module's: 1, 2, 3 is x, y, z, and a minus turns it round.
struct joined_config {
    const IN_FLASH struct joined_inertial *inertial;
    const IN_FLASH struct joined_magnetic *magnetic;
    int8_t inertial_axes[3];
    int8_t mag_axes[3];
    uint16_t mag_lag_us;  // how old a field is in the sample that brings it
#ifndef PART_WITHOUT_SELF_TEST
    // The module whose inertial chip may be there in its place; null: none.
    const IN_FLASH struct joined_config *or_else;
#endif
};

// Starts with its config and zeros. Private to the driver.
struct joined {
    const IN_FLASH struct joined_config *config;
    struct sensor_identity identity;
    struct bus_burst bursts[2];
    struct sensor_ready ready;
    struct part inertial;
    struct part magnetic;
    uint8_t phase;         // of set-up
    uint8_t tries;         // of the magnetometer, within the set-up
    bool has_mag;          // it measures, and is in the bursts
    bool checks_magnetic;  // it is looked after next
    uint8_t mag_age;       // checks since it last measured, or was looked for
    uint8_t mag_failures;  // set-ups that it has spoiled: mag_watch.h
};

// The functions of struct sensor_driver; `state` is a struct joined. Each chip is found
// at either of its addresses. A step of set-up holds the bus for 0.4 ms at most.
//
// A magnetometer that does not answer is left out: six axes, who_am_i[1] is 0. It is
// looked for once every two checks, and a new set-up brings it back. One that answers
// and does not work, or holds the bus, is left out too, reported by `mag_failed`, and
// tried at growing intervals. Without it the second burst has length 0.
void joined_begin(void *state);
enum sensor_result joined_setup(void *state, const IN_FLASH struct bus_device *bus,
                                uint32_t now_us) MUST_CHECK;
bool joined_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                  struct sample *out) MUST_CHECK;
enum sensor_result joined_check(void *state,
                                const IN_FLASH struct bus_device *bus) MUST_CHECK;

// Initialiser of a struct sensor_driver over `joined`, a struct joined, whose `begin`
// is joined_begin() or calls it; further members may follow.
#define JOINED_DRIVER(joined, begin_of, ...)                                           \
    {                                                                                  \
        .begin = (begin_of), .setup = joined_setup, .parse = joined_parse,             \
        .check = joined_check, .state = (joined), .identity = &(joined)->identity,     \
        .bursts = (joined)->bursts, .bursts_count = 2,                                 \
        SENSOR_READY(&(joined)->ready) __VA_ARGS__                                     \
    }

#endif
