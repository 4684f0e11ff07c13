// SPDX-License-Identifier: MIT
// The MPU-9250 (or MPU-9255, or MPU-6500 without magnetometer) as a sensor: set-up with
// self-test, and bursts to samples. Its AK8963 is read by the chip's own I2C master.
#ifndef MPU9250_H
#define MPU9250_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/sensor.h"

enum {
    MPU9250_ADDRESS = 0x68,  // pin AD0 low
    MPU9250_RATE_HZ = 200,
    MPU9250_GYR_DELAY_US = 3900,  // RM 4.6: DLPF_CFG 2, 92 Hz
};

// Starts zeroed. Private to the driver.
struct mpu9250 {
    struct sensor_identity identity;
    struct bus_burst bursts[1];
    uint16_t since;       // start of the current wait, ticks of 1.024 ms
    uint8_t wait;         // ticks
    uint8_t step;         // of set-up
    uint8_t count;        // tries
    uint8_t read;         // a register that was looked at
    uint8_t was_running;  // not 0: the chip has had its power since it was set up
    uint8_t verified;     // registers read back, of this round
    bool was_ready;       // the AK8963's block before this one was data-ready
    uint8_t mag[6];       // its data last read
    uint8_t mag_age;      // checks since it last measured, or was looked for
    // A new set-up forgets all before these.
    uint8_t mag_failures;  // of the AK8963: mag_watch.h
    struct message_self_test test;
};

// The functions of struct sensor_driver; `state` is a struct mpu9250. Any chip runs
// whose identity is not 0x00 or 0xFF, whose registers read back as written and whose
// force is near 1 g at some time of a second: clones have other identities. An
// AK8963 that does not answer is left out, and looked for again later; so is one that
// answers and does not measure, after three set-ups, at growing intervals.
//
// Set-up takes 0.7 s (0.4 s from the second time on: what the inertial dies answered to
// their self-test is kept); a step of it holds the bus for 0.5 ms at most. A sample
// whose bytes can be no reading (all zeros or all ones) has both clipped flags, no
// temperature and no magnetic field.
void mpu9250_begin(void *state);
enum sensor_result mpu9250_setup(void *state, const IN_FLASH struct bus_device *bus,
                                 uint32_t now_us) MUST_CHECK;
bool mpu9250_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                   struct sample *out) MUST_CHECK;
enum sensor_result mpu9250_check(void *state,
                                 const IN_FLASH struct bus_device *bus) MUST_CHECK;

#ifndef ACQUISITION_WIRED_ONLY
extern const struct sensor_ready mpu9250_ready;
#endif

// Initialiser of a struct sensor_driver over `chip`, a struct mpu9250; further members
// may follow.
#define MPU9250_DRIVER(chip, ...)                                                      \
    {                                                                                  \
        .begin = mpu9250_begin, .setup = mpu9250_setup, .parse = mpu9250_parse,        \
        .check = mpu9250_check, .state = (chip), .identity = &(chip)->identity,        \
        .bursts = (chip)->bursts, .bursts_count = 1,                                   \
        SENSOR_READY(&mpu9250_ready) __VA_ARGS__                                       \
    }

#endif
