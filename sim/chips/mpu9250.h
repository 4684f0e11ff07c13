// SPDX-License-Identifier: MIT
// A model of the MPU-9250 and its AK8963, byte by byte on I2C, written from their
// documents. The virtual boards and the driver's tests use it; it depends on no
// emulator and no driver.
//
// Documents: RM = RM-MPU-9250A-00 rev 1.6 (register map), PS = PS-MPU-9250A-01 rev 1.0
// (product specification), ST = AN-MPU-9250A-03 (self-test), AK = AK8963 data sheet
// MS1356-E-02.
//
// Time is an argument, in nanoseconds since power came, and never goes back. The model
// asks for motion in the axes of accelerometer and gyroscope (PS 9.1: x right, y up the
// page, z out of the package), right-handed, in SI units, and converts it to the axes
// of the AK8963 (PS 9.1: its x is our y, its y our x, its z our -z).
//
// Not modelled: FIFO, DMP, wake on motion, low-power cycling, FSYNC, SPI. Writing to
// their registers is reported (mpu9250_chip_complaint).
#ifndef SIM_CHIPS_MPU9250_H
#define SIM_CHIPS_MPU9250_H

#include <stdbool.h>
#include <stdint.h>

#include "chip_motion.h"
#include "i2c_slave.h"

struct mpu9250_chip_config {
    chip_motion_function motion;  // null: the motion is that of mpu9250_chip_hold()
    void *context;
    bool is_recorded;           // a sensor's low-pass is in the motion already
    double rate_error_ppm;      // of the sample clock; positive is fast
    double mag_rate_error_ppm;  // of the AK8963's own clock
    double temperature_c;
    uint64_t startup_ns;       // from power-up or H_RESET until registers answer
    uint8_t who_am_i;          // 0x71; 0x70 is an MPU-6500
    bool has_ak8963;           // false is an MPU-6500
    bool ad0;                  // level of the pin: address 0x68 or 0x69
    uint8_t mag_adjust[3];     // ASAX, ASAY, ASAZ
    uint8_t gyr_self_test[3];  // factory codes, registers 0 to 2
    uint8_t acc_self_test[3];  // factory codes, registers 13 to 15
};

struct mpu9250_chip;

// A plain MPU-9250: no rate error, 25 degC, 100 ms start-up (PS 3.4.2, the maximum),
// ASA 176 178 166, self-test codes that a real part could have.
struct mpu9250_chip_config mpu9250_chip_defaults(void);

// A chip whose power comes at time 0. Null where memory is out.
struct mpu9250_chip *mpu9250_chip_new(const struct mpu9250_chip_config *config);
void mpu9250_chip_free(struct mpu9250_chip *chip);
// Power goes and comes back at now_ns; faults stay.
void mpu9250_chip_power_cycle(struct mpu9250_chip *chip, uint64_t now_ns);

// The motion from now on where the configuration has no function. Before the first
// call: lying still, level, in a field of (0, 20, -40) uT.
void mpu9250_chip_hold(struct mpu9250_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]);
void mpu9250_chip_set_temperature(struct mpu9250_chip *chip, double temperature_c);

// Lets time pass; every other function with a time does so first.
void mpu9250_chip_advance(struct mpu9250_chip *chip, uint64_t now_ns);
// When something next happens by itself; UINT64_MAX where nothing will.
uint64_t mpu9250_chip_next_event(const struct mpu9250_chip *chip);
// The INT pin (an open-drain one has its pull-up).
bool mpu9250_chip_int_is_high(const struct mpu9250_chip *chip);

// The chip on the wire: its bytes, whole transactions, faults.
struct i2c_slave *mpu9250_chip_wire(struct mpu9250_chip *chip);

// For tests: a register with no side effects, transactions so far, samples taken so
// far, and the first thing the host did against the documents (null: nothing).
uint8_t mpu9250_chip_peek(const struct mpu9250_chip *chip, uint8_t reg);
uint8_t mpu9250_chip_peek_ak8963(const struct mpu9250_chip *chip, uint8_t reg);
uint64_t mpu9250_chip_transactions(const struct mpu9250_chip *chip);
uint64_t mpu9250_chip_samples(const struct mpu9250_chip *chip);
const char *mpu9250_chip_complaint(const struct mpu9250_chip *chip);

#endif
