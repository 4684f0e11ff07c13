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
// Time is an argument, in nanoseconds since power came, and never goes back. The model
// asks for motion in the axes of accelerometer and gyroscope (x, y along the package, z
// out of it), right-handed, in SI units, and converts it to those of the magnetometer.
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
// - After a single magnetic measurement MD reads power-down (10).
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
// Not modelled: noise (so M_RES changes nothing), FIFO modes other than bypass,
// high-pass filters, interrupt generators, clicks, activity, INT_G, magnetic offsets,
// SPI. Turning one on is reported (lsm9ds0_chip_complaint), as is what the data sheet
// forbids.
#ifndef SIM_CHIPS_LSM9DS0_H
#define SIM_CHIPS_LSM9DS0_H

#include <stdbool.h>
#include <stdint.h>

#include "chip_motion.h"
#include "i2c_slave.h"

enum lsm9ds0_chip_pin {
    LSM9DS0_CHIP_DRDY_G,
    LSM9DS0_CHIP_INT1_XM,
    LSM9DS0_CHIP_INT2_XM,
};

// Of a fault, and on the wire.
enum lsm9ds0_chip_die { LSM9DS0_CHIP_BOTH, LSM9DS0_CHIP_G, LSM9DS0_CHIP_XM };

struct lsm9ds0_chip_config {
    chip_motion_function motion;  // null: the motion is that of lsm9ds0_chip_hold()
    void *context;
    bool is_recorded;          // a sensor's low-pass is in the motion already
    double g_rate_error_ppm;   // of the gyroscope's clock; positive is fast
    double xm_rate_error_ppm;  // of the clock of accelerometer and magnetometer
    double temperature_c;
    double temperature_zero_c;  // where OUT_TEMP reads 0
    uint64_t startup_ns;      // from power-up until registers answer; a reboot's length
    uint64_t gyr_turn_on_ns;  // from power-down until readings are good
    uint8_t who_am_i_g;       // 0xD4
    uint8_t who_am_i_xm;      // 0x49
    uint8_t int_ctrl_reg_m;   // at reset
    int8_t mag_sign[3];       // of each axis of the magnetometer against the others
    bool sa0_g;               // level of the pin: address 0x6A or 0x6B
    bool sa0_xm;              // 0x1E or 0x1D
    double gyr_self_test_dps[3];  // response in each range: 245, 500, 2000 deg/s
    double acc_self_test_mg[3];   // response of each axis
};

struct lsm9ds0_chip;

// A plain LSM9DS0: no rate errors, 25 degC, 10 ms start-up (AN4505: boot procedure),
// both SA0 pins high, self-test responses in the middle of DS table 3.
struct lsm9ds0_chip_config lsm9ds0_chip_defaults(void);

// A chip whose power comes at time 0. Null where memory is out.
struct lsm9ds0_chip *lsm9ds0_chip_new(const struct lsm9ds0_chip_config *config);
void lsm9ds0_chip_free(struct lsm9ds0_chip *chip);
// Power goes and comes back at now_ns; faults stay.
void lsm9ds0_chip_power_cycle(struct lsm9ds0_chip *chip, uint64_t now_ns);

// The motion from now on where the configuration has no function. Before the first
// call: lying still, level, in a field of (0, 20, -40) uT.
void lsm9ds0_chip_hold(struct lsm9ds0_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]);
void lsm9ds0_chip_set_temperature(struct lsm9ds0_chip *chip, double temperature_c);

// Lets time pass; every other function with a time does so first.
void lsm9ds0_chip_advance(struct lsm9ds0_chip *chip, uint64_t now_ns);
// When something next happens by itself; UINT64_MAX where nothing will.
uint64_t lsm9ds0_chip_next_event(const struct lsm9ds0_chip *chip);
// The level of a pin (an open-drain one has its pull-up). It may also change with a
// byte on the wire: data-ready goes as the data are read.
bool lsm9ds0_chip_pin_is_high(const struct lsm9ds0_chip *chip,
                              enum lsm9ds0_chip_pin pin);

// The chip on the wire: its bytes, whole transactions, faults. The byte after an
// address is the sub-address: bit 7 has it move on with each byte.
struct i2c_slave *lsm9ds0_chip_wire(struct lsm9ds0_chip *chip);

// For tests: a register of either die with no side effects, transactions so far,
// samples of a quantity so far, and the first thing the host did against the documents
// (null: nothing).
uint8_t lsm9ds0_chip_peek_g(const struct lsm9ds0_chip *chip, uint8_t reg);
uint8_t lsm9ds0_chip_peek_xm(const struct lsm9ds0_chip *chip, uint8_t reg);
uint64_t lsm9ds0_chip_transactions(const struct lsm9ds0_chip *chip);
uint64_t lsm9ds0_chip_samples(const struct lsm9ds0_chip *chip,
                              enum chip_quantity quantity);
const char *lsm9ds0_chip_complaint(const struct lsm9ds0_chip *chip);

#endif
