// SPDX-License-Identifier: MIT
// The wire of i2c_slave.h: faults, single bytes, whole transactions.
#include "i2c_slave.h"

#include <stddef.h>

#define NEVER UINT64_MAX
#define BIT_NS 2500  // one bit at 400 kHz

// Faults

static bool is_in_force(const struct i2c_slave *slave, const struct chip_fault *fault) {
    if (fault->transactions > 0) {
        return slave->is_transfer && slave->transactions >= fault->first &&
               slave->transactions - fault->first < fault->transactions;
    }
    return slave->now_ns >= fault->from_ns &&
           (fault->for_ns == 0 || slave->now_ns - fault->from_ns < fault->for_ns);
}

static bool concerns(const struct i2c_slave *slave, const struct chip_fault *fault,
                     enum chip_fault_kind kind, uint8_t die) {
    return fault->kind == kind && (fault->die == 0 || fault->die == die) &&
           is_in_force(slave, fault);
}

const struct chip_fault *i2c_slave_find_fault(const struct i2c_slave *slave,
                                              enum chip_fault_kind kind, uint8_t die) {
    for (unsigned i = 0; i < slave->fault_count; i++) {
        const struct chip_fault *fault = &slave->faults[i].fault;
        if (concerns(slave, fault, kind, die)) {
            return fault;
        }
    }
    return NULL;
}

// Whether the byte on its way to that die is refused.
static bool is_nacked(const struct i2c_slave *slave, uint8_t die) {
    for (unsigned i = 0; i < slave->fault_count; i++) {
        const struct chip_fault *fault = &slave->faults[i].fault;
        if (concerns(slave, fault, CHIP_FAULT_NACK, die) &&
            fault->at_byte == slave->byte) {
            return true;
        }
    }
    return false;
}

static bool holds(const struct i2c_slave *slave, struct i2c_slave_fault *held) {
    const struct chip_fault *fault = &held->fault;
    if (fault->kind != CHIP_FAULT_STUCK_SDA || held->is_over) {
        return false;
    }
    if (held->held_from_ns == NEVER) {
        const bool in_place = fault->transactions == 0 || slave->byte >= fault->at_byte;
        if (!is_in_force(slave, fault) || !in_place) {
            return false;
        }
        held->held_from_ns = fault->transactions == 0 ? fault->from_ns : slave->now_ns;
    }
    const bool is_timed_out =
        fault->for_ns > 0 && slave->now_ns - held->held_from_ns >= fault->for_ns;
    const bool is_clocked_out = fault->clocks > 0 && held->clocks >= fault->clocks;
    held->is_over = is_timed_out || is_clocked_out;
    return !held->is_over;
}

const struct chip_fault *i2c_slave_next_fault(struct i2c_slave *slave,
                                              enum chip_fault_kind kind) {
    for (unsigned i = 0; i < slave->fault_count; i++) {
        struct i2c_slave_fault *fault = &slave->faults[i];
        if (fault->fault.kind == kind && !fault->is_over &&
            is_in_force(slave, &fault->fault)) {
            fault->is_over = true;
            return &fault->fault;
        }
    }
    return NULL;
}

static bool is_sda_held(struct i2c_slave *slave) {
    bool is_held = slave->ops->holds_sda != NULL && slave->ops->holds_sda(slave->chip);
    for (unsigned i = 0; i < slave->fault_count; i++) {
        is_held = holds(slave, &slave->faults[i]) || is_held;
    }
    return is_held;
}

// Whether it can't become active any more.
static bool is_past(const struct i2c_slave *slave, const struct i2c_slave_fault *each) {
    const struct chip_fault *fault = &each->fault;
    const bool is_of_a_time = fault->transactions == 0 && fault->for_ns > 0;
    return each->is_over || (is_of_a_time && fault->kind != CHIP_FAULT_STUCK_SDA &&
                             slave->now_ns >= fault->from_ns + fault->for_ns);
}

bool i2c_slave_add_fault(struct i2c_slave *slave, const struct chip_fault *fault) {
    unsigned at = 0;
    while (at < slave->fault_count && !is_past(slave, &slave->faults[at])) {
        at++;
    }
    if (at == I2C_SLAVE_FAULTS_MAX) {
        return false;
    }
    slave->fault_count += at == slave->fault_count;
    slave->faults[at] =
        (struct i2c_slave_fault){.fault = *fault, .held_from_ns = NEVER};
    return true;
}

void i2c_slave_clear_faults(struct i2c_slave *slave) {
    slave->fault_count = 0;
}

// The wire

void i2c_slave_release(struct i2c_slave *slave) {
    slave->die = I2C_SLAVE_NOBODY;
}

bool i2c_slave_is_addressed(const struct i2c_slave *slave) {
    return slave->die != I2C_SLAVE_NOBODY;
}

static void tell_idle(struct i2c_slave *slave) {
    if (slave->ops->idle != NULL) {
        slave->ops->idle(slave->chip);
    }
}

