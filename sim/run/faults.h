// SPDX-License-Identifier: MIT
// Faults of a run, read from a file: a JSON list of flat objects.
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
//   no_mag           LSM9DS0: the magnetometer measures nothing. LIS3MDL: it answers
//                    no more
//   gyr_self_test, acc_self_test   a tenth of the response
//   frozen           data ready continues, the numbers stand still
//   register_flip    register `reg` becomes `value`, once
//   sensor_brown_out the sensor alone loses its power for a moment, once
//   mag_hung         MPU-9250: the AK8963 holds its bus, until `clocks` SCL pulses
//                    through the bypass (default: for ever)
//   mag_idle         MPU-9250: the AK8963 answers, and ends no measurement
// LSM9DS0: nack, no_data_ready, wrong_who_am_i, frozen and register_flip are of both
// dies, or of the `die` 1 (G) or 2 (XM). LSM6DSOX and LIS3MDL: the same, and
// sensor_brown_out, 1 being the LSM6DSOX and 2 the LIS3MDL; stuck_sda is of the first
// unless it is of die 2.
// kind of the board (at_us):
//   reset            the reset button
//   brown_out        a dip of the supply: resets processor and sensor, SRAM is lost
//   power_cut        the run ends there; also at write number `write` (from 1) to what
//                    survives power, EEPROM or flash, `after_us` into it
//   crystal          STM32F405: the crystal dies, or never starts
//   glitch           STM32F405: SDA is pulled within a byte, a misplaced START
//   spurious_berr    STM32F405: I2C1 reports a bus error that did not happen
//   battery          STM32F405: the cell has `mv`, going to `to_mv` within for_us
//   charger          STM32F405: `value` bit 0 external power good, bit 1 charging
// kind of the radio, where there is one (at_us, for_us, 0 being for ever):
//   radio_drop       the link is lost; the host is back once it is over
//   radio_away       no host comes; one that is there stays
//   radio_deaf       hears and says nothing on its UART
//   radio_reset      restarts by itself (at_us alone)
// kind of the card of a board that has one (at_us with for_us, 0 being for ever, or
// some of the data blocks that come: `card_writes`, by default 1, from number
// `card_write` on, the first ever being 1):
//   card_pulled      out of its socket, then back in; at_us with for_us, or for_us from
//                    `after_us` into the programming of block `card_write` on
//   card_slow        each busy that begins lasts `ms` (by default 250)
//   card_crc         rejects blocks with "CRC error"
//   card_error       rejects blocks with "write error"
//   card_worn        `blocks` (by default 1) from `block` of the card on: `value` 0
//                    rejects, 1 says yes and keeps what was there, 2 can't be read
//   card_dead        answers nothing; times as of card_pulled
//   power_cut        also at data block `card_write`, `after_us` into its programming
// Times are device time; at_us 0 is from power-up on.
#ifndef SIM_RUN_FAULTS_H
#define SIM_RUN_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "chips/chip_fault.h"

enum fault_target {
    FAULT_CHIP,
    FAULT_CARD,
    FAULT_RESET,
    FAULT_BROWN_OUT,
    FAULT_POWER_CUT,
    FAULT_CRYSTAL,
    FAULT_GLITCH,
    FAULT_SPURIOUS_BERR,
    FAULT_BATTERY,
    FAULT_CHARGER,
    FAULT_RADIO,
};

// Of FAULT_RADIO.
enum fault_radio { RADIO_DROP, RADIO_AWAY, RADIO_DEAF, RADIO_RESET };

// A fault of the card: see its own header.
struct card_fault {
    unsigned kind;  // index in struct fault_kinds
    uint64_t from_ns, for_ns;
    uint64_t first, count, after_ns;
    uint64_t block, blocks;
    uint32_t ms;
    uint8_t value;
};

// A kind of fault by its name in the file.
struct fault_kind {
    const char *name;
    enum fault_target target;
    enum fault_radio radio;  // of FAULT_RADIO
};

// The kinds of faults that a board supports.
struct fault_kinds {
    const char *no_mag;       // name of CHIP_FAULT_NO_MAG
    const char *const *card;  // names of the card's faults; null: no card
    unsigned card_count;
    bool has_dies;
    bool has_aux_bus;  // an MPU-9250's, to its magnetometer
    // Kinds of this board alone.
    const struct fault_kind *own;
    unsigned own_count;
};

struct fault {
    enum fault_target target;
    uint64_t at_us;
    uint64_t after_us;
    uint64_t write;
    uint64_t card_write;
    enum fault_radio radio;
    uint32_t mv, to_mv;
    bool has_to_mv;
    struct chip_fault chip;  // for_ns is set, from_ns is not
    struct card_fault card;  // the same
};

enum {
    FAULTS_MAX = 4096,
    FAULTS_RARE_MAX = 32,  // of the card and of the radio, each
    FAULT_MV_MAX = 6600,   // halved by the divider: what the pin stands
};

struct faults {
    const struct fault_kinds *kinds;
    struct fault list[FAULTS_MAX];
    unsigned count;
    char problem[160];
};

// Of a board with one of the modules of chips/module.h.
const struct fault_kinds *faults_of_module(const char *name);

// Reads the file. False with the reason and place in `problem`.
bool faults_load(struct faults *faults, const char *path,
                 const struct fault_kinds *kinds);

#endif
