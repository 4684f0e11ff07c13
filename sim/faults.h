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
//   no_ak8963        MPU-9250: the magnetometer's die is missing
//   no_mag           LSM9DS0: the magnetometer measures nothing
//   gyr_self_test, acc_self_test   a tenth of the response
//   frozen           data ready goes on, the numbers stand still
// LSM9DS0: nack, no_data_ready, wrong_who_am_i and frozen are of both dies, or of the
// `die` 1 (G) or 2 (XM).
// kind of the board (at_us):
//   reset            the reset button
//   brown_out        a dip of the supply: resets processor and sensor, SRAM is lost
//   power_cut        the run ends there; also at write number `write` (from 1) to what
//                    survives power, EEPROM or flash, `after_us` into it
//   crystal          STM32F405: the crystal dies, or never starts
//   glitch           STM32F405: SDA is pulled within a byte, a misplaced START
// Times are device time; at_us 0 is from power-up on.
#ifndef SIM_FAULTS_H
#define SIM_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

enum fault_target {
    FAULT_CHIP,
    FAULT_RESET,
    FAULT_BROWN_OUT,
    FAULT_POWER_CUT,
    FAULT_CRYSTAL,
    FAULT_GLITCH,
};

// A fault of the sensor, whichever it is: see the chip's own header.
struct chip_fault {
    unsigned kind;  // index in struct fault_kinds
    uint8_t die;
    uint64_t from_ns, for_ns;
    uint64_t first, transactions;
    uint8_t at_byte, clocks, value;
};

// What a board can suffer.
struct fault_kinds {
    const char *const *chip;  // names
    unsigned chip_count;
    bool has_dies;
    bool is_stm32;  // crystal, glitch
};

struct fault {
    enum fault_target target;
    uint64_t at_us;
    uint64_t after_us;
    uint64_t write;
    struct chip_fault chip;  // for_ns is set, from_ns is not
};

enum { FAULTS_MAX = 32 };

struct faults {
    const struct fault_kinds *kinds;
    struct fault list[FAULTS_MAX];
    unsigned count;
    char problem[160];
};

// False with `problem` saying what and where.
bool faults_load(struct faults *faults, const char *path,
                 const struct fault_kinds *kinds);

#endif
