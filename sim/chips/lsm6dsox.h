// SPDX-License-Identifier: MIT
// A model of the LSM6DSOX, byte by byte on I2C, written from its maker's documents; the
// LSM6DSO and the ISM330DHCX are variants, and the LSM6DSV16X one with registers of its
// own (lsm6dsox/families.c). The virtual boards and the driver's tests
// use it; it depends on no emulator and no driver.
//
// Documents: DS = LSM6DSO32 data sheet, DocID032891 rev 1, which has the registers of
// the LSM6DSO and LSM6DSOX but for the accelerometer's ranges; SO = LSM6DSO data sheet,
// DS12140 rev 2 (self-test, rates, axes); AN = AN5040 rev 3 on the LSM6DSL, the same
// blocks one generation earlier (start-up, samples to be discarded, data-ready, BDU);
// AD = Adafruit's library Adafruit_LSM6DS; LX = Linux, drivers/iio/imu/st_lsm6dsx; QC =
// ST's driver of the LSM6DSO for Qualcomm's hubs (delay by data rate, clock dividers).
// "Memory" beside a number: AN5192 on the LSM6DSO, not at hand.
//
// The model asks for motion in its own axes.
//
// Open points of the documents, and the model's choice:
// - Its one clock has an error; no document says how large (rate_error_ppm).
//   INTERNAL_FREQ_FINE shows it.
// - Samples of both sensors fall on one grid: at one rate, at one time. The first one
//   comes a whole period or more after a sensor is turned on.
// - A low-pass is a moving average of the documented bandwidth, centred on the
//   documented delay, or ends now where it would see the future.
// - The gyroscope reads zero for gyr_turn_on_ns after power-down. A sample that AN says
//   to discard is half of what it should be.
// - A sample that finds its place held by BDU shows, and is flagged, once both halves
//   have been read.
// - Beyond its full scale an output goes on to the ends of 16 bits.
// - Self-test acts at once. Documents give limits at 250 and 2000 deg/s alone.
// - A reset with INT1 high leaves an interface with I3C alone, until power goes
//   (LX: st_lsm6dsx_reset_device(); DS table 19 says so of power-on). INT1 is high
//   where the chip itself holds it high.
//
// Not modelled: noise and offsets, which the motion has (`imud sim --module`), and what
// no firmware here uses: INT2, the gyroscope's LPF1 and the accelerometer's LPF2, low
// power, sleep, user offsets, reboot, FIFO, timestamps, high-pass filters, circular
// bursts, events, sensor hub, embedded functions, DEN, the auxiliary interface, SPI,
// I3C. Turning one on is reported (sensor_chip_complaint), like a use that the data
// sheet forbids.
#ifndef SIM_CHIPS_LSM6DSOX_H
#define SIM_CHIPS_LSM6DSOX_H

#include <stdbool.h>
#include <stdint.h>

#include "sensor_chip.h"

struct lsm6_family;  // what its registers mean

struct lsm6dsox_chip_config {
    struct sensor_chip_config sensor;
    const struct lsm6_family *family;
    double rate_error_ppm;        // of its clock; positive is fast
    uint64_t reset_ns;            // how long SW_RESET takes
    uint64_t gyr_turn_on_ns;      // from power-down until readings are good
    uint8_t who_am_i;             // 0x6C; of a relative: `pairs` in module.c
    bool sa0;                     // level of the pin: address 0x6A or 0x6B
    double gyr_self_test_dps[3];  // response of each axis, at 2000 deg/s
    double acc_self_test_mg[3];   // response of each axis
};

// A plain LSM6DSOX, which an LSM6DSO equals here: no errors, 25 degC, SA0 low.
struct lsm6dsox_chip_config lsm6dsox_chip_defaults(void);
// An LSM6DSV16X; an LSM6DSV equals it here.
struct lsm6dsox_chip_config lsm6dsv16x_chip_defaults(void);

// A chip whose power comes at time 0; its pin is INT1. Null where memory is out. Its
// die is number 1.
struct sensor_chip *lsm6dsox_chip_new(const struct lsm6dsox_chip_config *config);

#endif
