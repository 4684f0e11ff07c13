// SPDX-License-Identifier: MIT
// An LSM9DS0 as its data sheet describes it, byte by byte on I2C. It serves the virtual
// boards and the driver's tests; it knows no emulator and no driver.
//
// Documents: DS = LSM9DS0 data sheet, DocID024763 rev 2 (registers are named as there);
// AN = ST's application notes on parts of the family that say more of the same blocks:
// AN4505 (L3GD20) and AN3393 (L3G4200D) for the gyroscope, AN3308 (LIS3DH) for status
// and data-ready.
//
// Two dies on one wire, each with an address, a clock and registers of its own: G, the
// gyroscope, and XM, accelerometer and magnetometer.
//
// Time is an argument, in nanoseconds since power came, and never goes back. Motion is
// asked for in the axes of accelerometer and gyroscope (x, y along the package, z out
// of it), right-handed, SI units; the magnetometer's own axes are the model's business.
//
// What the documents leave open, and what the model does:
// - Delay of the low-pass filters: none is given. A moving average of the bandwidth in
//   force that ends now, so 0.22 / bandwidth: a Butterworth of second order has 0.225.
// - Length of a magnetic measurement: the field of the instant that it ends.
// - Turn-on of the gyroscope: zeros for gyr_turn_on_ns; its 250 ms are a guess to the
//   safe side.
// - A reboot: as long as start-up, no samples meanwhile, and the user's registers stay.
// - After a single magnetic measurement: MD reads power-down (10).
// - Where an output stops beyond its full scale: at the ends of 16 bits.
// - Zero of the temperature: 25 degC; fresh with each magnetic measurement (DS table 4:
//   its rate is M_ODR).
// - Axes of the magnetometer: its z points into the package, as drivers that were tried
//   on parts have it (RTIMULib, Snowcap's). mag_sign of the configuration chooses.
// - Reset value of INT_CTRL_REG_M: 0xE8, which parts read; the description of its bits
//   gives 0. int_ctrl_reg_m of the configuration chooses.
// - Which low-pass BW sets: its bandwidth is in force with LPF2 (Out_Sel) and without.
//
// Not modelled: noise (so M_RES changes nothing), FIFO but bypass, high-pass filters,
// interrupt generators, clicks, activity, INT_G, magnetic offsets, SPI. Turning one on
// is a complaint (lsm9ds0_chip_complaint), as is what the data sheet forbids.
#ifndef SIM_CHIPS_LSM9DS0_H
#define SIM_CHIPS_LSM9DS0_H

#include <stdbool.h>
#include <stdint.h>

#include "i2c_slave.h"

enum lsm9ds0_chip_quantity {
    LSM9DS0_CHIP_GYR,  // rad/s
    LSM9DS0_CHIP_ACC,  // m/s2, specific force: +g on z when lying level
    LSM9DS0_CHIP_MAG,  // uT
};

enum lsm9ds0_chip_pin {
    LSM9DS0_CHIP_DRDY_G,
    LSM9DS0_CHIP_INT1_XM,
    LSM9DS0_CHIP_INT2_XM,
};

// Of a fault, and on the wire.
enum lsm9ds0_chip_die { LSM9DS0_CHIP_BOTH, LSM9DS0_CHIP_G, LSM9DS0_CHIP_XM };

// Writes the mean of the quantity over (from_ns, to_ns] to mean; where both are equal,
// its value then. from_ns may be negative.
typedef void (*lsm9ds0_chip_motion)(void *context, enum lsm9ds0_chip_quantity quantity,
                                    int64_t from_ns, int64_t to_ns, double mean[3]);

struct lsm9ds0_chip_config {
    lsm9ds0_chip_motion motion;  // null: what lsm9ds0_chip_hold() said
    void *context;
    bool is_recorded;         // the motion has been through a sensor's low-pass already
    double g_rate_error_ppm;  // of the gyroscope's clock; positive is fast
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

static inline bool lsm9ds0_chip_start(struct lsm9ds0_chip *chip, uint64_t now_ns,
                                      uint8_t address, bool is_read) {
    return i2c_slave_start(lsm9ds0_chip_wire(chip), now_ns, address, is_read);
}

static inline bool lsm9ds0_chip_write(struct lsm9ds0_chip *chip, uint64_t now_ns,
                                      uint8_t byte) {
    return i2c_slave_write(lsm9ds0_chip_wire(chip), now_ns, byte);
}

static inline uint8_t lsm9ds0_chip_read(struct lsm9ds0_chip *chip, uint64_t now_ns,
                                        bool ack) {
    return i2c_slave_read(lsm9ds0_chip_wire(chip), now_ns, ack);
}

static inline void lsm9ds0_chip_stop(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    i2c_slave_stop(lsm9ds0_chip_wire(chip), now_ns);
}

static inline void lsm9ds0_chip_scl_pulse(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    i2c_slave_scl_pulse(lsm9ds0_chip_wire(chip), now_ns);
}

static inline bool lsm9ds0_chip_holds_sda(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    return i2c_slave_holds_sda(lsm9ds0_chip_wire(chip), now_ns);
}

// For tests: a register of either die with no side effects, transactions so far,
// samples of a quantity so far, and the first thing the host did against the documents
// (null: nothing).
uint8_t lsm9ds0_chip_peek_g(const struct lsm9ds0_chip *chip, uint8_t reg);
uint8_t lsm9ds0_chip_peek_xm(const struct lsm9ds0_chip *chip, uint8_t reg);
uint64_t lsm9ds0_chip_transactions(const struct lsm9ds0_chip *chip);
uint64_t lsm9ds0_chip_samples(const struct lsm9ds0_chip *chip,
                              enum lsm9ds0_chip_quantity quantity);
const char *lsm9ds0_chip_complaint(const struct lsm9ds0_chip *chip);

#endif
