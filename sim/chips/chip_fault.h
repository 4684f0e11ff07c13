// SPDX-License-Identifier: MIT
// A fault of a sensor on the I2C bus, the same for every model.
#ifndef SIM_CHIPS_CHIP_FAULT_H
#define SIM_CHIPS_CHIP_FAULT_H

#include <stdint.h>

enum chip_fault_kind {
    CHIP_FAULT_NACK,            // refuses a byte, whose number is at_byte
    CHIP_FAULT_STUCK_SDA,       // holds SDA low, until `clocks` SCL pulses or the end
    CHIP_FAULT_NO_DATA_READY,   // takes no samples, gives no interrupts
    CHIP_FAULT_WRONG_WHO_AM_I,  // answers `value`
    // MPU-9250: no answer at 0x0C, on either bus. LSM9DS0: the magnetometer
    // measures nothing. LIS3MDL: it answers no more.
    CHIP_FAULT_NO_MAG,
    CHIP_FAULT_GYR_SELF_TEST,  // a tenth of the gyroscope's self-test response
    CHIP_FAULT_ACC_SELF_TEST,  // a tenth of the accelerometer's
    CHIP_FAULT_FROZEN,         // data ready continues, the readings don't change
    // These three happen once, when their time comes.
    CHIP_FAULT_REGISTER_FLIP,  // register `reg` becomes `value`
    CHIP_FAULT_BROWN_OUT,      // the chip alone loses its power for a moment
    // MPU-9250: the AK8963 holds the data line of its bus low, until `clocks` SCL
    // pulses through the bypass (0: for ever).
    CHIP_FAULT_MAG_HUNG,
    CHIP_FAULT_MAG_IDLE,  // MPU-9250: the AK8963 answers, and ends no measurement
};

// Active for a span of time, or, where transactions is not 0, for that many
// transactions of the host from number `first` on. The first one after power-up is
// number 1; everything from START to STOP is one transaction, whichever chip is
// addressed.
struct chip_fault {
    enum chip_fault_kind kind;
    // LSM9DS0: NACK, NO_DATA_READY, WRONG_WHO_AM_I, FROZEN and REGISTER_FLIP are of
    // this die (enum lsm9ds0_chip_die) or, with 0, of both. MPU-9250: 0.
    uint8_t die;
    uint64_t from_ns;
    uint64_t for_ns;  // 0: for ever (STUCK_SDA with clocks: until clocked out)
    uint64_t first;
    uint64_t transactions;
    uint8_t at_byte;  // NACK, STUCK_SDA: of the transaction; 0 address, 1 register
    uint8_t clocks;   // STUCK_SDA, MAG_HUNG: SCL pulses that free the line, 0: none do
    uint8_t reg;      // REGISTER_FLIP
    // WRONG_WHO_AM_I, REGISTER_FLIP. NO_DATA_READY, but of the MPU-9250: of the
    // sensor enum chip_quantity + 1 alone; 0: of all.
    uint8_t value;
};

#endif
