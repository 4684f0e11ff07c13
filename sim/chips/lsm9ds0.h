// SPDX-License-Identifier: MIT
// A model of the LSM9DS0, byte by byte on I2C, written from its data sheet. The virtual
// boards and the driver's tests use it; it depends on no emulator and no driver.
//
// Documents: DS = LSM9DS0 data sheet, DocID024763 rev 2 (registers are named as there);
// AN = ST's application notes on related parts, which say more about the same blocks:
// AN4505 (L3GD20) and AN3393 (L3G4200D) for the gyroscope, AN3308 (LIS3DH) for status
// and data-ready.
//
// The chip has two dies on one wire, each with its own address, clock and registers: G,
// the gyroscope, and XM, accelerometer and magnetometer.
//
// The model asks for motion in the axes of accelerometer and gyroscope (x, y along the
// package, z out of it) and converts it to those of the magnetometer.
//
// Open points of the documents, and the model's choice:
// - Delay of the low-pass filters: the model has a moving average that ends now and has
//   the bandwidth set, hence a delay of 0.22 / bandwidth. A Butterworth filter of
//   second order has 0.225.
// - Length of a magnetic measurement: the model takes the field at its end.
// - Turn-on of the gyroscope: it reads zero for gyr_turn_on_ns. The default of 250 ms
// is
//   a guess, rather too long than too short.
// - A reboot lasts as long as start-up, brings no samples, and keeps the user's
//   registers.
// - Beyond its full scale an output goes on to the ends of 16 bits.
// - Temperature reads zero at 25 degC and is measured with the magnetic field (DS table
//   4: its rate is M_ODR).
// - The magnetometer's z axis points into the package, as in drivers that were tried on
//   parts (RTIMULib, Snowcap's). mag_sign in the configuration sets it.
// - INT_CTRL_REG_M is 0xE8 after reset, as parts read; the description of its bits
// gives
//   0. int_ctrl_reg_m in the configuration sets it.
// - The bandwidth that BW sets holds with LPF2 (Out_Sel) and without.
//
// Not modelled: noise (so M_RES changes nothing), and what no firmware here uses:
// single measurements, low power of the magnetometer, big-endian data, FIFO modes other
// than bypass, high-pass filters, interrupt generators, clicks, activity, INT_G,
// magnetic offsets, SPI. Turning one on is reported (sensor_chip_complaint), as is what
// the data sheet forbids.
#ifndef SIM_CHIPS_LSM9DS0_H
#define SIM_CHIPS_LSM9DS0_H

#include <stdbool.h>
#include <stdint.h>

#include "sensor_chip.h"

enum lsm9ds0_chip_pin {
    LSM9DS0_CHIP_DRDY_G,
    LSM9DS0_CHIP_INT1_XM,
    LSM9DS0_CHIP_INT2_XM,
};

// Of a fault, and on the wire.
enum lsm9ds0_chip_die { LSM9DS0_CHIP_BOTH, LSM9DS0_CHIP_G, LSM9DS0_CHIP_XM };

struct lsm9ds0_chip_config {
    struct sensor_chip_config sensor;  // startup_ns is the length of a reboot too
    double g_rate_error_ppm;           // of the gyroscope's clock; positive is fast
    double xm_rate_error_ppm;          // of the clock of accelerometer and magnetometer
    double temperature_zero_c;         // where OUT_TEMP reads 0
    uint64_t gyr_turn_on_ns;           // from power-down until readings are good
    uint8_t who_am_i_g;                // 0xD4
    uint8_t who_am_i_xm;               // 0x49
    uint8_t int_ctrl_reg_m;            // at reset
    int8_t mag_sign[3];           // of each axis of the magnetometer against the others
    bool sa0_g;                   // level of the pin: address 0x6A or 0x6B
    bool sa0_xm;                  // 0x1E or 0x1D
    double gyr_self_test_dps[3];  // response of each axis, at 2000 deg/s
    double acc_self_test_mg[3];   // response of each axis
};

// A plain LSM9DS0: no rate errors, 25 degC, 10 ms start-up (AN4505: boot procedure),
// both SA0 pins high, self-test responses in the middle of DS table 3.
struct lsm9ds0_chip_config lsm9ds0_chip_defaults(void);

// A chip whose power comes at time 0. Null where memory is out. The byte after an
// address is the sub-address: bit 7 has it move on with each byte.
struct sensor_chip *lsm9ds0_chip_new(const struct lsm9ds0_chip_config *config);

#endif
