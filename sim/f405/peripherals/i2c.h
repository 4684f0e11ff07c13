// SPDX-License-Identifier: MIT
// I2C1, on whose wires is the sensor.
#ifndef SIM_F405_PERIPHERALS_I2C_H
#define SIM_F405_PERIPHERALS_I2C_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_i2c {
    uint32_t cr1, cr2, oar1, oar2, sr1, sr2, ccr, trise, fltr;
    uint8_t data, shift;
    uint8_t torn;  // of the byte being received: the bits before the sender dropped out
    bool is_data_full;   // to be sent
    bool is_shift_full;  // received, and the data register still full
    enum { BUS_IDLE, BUS_START, BUS_ADDRESS, BUS_SEND, BUS_RECEIVE, BUS_STOP } doing;
    bool is_reading;
    bool acks_next;   // with POS: ACK as it stood when the byte under way began
    bool is_busy;     // the bus looked busy, until a STOP or a reset
    bool is_refused;  // the other side has not acknowledged
    bool had_ack;     // we acknowledged the last byte received
    uint32_t seen;    // flags that the last read of SR1 showed
    // The lines when the firmware works them as pins.
    bool scl_was_high, sda_was_high;
    uint64_t bus_errors;  // BERR raised, over the whole run
};

void i2c_reset(struct f405 *m, unsigned unit);
void i2c_event(struct f405 *m);
// One transfer by DMA, where the unit asks for one. True: there may be another.
bool i2c_pump(struct f405 *m);
uint32_t i2c_read(struct f405 *m, unsigned unit, uint32_t at);
void i2c_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

// The two lines: whether the sensor holds SDA low; follows what the firmware does with
// them as pins.
bool i2c_is_held(const struct f405 *m);
void i2c_follow_pins(struct f405 *m);

#endif