bool i2c_slave_start(struct i2c_slave *slave, uint64_t now_ns, uint8_t address,
                     bool is_read) {
    slave->advance(slave->chip, now_ns);
    if (!slave->is_transfer) {
        tell_idle(slave);
        slave->is_transfer = true;
        slave->transactions++;
        slave->byte = 0;
    } else {
        slave->byte++;
    }
    slave->is_read = is_read;
    slave->has_pointer = false;
    slave->die = I2C_SLAVE_NOBODY;
    const uint8_t die = slave->ops->find_die(slave->chip, address);
    if (is_sda_held(slave) || slave->now_ns < slave->answers_ns ||
        is_nacked(slave, die)) {
        return false;
    }
    slave->die = die;
    return die != I2C_SLAVE_NOBODY;
}

bool i2c_slave_write(struct i2c_slave *slave, uint64_t now_ns, uint8_t byte) {
    slave->advance(slave->chip, now_ns);
    slave->byte++;
    if (slave->die == I2C_SLAVE_NOBODY || slave->is_read || is_sda_held(slave)) {
        return false;
    }
    if (is_nacked(slave, slave->die)) {
        slave->die = I2C_SLAVE_NOBODY;
        return false;
    }
    if (!slave->has_pointer) {
        slave->has_pointer = true;
        slave->ops->set_pointer(slave->chip, slave->die, byte);
    } else {
        slave->ops->write(slave->chip, slave->die, byte);
    }
    return true;
}

uint8_t i2c_slave_read(struct i2c_slave *slave, uint64_t now_ns, bool ack) {
    slave->advance(slave->chip, now_ns);
    slave->byte++;
    if (is_sda_held(slave)) {
        return 0x00;
    }
    if (slave->die == I2C_SLAVE_NOBODY || !slave->is_read) {
        return 0xFF;  // SDA is not pulled down
    }
    const uint8_t value = slave->ops->read(slave->chip, slave->die);
    if (!ack) {
        slave->die = I2C_SLAVE_NOBODY;
    }
    return value;
}

void i2c_slave_stop(struct i2c_slave *slave, uint64_t now_ns) {
    slave->advance(slave->chip, now_ns);
    slave->die = I2C_SLAVE_NOBODY;
    slave->is_transfer = false;
    tell_idle(slave);
}

bool i2c_slave_holds_sda(struct i2c_slave *slave, uint64_t now_ns) {
    slave->advance(slave->chip, now_ns);
    return is_sda_held(slave);
}

void i2c_slave_scl_pulse(struct i2c_slave *slave, uint64_t now_ns) {
    slave->advance(slave->chip, now_ns);
    for (unsigned i = 0; i < slave->fault_count; i++) {
        if (holds(slave, &slave->faults[i])) {
            slave->faults[i].clocks++;
        }
    }
    if (slave->ops->clock != NULL) {
        slave->ops->clock(slave->chip);
    }
}

// Whole transactions

static bool begin_transaction(struct i2c_slave *slave, uint64_t *now_ns,
                              uint8_t address, bool is_read) {
    *now_ns += UINT64_C(10) * BIT_NS;
    return i2c_slave_start(slave, *now_ns, address, is_read);
}

static bool send_bytes(struct i2c_slave *slave, uint64_t *now_ns, const uint8_t *bytes,
                       unsigned length) {
    for (unsigned i = 0; i < length; i++) {
        *now_ns += UINT64_C(9) * BIT_NS;
        if (!i2c_slave_write(slave, *now_ns, bytes[i])) {
            return false;
        }
    }
    return true;
}

static int end_transaction(struct i2c_slave *slave, uint64_t *now_ns, bool is_good) {
    *now_ns += BIT_NS;
    if (i2c_slave_holds_sda(slave, *now_ns)) {
        return -3;  // no STOP either
    }
    i2c_slave_stop(slave, *now_ns);
    return is_good ? 0 : -1;
}

int i2c_slave_read_registers(struct i2c_slave *slave, uint64_t *now_ns, uint8_t address,
                             uint8_t reg, uint8_t *data, uint8_t length) {
    if (i2c_slave_holds_sda(slave, *now_ns)) {
        return -3;
    }
    const bool is_good = begin_transaction(slave, now_ns, address, false) &&
                         send_bytes(slave, now_ns, &reg, 1) &&
                         begin_transaction(slave, now_ns, address, true);
    for (unsigned i = 0; is_good && i < length; i++) {
        *now_ns += UINT64_C(9) * BIT_NS;
        data[i] = i2c_slave_read(slave, *now_ns, i + 1U < length);
    }
    return end_transaction(slave, now_ns, is_good);
}

int i2c_slave_write_registers(struct i2c_slave *slave, uint64_t *now_ns,
                              uint8_t address, uint8_t reg, const uint8_t *data,
                              uint8_t length) {
    if (i2c_slave_holds_sda(slave, *now_ns)) {
        return -3;
    }
    const bool is_good = begin_transaction(slave, now_ns, address, false) &&
                         send_bytes(slave, now_ns, &reg, 1) &&
                         send_bytes(slave, now_ns, data, length);
    return end_transaction(slave, now_ns, is_good);
}
