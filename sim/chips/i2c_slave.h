// SPDX-License-Identifier: MIT
// A chip with registers as a slave on the I2C wire: START, address, register number,
// bytes, STOP, and the faults of chip and wire. What the registers do is the model's
// business, reached through struct i2c_slave_chip. One chip may hold several dies, each
// with an address of its own.
//
// Time is in nanoseconds since power came and never goes back.
#ifndef SIM_CHIPS_I2C_SLAVE_H
#define SIM_CHIPS_I2C_SLAVE_H

#include <stdbool.h>
#include <stdint.h>

#include "chip_fault.h"

enum { I2C_SLAVE_FAULTS_MAX = 32, I2C_SLAVE_NOBODY = 0 };

// The functions of a model for its wire. `chip` is the model, `die` the number, from 1,
// that find_die() gave.
struct i2c_slave_chip {
    // The die that answers to a 7-bit address, or I2C_SLAVE_NOBODY.
    uint8_t (*find_die)(void *chip, uint8_t address);
    // The first byte that is written after the address: the register's number.
    void (*set_pointer)(void *chip, uint8_t die, uint8_t byte);
    void (*write)(void *chip, uint8_t die, uint8_t byte);
    uint8_t (*read)(void *chip, uint8_t die);
    // Before the first START and after the STOP of a transaction; null: nothing to do.
    void (*idle)(void *chip);
    // Whether the chip holds SDA low for a reason of its own, and one pulse on SCL
    // meanwhile; null: it never does.
    bool (*holds_sda)(void *chip);
    void (*clock)(void *chip);
};

// A fault and how far it has come.
struct i2c_slave_fault {
    struct chip_fault fault;
    unsigned clocks;        // STUCK_SDA: SCL pulses seen while it holds the line
    uint64_t held_from_ns;  // STUCK_SDA: UINT64_MAX where it has not held it yet
    bool is_over;  // STUCK_SDA: has let go permanently; what happens once: has happened
};

// Private to i2c_slave.c, except where comments name the model.
struct i2c_slave {
    const struct i2c_slave_chip *ops;
    void (*advance)(void *chip, uint64_t now_ns);  // sets now_ns of the slave
    void *chip;
    struct i2c_slave_fault faults[I2C_SLAVE_FAULTS_MAX];
    unsigned fault_count;
    uint64_t now_ns;      // the model's time: the model sets it
    uint64_t answers_ns;  // no answer before then: the model sets it
    uint64_t transactions;
    bool is_transfer;  // between START and STOP
    bool is_read;
    bool has_pointer;
    uint8_t die;    // addressed by the host, or I2C_SLAVE_NOBODY
    uint64_t byte;  // of this transaction; the address is 0
};

// No die is addressed any more: the chip was reset, by itself or by loss of power.
void i2c_slave_release(struct i2c_slave *slave);
bool i2c_slave_is_addressed(const struct i2c_slave *slave);

// Takes the place of one that is past. False where I2C_SLAVE_FAULTS_MAX are not.
bool i2c_slave_add_fault(struct i2c_slave *slave, const struct chip_fault *fault);
void i2c_slave_clear_faults(struct i2c_slave *slave);
// An active fault of that kind on a die (0: whichever it is of); null: none.
const struct chip_fault *i2c_slave_find_fault(const struct i2c_slave *slave,
                                              enum chip_fault_kind kind, uint8_t die);
// One of those that happen once, if its time has come and it has not happened: then it
// has now; null: none.
const struct chip_fault *i2c_slave_next_fault(struct i2c_slave *slave,
                                              enum chip_fault_kind kind);

// The wire, from the host's side. start() is also a repeated START; it and write() are
// true for ACK. read() gets whether the host acknowledges the byte.
bool i2c_slave_start(struct i2c_slave *slave, uint64_t now_ns, uint8_t address,
                     bool is_read);
bool i2c_slave_write(struct i2c_slave *slave, uint64_t now_ns, uint8_t byte);
uint8_t i2c_slave_read(struct i2c_slave *slave, uint64_t now_ns, bool ack);
void i2c_slave_stop(struct i2c_slave *slave, uint64_t now_ns);
// True while the chip holds SDA low: then no START and no STOP can be made.
bool i2c_slave_holds_sda(struct i2c_slave *slave, uint64_t now_ns);
// One pulse on SCL from a host that works the pins by hand.
void i2c_slave_scl_pulse(struct i2c_slave *slave, uint64_t now_ns);

// A whole transaction from *now_ns on at 400 kHz; moves *now_ns to its end. `reg` is
// the byte after the address. 0: done, -1: refused (NACK), -3: SDA is held low. After
// -1 the STOP has been made.
int i2c_slave_read_registers(struct i2c_slave *slave, uint64_t *now_ns, uint8_t address,
                             uint8_t reg, uint8_t *data, uint8_t length);
int i2c_slave_write_registers(struct i2c_slave *slave, uint64_t *now_ns,
                              uint8_t address, uint8_t reg, const uint8_t *data,
                              uint8_t length);

#endif
