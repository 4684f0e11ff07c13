// SPDX-License-Identifier: MIT
// In which registers and numbers the families of the LSM6DSOX and of the LSM6DSV16X
// differ, and the registers that both have.
#ifndef SIM_CHIPS_LSM6DSOX_FAMILY_H
#define SIM_CHIPS_LSM6DSOX_FAMILY_H

#include "../lsm6dsox.h"
#include "../sensor/st.h"

#define LSM6DSOX_HZ 6667.0  // its clock

enum {
    REG_COUNTER_BDR_REG1 = 0x0B,
    REG_INT1_CTRL = 0x0D,
    REG_INT2_CTRL = 0x0E,
    REG_WHO_AM_I = 0x0F,
    REG_CTRL1 = 0x10,  // of the accelerometer
    REG_CTRL2 = 0x11,  // of the gyroscope
    REG_CTRL3 = 0x12,
    REG_CTRL4 = 0x13,
    REG_CTRL5 = 0x14,
    REG_CTRL6 = 0x15,
    REG_CTRL7 = 0x16,
    REG_CTRL8 = 0x17,
    REG_CTRL9 = 0x18,
    REG_CTRL10 = 0x19,
    // INT1_CTRL
    INT_DRDY_XL = 1 << 0,
    INT_DRDY_G = 1 << 1,
    // CTRL3
    BDU = 1 << 6,
    IF_INC = 1 << 2,
    SW_RESET = 1 << 0,

    LSM6_RATES = 10,  // the clock divided by 512, 256 .. 1
};

struct lsm6_field {
    uint8_t reg, shift, mask;  // mask 0: the family has none
};

static inline int lsm6_field(const uint8_t *reg, struct lsm6_field field) {
    return (reg[field.reg] >> field.shift) & field.mask;
}

// Pairs are of the gyroscope and the accelerometer.
struct lsm6_family {
    const struct st_rule *rules;
    size_t rules_count;
    struct lsm6_field rate[2], mode[2], range[2], test[2];
    struct lsm6_field pulsed;  // data-ready
    struct lsm6_field rates;   // which set of them
    uint64_t pulse_ns;         // of data-ready
    double clock_hz[4];        // by the set
    uint8_t first_rate;        // code of the slowest; 0 is off
    double per_count[2][16];   // mdps, mg by the range; 0: there is none
    double gyr_response[16];   // the part of that at 2000 deg/s, by the range
    double sign[2][4];         // of the response, by the test; NAN: forbidden
    bool stays_in_operation;   // a running sensor's range and set of rates
    uint8_t fine;              // register of the clock's trim
    double fine_ppm;           // and its step
    uint8_t pin_ctrl, ctrl9;   // after a reset
};

#endif
