// SPDX-License-Identifier: MIT
// What shall go wrong, from a file: a JSON list of flat objects.
//
//   [{"kind": "nack", "at_us": 2000000, "for_us": 50000},
//    {"kind": "stuck_sda", "transaction": 700, "byte": 3, "clocks": 5},
//    {"kind": "power_cut", "write": 12, "after_us": 900}]
//
// kind of the sensor (all may have at_us with for_us, 0 being for ever, or transaction
// with transactions, by default 1):
//   nack             refuses byte `byte` of its transactions (default 0: the address)
//   stuck_sda        holds SDA low, until `clocks` SCL pulses (default: none) or for_us
//   no_data_ready    no samples, no interrupts
//   wrong_who_am_i   answers `value`
//   no_ak8963        the magnetometer's die is missing
//   gyr_self_test, acc_self_test   a tenth of the response
//   frozen           data ready goes on, the numbers stand still
// kind of the board (at_us):
//   reset            the reset button
//   brown_out        a dip of the supply: resets processor and sensor, SRAM is lost
//   power_cut        the run ends there; also at EEPROM write number `write` (from 1),
//                    `after_us` into it
// Times are device time; at_us 0 is from power-up on.
#ifndef SIM_FAULTS_H
#define SIM_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "chips/mpu9250.h"

enum fault_target { FAULT_CHIP, FAULT_RESET, FAULT_BROWN_OUT, FAULT_POWER_CUT };

struct fault {
    enum fault_target target;
    uint64_t at_us;
    uint64_t after_us;
    uint64_t write;
    struct mpu9250_chip_fault chip;  // for_ns is set, from_ns is not
};

enum { FAULTS_MAX = MPU9250_CHIP_FAULTS_MAX };

struct faults {
    struct fault list[FAULTS_MAX];
    unsigned count;
    char problem[160];
};

// False with `problem` saying what and where.
bool faults_load(struct faults *faults, const char *path);
bool faults_parse(struct faults *faults, const char *text);

#endif
