// SPDX-License-Identifier: MIT
// What the files of the MPU-9250's driver share.
//
//   mpu9250.c      the steps of set-up, the inertial self-test, bursts to samples
//   mpu9250_mag.c  the AK8963: its set-up, its self-test, its readings
//
// Documents: RM = RM-MPU-9250A-00 rev 1.6 (registers, by their decimal number), PS =
// PS-MPU-9250A-01 rev 1.0, AN = AN-MPU-9250A-03 rev 1.0 (self-test), AK = AK8963 data
// sheet MS1356-E-02.
#ifndef MPU9250_PRIVATE_H
#define MPU9250_PRIVATE_H

#include "core/drivers/mpu9250.h"

enum {
    MPU9250_REG_ACCEL_XOUT_H = 0x3B,  // RM 59 to 72: acc, temperature, gyr, big-endian;
                                      // then EXT_SENS_DATA (RM 73)
    MPU9250_INERTIAL_BYTES = 14,
    MPU9250_GYR_PLACE = 8,      // among them
    MPU9250_MAG_BYTES = 8,      // ST1, three axes little-endian, ST2
    MPU9250_SETTLE_TICKS = 21,  // AN 3: 20 ms after the stimulus, or a range, changes
};

// Of set-up, in this order.
enum mpu9250_step {
    MPU9250_POWER_UP,
    MPU9250_RESET,
    MPU9250_IDENTIFY,
    MPU9250_TEST_BEGIN,
    MPU9250_TEST_OFF,
    MPU9250_TEST_TURN,
    MPU9250_TEST_ON,
    MPU9250_TEST_END,
    MPU9250_MAG_BEGIN,
    MPU9250_MAG_TRANSFERS,
    MPU9250_RUN,
    MPU9250_READY,
    MPU9250_DONE,
};

// `now` and `wait` are ticks of 1.024 ms, in all that follows. A step that goes on
// returns SENSOR_BUSY.

// True where the registers from `reg` on were read, or written.
bool mpu9250_read(const struct bus_device *bus, uint8_t reg, uint8_t *data,
                  uint8_t length) MUST_CHECK;
bool mpu9250_write(const struct bus_device *bus, uint8_t reg, const uint8_t *data,
                   uint8_t length) MUST_CHECK;
bool mpu9250_write_one(const struct bus_device *bus, uint8_t reg,
                       uint8_t value) MUST_CHECK;

// Rate divider and both ranges, with the filters that all uses share.
bool mpu9250_configure(const struct bus_device *bus, uint8_t divider,
                       uint8_t ranges) MUST_CHECK;

// On to the next step, after a wait.
enum sensor_result mpu9250_go_on(struct mpu9250 *chip, uint16_t now, uint8_t wait);

// True for `wait` after the start of the wait in force.
bool mpu9250_is_within(const struct mpu9250 *chip, uint16_t now, uint8_t wait);

// mpu9250_mag.c

enum sensor_result mpu9250_mag_begin(struct mpu9250 *chip, const struct bus_device *bus,
                                     uint16_t now);
// One transfer by the chip's own I2C master, in two or more calls: asked for, then
// looked after.
enum sensor_result mpu9250_mag_transfer(struct mpu9250 *chip,
                                        const struct bus_device *bus, uint16_t now);
// Takes the AK8963's block of MPU9250_MAG_BYTES where it is a reading that was not
// there before. Needs the fields of `out` for it cleared.
void mpu9250_mag_parse(struct mpu9250 *chip, const uint8_t *block, struct sample *out);

#endif
