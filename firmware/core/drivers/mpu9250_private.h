// SPDX-License-Identifier: MIT
// Shared by the files of the MPU-9250's driver.
//
//   mpu9250_setup.c  set-up and self-test of the chip and of its AK8963, and looking
//                    after them; begins with what mpu9250.c knows
//   mpu9250.c        properties of the chip, bursts to samples
//
// Documents: RM = RM-MPU-9250A-00 rev 1.6 (registers, by their decimal number), PS =
// PS-MPU-9250A-01 rev 1.0, AN = AN-MPU-9250A-03 rev 1.0 (self-test), AK = AK8963 data
// sheet MS1356-E-02.
#ifndef MPU9250_PRIVATE_H
#define MPU9250_PRIVATE_H

#include "core/drivers/mpu9250.h"
#include "core/math/in_flash.h"

enum {
    MPU9250_REG_ACCEL_XOUT_H = 0x3B,  // RM 59 to 72: acc, temperature, gyr, big-endian;
                                      // then EXT_SENS_DATA (RM 73)
    MPU9250_INERTIAL_BYTES = 14,
    MPU9250_TEMPERATURE_PLACE = 6,  // among these bytes
    MPU9250_GYR_PLACE = 8,
    MPU9250_MAG_BYTES = 8,  // ST1, three axes little-endian, ST2
};

// The identity before the chip answers. In another file than set-up, or the compiler
// would store it field by field.
extern const IN_FLASH struct sensor_identity mpu9250_known;

// Three axes; true where one is at the end of its range.
bool mpu9250_take_axes(const uint8_t *bytes, int16_t *out);

// The AK8963 answers: its block is in the burst.
static inline bool mpu9250_has_mag(const struct mpu9250 *chip) {
    return chip->bursts[0].length > MPU9250_INERTIAL_BYTES;
}

// Two bytes, the upper one first.
static inline int16_t mpu9250_word(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[0] * 256u + bytes[1]);
}

#endif
