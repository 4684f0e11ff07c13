// SPDX-License-Identifier: MIT
// A model of the MPU-9250 and its AK8963, byte by byte on I2C, written from their
// documents. The virtual boards and the driver's tests use it; it depends on no
// emulator and no driver.
//
// Documents: RM = RM-MPU-9250A-00 rev 1.6 (register map), PS = PS-MPU-9250A-01 rev 1.0
// (product specification), ST = AN-MPU-9250A-03 (self-test), AK = AK8963 data sheet
// MS1356-E-02.
//
// The model asks for motion in the axes of accelerometer and gyroscope (PS 9.1: x
// right, y up the page, z out of the package) and converts it to the axes of the AK8963
// (PS 9.1: its x is our y, its y our x, its z our -z).
//
// Not modelled, because no firmware here uses it: FIFO, DMP, wake on motion, low-power
// cycling, FSYNC, SPI, offset registers; of its own I2C master all but reads by slave 0
// and single bytes by slave 4; of the AK8963 14 bits, 8 Hz and single measurements.
// Writing to their registers is reported (sensor_chip_complaint).
#ifndef SIM_CHIPS_MPU9250_H
#define SIM_CHIPS_MPU9250_H

#include <stdbool.h>
#include <stdint.h>

#include "sensor_chip.h"

// The two dies on the wire.
enum mpu9250_chip_die { MPU9250_CHIP_MPU = 1, MPU9250_CHIP_AK8963 };

struct mpu9250_chip_config {
    struct sensor_chip_config sensor;  // startup_ns is of H_RESET too
    double rate_error_ppm;             // of the sample clock; positive is fast
    double mag_rate_error_ppm;         // of the AK8963's own clock
    uint8_t who_am_i;                  // 0x71; 0x70 is an MPU-6500
    bool has_ak8963;                   // false is an MPU-6500
    bool ad0;                          // level of the pin: address 0x68 or 0x69
    uint8_t mag_adjust[3];             // ASAX, ASAY, ASAZ
    uint8_t gyr_self_test[3];          // factory codes, registers 0 to 2
    uint8_t acc_self_test[3];          // factory codes, registers 13 to 15
};

// A plain MPU-9250: no rate error, 25 degC, 100 ms start-up (PS 3.4.2, the maximum),
// ASA 176 178 166, self-test codes that a real part could have.
struct mpu9250_chip_config mpu9250_chip_defaults(void);

// A chip whose power comes at time 0; its pin is INT. Null where memory is out.
struct sensor_chip *mpu9250_chip_new(const struct mpu9250_chip_config *config);

#endif
