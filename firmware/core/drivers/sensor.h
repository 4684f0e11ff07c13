// SPDX-License-Identifier: MIT
// The seam between a sensor's driver and the probe: the sensor's identity, how it is
// set up step by step, and how the bytes of its bursts become a sample.
#ifndef SENSOR_H
#define SENSOR_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/bus.h"
#include "core/drivers/sample.h"
#include "core/math/constant.h"
#include "core/wire/messages.h"

enum sensor_result {
    SENSOR_OK = 0,
    SENSOR_BUSY = 1,  // call again; nothing is wrong
    // A transaction failed, and why as enum bus_result has it.
    SENSOR_BUS_NACK = BUS_NACK,
    SENSOR_BUS_TIMEOUT = BUS_TIMEOUT,
    SENSOR_BUS_STUCK = BUS_STUCK,
    SENSOR_WRONG_CHIP = -4,   // the chip is not of the driver's kind
    SENSOR_STUCK = -5,        // the chip answers but never gets ready
    SENSOR_UNSET = -6,        // a register does not keep its value
    SENSOR_NO_FORCE = -7,     // the accelerometer never measured about 1 g
    SENSOR_MAG_CHANGED = -8,  // the magnetometer went silent, or answers again
    SENSOR_MAG_STUCK = -9,    // it holds its bus, or keeps the sensor from data
};

// For an identity: deg/s as 1e-9 rad/s, and g as 1e-9 m/s2. The factors: 1e9 pi / 180
// as 2^-18ths, 1e9 * 9.80665 as halves.
#define SENSOR_NANO_RAD(degrees) Q_TIMES(degrees, 0, INT64_C(4575275914348), 18)
#define SENSOR_NANO_G(g) Q_TIMES(g, 0, INT64_C(19613300000), 1)

struct sensor_identity {
    uint8_t kind;             // enum sensor of the protocol
    uint8_t who_am_i[2];      // inertial die, magnetic die (0 where absent)
    uint8_t mag_adjust[3];    // as read from the chip; zeros where absent
    uint8_t self_test;        // flags self_test of the protocol
    uint16_t rate_hz;         // samples a second
    uint16_t gyr_delay_us;    // of the rate behind the motion, by the chip's low-pass
    uint16_t mag_lag_us;      // of a field behind its sample; 0: not known
    uint32_t acc_lsb_nm_s2;   // one count of the accelerometer, 1e-9 m/s2
    uint32_t gyr_lsb_nrad_s;  // one count of the gyroscope, 1e-9 rad/s
    uint32_t mag_lsb_pt;      // one count of the magnetometer, 1e-6 uT (picotesla)
    uint8_t wrong_register;   // that made SENSOR_UNSET
    // The self-test's responses, for a host to judge; null where the driver judges.
    const struct message_self_test *answers;
};

enum { SENSOR_BURSTS_MAX = 3 };

// Where a chip reports a sample: these bits of a register, until it is read.
struct sensor_ready {
    uint8_t address;
    uint8_t reg;
    uint8_t mask;
};

// A driver keeps its own state struct and gives these functions over it.
struct sensor_driver {
    // Starts set-up over from the reset of the chip.
    void (*begin)(void *state);
    // Does one step of set-up, one or a few transactions; SENSOR_OK once samples flow.
    // On a failure call begin() again, after the bus has been recovered.
    enum sensor_result (*setup)(void *state, const IN_FLASH struct bus_device *bus,
                                uint32_t now_us);
    // Turns the bytes of a sample's bursts, which follow each other, into that sample;
    // fills everything but has_gap, which it sets where the chip reports that samples
    // were overwritten unread. False where they can't be a reading: then nothing is
    // written.
    bool (*parse)(void *state, const uint8_t *bytes, uint32_t time_us,
                  struct sample *out);
    // Looks after the sensor: about once a second while samples flow, between two
    // bursts. One or a few transactions, 0.4 ms at most. SENSOR_OK and SENSOR_BUSY: all
    // is well; a failure as set-up has it.
    enum sensor_result (*check)(void *state, const IN_FLASH struct bus_device *bus);
    void *state;
    // Within the state, and constant once set-up is done: the sensor's identity, and
    // the transfers that make one sample, at most SENSOR_BURSTS_MAX. Together these
    // have BUS_BURST_MAX bytes at most. One of length 0 ends them.
    const struct sensor_identity *identity;
    const struct bus_burst *bursts;
    uint8_t bursts_count;
#ifndef ACQUISITION_WIRED_ONLY
    // For a board without a data-ready wire; null: the driver does not tell it yet.
    const struct sensor_ready *ready;
    // The sensor that may be there in place of this one, if it does not answer; null:
    // none is.
    const IN_FLASH struct sensor_driver *or_else;
#endif
};

#ifdef ACQUISITION_WIRED_ONLY
#define SENSOR_READY(at)
#else
#define SENSOR_READY(at) .ready = (at),
#endif

#endif
