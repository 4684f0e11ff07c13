// SPDX-License-Identifier: MIT
// The LSM9DS0 as a sensor: a gyroscope at one address, an accelerometer with a
// magnetometer at another. Set-up with self-test, and three bursts to a sample.
#ifndef LSM9DS0_H
#define LSM9DS0_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/self_test.h"

enum {
    LSM9DS0_GYR_ADDRESS = 0x6B,      // pin SDO_G high
    LSM9DS0_GYR_ADDRESS_LOW = 0x6A,  // pin SDO_G low
    LSM9DS0_XM_ADDRESS = 0x1D,       // pin SDO_XM high
    LSM9DS0_XM_ADDRESS_LOW = 0x1E,   // pin SDO_XM low
    LSM9DS0_BURSTS = 3,              // to a sample
    LSM9DS0_RATE_HZ = 380,
    LSM9DS0_FAST_RATE_HZ = 760,
    // The document gives the low-pass a cut-off, 100 Hz, and no delay: this is that of
    // two poles (Butterworth, far below the cut-off), sqrt(2) / (2 pi 100 Hz).
    LSM9DS0_GYR_DELAY_US = 2251,
    // It is read as soon as it has measured; how long that takes is not in the
    // document.
    LSM9DS0_MAG_LAG_US = 1000,
};

// How the board has it; stays as it is.
struct lsm9ds0_config {
    uint8_t gyr_address;
    uint8_t xm_address;
    bool is_fast;  // LSM9DS0_FAST_RATE_HZ
};

// Starts with its config and zeros. Private to the driver.
struct lsm9ds0 {
    struct lsm9ds0_config config;
    struct sensor_identity identity;
    struct bus_burst bursts[LSM9DS0_BURSTS];
    uint16_t since;        // start of the current wait, ticks of 1.024 ms
    uint16_t wait;         // ticks
    uint8_t step;          // of set-up
    uint8_t count;         // samples within the step
    uint8_t ready;         // sensors that were data-ready, within the last step
    uint8_t held;          // samples since the last new acceleration
    bool has_mag;          // the magnetometer measures
    bool mag_measured;     // since it was last looked after
    bool checks_xm;        // the half whose registers are read back next
    uint8_t mag_age;       // looks without a field
    uint8_t mag_failures;  // mag_watch.h
    struct self_test test;
};

// The functions of struct sensor_driver; `state` is a struct lsm9ds0. Set-up takes 1.2
// s (0.9 s from the second time on: the inertial verdict is kept); a step of it holds
// the bus for 0.5 ms at most. The self-test of a probe that moves has no verdict unless
// it passes. The magnetometer has no self-test: it gets no flag, or `failed` where it
// never measures; then who_am_i[1] is 0 and the probe has six axes. One that stops is
// noticed after six looks, 12 s, and left out if three set-ups don't help; one that
// measures again is brought back, by a set-up, at growing intervals.
//
// A chip of another kind is named by who_am_i[0], in whichever half it is.
//
// The gyroscope's data-ready (DRDY_G) is the edge of a sample. It stays high until the
// sample is read. The accelerometer and the magnetometer have clocks that are not the
// gyroscope's:
// - the accelerometer's has twice the rate, so that each sample has a new one, at most
//   1.3 ms old (0.7 at 760 Hz). Where none has come the last is held, as a slow sensor
//   would; after four samples on end the accelerometer stands still, and the bytes are
//   no reading;
// - a magnetic field is given once, in the sample that finds it new (has_mag). One that
//   is measured while its registers are read can be lost, 8 % of them at 380 Hz.
// A sample that was overwritten before it was read gives the next one has_gap.
// Beyond 2000 deg/s and 16 g, which the registers hold but the data sheet does not
// specify, a sample is clipped; beyond 2 gauss the field has overflowed.
void lsm9ds0_begin(void *state);
enum sensor_result lsm9ds0_setup(void *state, const IN_FLASH struct bus_device *bus,
                                 uint32_t now_us) MUST_CHECK;
bool lsm9ds0_parse(void *state, const uint8_t *bytes, uint32_t time_us,
                   struct sample *out) MUST_CHECK;

enum sensor_result lsm9ds0_check(void *state,
                                 const IN_FLASH struct bus_device *bus) MUST_CHECK;

// Stops all three sensors, for a board that sleeps; set-up starts them again. False
// where the bus fails.
bool lsm9ds0_power_down(const struct lsm9ds0 *chip,
                        const IN_FLASH struct bus_device *bus) MUST_CHECK;

// Initialiser of a struct sensor_driver over `chip`, a struct lsm9ds0.
#define LSM9DS0_DRIVER(chip)                                                           \
    {                                                                                  \
        .begin = lsm9ds0_begin, .setup = lsm9ds0_setup, .parse = lsm9ds0_parse,        \
        .check = lsm9ds0_check, .state = (chip), .identity = &(chip)->identity,        \
        .bursts = (chip)->bursts, .bursts_count = LSM9DS0_BURSTS,                      \
    }

#endif
