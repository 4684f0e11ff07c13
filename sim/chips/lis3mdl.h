// SPDX-License-Identifier: MIT
// A model of the LIS3MDL, byte by byte on I2C, written from its maker's documents. The
// virtual boards and the driver's tests use it; it depends on no emulator and no
// driver.
//
// Documents: DS = LIS3MDL data sheet, DocID024204 rev 4, as others quote its tables; AN
// = ST's application note AN4602 rev 1, likewise; AD = Adafruit's library
// Adafruit_LIS3MDL; LX = Linux, drivers/iio/magnetometer/st_magn_core.c; AN3308
// (LIS3DH) has more about status and data-ready of the same block. "Memory" beside a
// number: DS, not at hand.
//
// Time is an argument, in nanoseconds since power came, and never goes back. The model
// asks for the field in the board's axes, right-handed, in uT, and converts it to its
// own (axes in the configuration).
//
// Open points of the documents, and the model's choice:
// - A measurement is the mean over as long as it takes (1 / FAST_ODR's rate), and data
//   are ready at its end. After power-down, or where settings change, the first one
//   comes after AN's start-up time, at the earliest.
// - The rate of FAST_ODR is that of OM, the mode of X and Y, for each OMZ.
// - From power-up until registers answer: 10 ms; as long as a REBOOT takes, in which
//   there are no samples and registers stay. SOFT_RST takes soft_reset_ns.
// - The flags of an axis go as its high byte is read, ZYXDA and ZYXOR as the last one
//   was; a sample behind a word that BDU holds shows, and is flagged, once both halves
//   have been read.
// - After a single measurement MD reads power-down (11).
// - Beyond its full scale an output goes on to the ends of 16 bits.
// - Temperature is measured with the field, in steps of 1/8 degC.
//
// Not modelled: noise and offsets, which the motion has (`imud sim --module`);
// FAST_READ, interrupts by threshold (INT), SPI. Turning one on is reported
// (lis3mdl_chip_complaint), like a use that the data sheet forbids.
#ifndef SIM_CHIPS_LIS3MDL_H
#define SIM_CHIPS_LIS3MDL_H

#include <stdbool.h>
#include <stdint.h>

#include "chip_motion.h"
#include "i2c_slave.h"

struct lis3mdl_chip_config {
    chip_motion_function motion;  // null: the motion is that of lis3mdl_chip_hold()
    void *context;
    double rate_error_ppm;  // of its clock; positive is fast
    double temperature_c;
    double temperature_error_c;
    uint64_t startup_ns;     // from power-up until registers answer, and of a REBOOT
    uint64_t soft_reset_ns;  // how long SOFT_RST takes
    uint8_t who_am_i;        // 0x3D
    uint8_t int_cfg;         // INT_CFG at reset
    bool sa1;                // level of the pin: address 0x1C or 0x1E
    int8_t axes[3];  // its x, y, z: 1, 2, 3 for the board's x, y, z, or negative
    double self_test_ut[3];  // response of each of its axes
};

struct lis3mdl_chip;

// A plain LIS3MDL: no rate error, 25 degC, SA1 low, axes as the board's.
struct lis3mdl_chip_config lis3mdl_chip_defaults(void);

// A chip whose power comes at time 0. Null where memory is out.
struct lis3mdl_chip *lis3mdl_chip_new(const struct lis3mdl_chip_config *config);
void lis3mdl_chip_free(struct lis3mdl_chip *chip);
// Power goes and comes back at now_ns; faults stay.
void lis3mdl_chip_power_cycle(struct lis3mdl_chip *chip, uint64_t now_ns);

// The motion from now on where the configuration has no function. Before the first
// call: a field of (0, 20, -40) uT. Rate and acceleration are of no account.
void lis3mdl_chip_hold(struct lis3mdl_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]);
void lis3mdl_chip_set_temperature(struct lis3mdl_chip *chip, double temperature_c);

// Lets time pass; every other function with a time does so first.
void lis3mdl_chip_advance(struct lis3mdl_chip *chip, uint64_t now_ns);
// When something next happens by itself; UINT64_MAX where nothing will.
uint64_t lis3mdl_chip_next_event(const struct lis3mdl_chip *chip);
// The DRDY pin. It may also change with a byte on the wire.
bool lis3mdl_chip_drdy_is_high(const struct lis3mdl_chip *chip);

// The chip on the wire: its bytes, whole transactions, faults. The byte after an
// address is the sub-address: bit 7 has it move on with each byte. Its die is number 1.
// CHIP_FAULT_NO_MAG: it answers no more.
struct i2c_slave *lis3mdl_chip_wire(struct lis3mdl_chip *chip);

// For tests: a register with no side effects, transactions so far, samples so far, and
// the first thing the host did against the documents (null: nothing).
uint8_t lis3mdl_chip_peek(const struct lis3mdl_chip *chip, uint8_t reg);
uint64_t lis3mdl_chip_transactions(const struct lis3mdl_chip *chip);
uint64_t lis3mdl_chip_samples(const struct lis3mdl_chip *chip);
const char *lis3mdl_chip_complaint(const struct lis3mdl_chip *chip);

#endif
