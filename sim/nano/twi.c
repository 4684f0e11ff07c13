// SPDX-License-Identifier: MIT
// The two-wire interface as a master (data sheet 22), bit by bit, and the levels of its
// two lines when the firmware drives them as pins. Replaces simavr's, which has no bit
// rate and no held bus, and never clears TWINT for firmware that polls it.
#include <simavr/avr_twi.h>

#include "machine.h"

enum {
    TWINT = 1 << 7,
    TWEA = 1 << 6,
    TWSTA = 1 << 5,
    TWSTO = 1 << 4,
    TWWC = 1 << 3,
    TWEN = 1 << 2,
    TWIE = 1 << 0,
    PRESCALER = 0x03,  // of TWSR
    // Data sheet 22.7, tables 22-2 and 22-3.
    STATUS_START = 0x08,
    STATUS_REPEATED_START = 0x10,
    STATUS_WRITE_ACK = 0x18,
    STATUS_WRITE_NACK = 0x20,
    STATUS_SENT_ACK = 0x28,
    STATUS_SENT_NACK = 0x30,
    STATUS_LOST = 0x38,
    STATUS_READ_ACK = 0x40,
    STATUS_READ_NACK = 0x48,
    STATUS_RECEIVED_ACK = 0x50,
    STATUS_RECEIVED_NACK = 0x58,
    STATUS_NONE = 0xF8,
    HELD_RETRY_CYCLES = 160,  // 10 us: how often a waiting START looks at a held bus
};

// Data sheet 22.5.2: SCL = clock / (16 + 2 TWBR 4^TWPS)
static unsigned bit_cycles(const avr_t *avr) {
    return 16U +
           ((2U * avr->data[REG_TWBR]) << (2U * (avr->data[REG_TWSR] & PRESCALER)));
}

static struct i2c_bus *bus(const struct machine *machine) {
    return module_bus(machine->module);
}

static bool is_held(struct machine *machine) {
    return machine->module != NULL &&
           i2c_bus_holds_sda(bus(machine), machine_ns(machine_now(machine)));
}

static void set_status(struct machine *machine, uint8_t status) {
    avr_t *avr = machine->avr;
    machine->twi.status = status;
    avr->data[REG_TWSR] = (uint8_t)(status | (avr->data[REG_TWSR] & PRESCALER));
}

static void finish(struct machine *machine, uint8_t status) {
    machine->twi.doing = TWI_IDLE;
    set_status(machine, status);
    machine->avr->data[REG_TWCR] |= TWINT;
    machine_poll_interrupts(machine);
}

static void lose(struct machine *machine) {
    machine->twi.owns_bus = false;
    machine->twi.is_lost = true;
    finish(machine, STATUS_LOST);
}

static void finish_address(struct machine *machine, uint64_t ns, uint8_t byte) {
    struct machine_twi *twi = &machine->twi;
    twi->is_addressing = false;
    twi->is_reading = (byte & 1) != 0;
    const bool ack = machine->module != NULL &&
                     i2c_bus_start(bus(machine), ns, byte >> 1, twi->is_reading);
    if (is_held(machine)) {
        lose(machine);  // a one was sent, a zero seen
    } else if (twi->is_reading) {
        finish(machine, ack ? STATUS_READ_ACK : STATUS_READ_NACK);
    } else {
        finish(machine, ack ? STATUS_WRITE_ACK : STATUS_WRITE_NACK);
    }
}

static void finish_reading(struct machine *machine, uint64_t ns, uint8_t *byte) {
    const bool ack = (machine->avr->data[REG_TWCR] & TWEA) != 0;
    *byte = machine->module != NULL ? i2c_bus_read(bus(machine), ns, ack) : 0xFF;
    if (!ack && is_held(machine)) {
        lose(machine);  // the NACK did not get through
    } else {
        finish(machine, ack ? STATUS_RECEIVED_ACK : STATUS_RECEIVED_NACK);
    }
}

static void finish_writing(struct machine *machine, uint64_t ns, uint8_t byte) {
    const bool ack = machine->module != NULL && i2c_bus_write(bus(machine), ns, byte);
    const bool held = is_held(machine);
    if (held && byte != 0) {
        lose(machine);
    } else {
        finish(machine, ack || held ? STATUS_SENT_ACK : STATUS_SENT_NACK);
    }
}

static void finish_byte(struct machine *machine, uint64_t when) {
    uint8_t *data = &machine->avr->data[REG_TWDR];
    const uint64_t ns = machine_ns(when);
    if (machine->twi.is_addressing) {
        finish_address(machine, ns, *data);
    } else if (machine->twi.is_reading) {
        finish_reading(machine, ns, data);
    } else {
        finish_writing(machine, ns, *data);
    }
    machine_follow_module(machine);
}

static avr_cycle_count_t on_twi(avr_t *avr, avr_cycle_count_t when, void *param);

static void begin_start(struct machine *machine) {
    machine->twi.doing = TWI_START;
    avr_cycle_timer_register(machine->avr, bit_cycles(machine->avr), on_twi, machine);
}

static avr_cycle_count_t on_twi(avr_t *avr, avr_cycle_count_t when, void *param) {
    struct machine *machine = param;
    struct machine_twi *twi = &machine->twi;
    switch (twi->doing) {
    case TWI_START:
        if (is_held(machine)) {
            return when + HELD_RETRY_CYCLES;  // the bus is not free
        }
        if (machine->on_bus != NULL) {
            machine->on_bus(machine->context, true);
        }
        twi->is_addressing = true;
        twi->is_lost = false;
        finish(machine, twi->owns_bus ? STATUS_REPEATED_START : STATUS_START);
        twi->owns_bus = true;
        break;
    case TWI_STOP:
        if (is_held(machine)) {
            return when + HELD_RETRY_CYCLES;  // SDA can't rise
        }
        if (machine->module != NULL) {
            i2c_bus_stop(bus(machine), machine_ns(when));
            machine_follow_module(machine);
        }
        if (machine->on_bus != NULL) {
            machine->on_bus(machine->context, false);
        }
        twi->owns_bus = false;
        twi->doing = TWI_IDLE;
        set_status(machine, STATUS_NONE);
        avr->data[REG_TWCR] &= (uint8_t)~TWSTO;
        if (avr->data[REG_TWCR] & TWSTA) {
            begin_start(machine);
        }
        break;
    case TWI_BYTE:
        finish_byte(machine, when);
        break;
    case TWI_IDLE:
        break;
    }
    return 0;
}

static void write_twcr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    struct machine_twi *twi = &machine->twi;
    const uint8_t old = avr->data[address];
    // Writing a one clears TWINT; TWWC is read-only.
    uint8_t now =
        (uint8_t)((value & (TWEA | TWSTA | TWSTO | TWEN | TWIE)) | (old & TWWC));
    const bool clears = (value & TWINT) != 0;
    if (!clears) {
        now |= old & TWINT;
    }
    avr->data[address] = now;
    if (!(now & TWEN)) {
        // Switched off: the transfer ends and the pins are ordinary pins again.
        avr_cycle_timer_cancel(avr, on_twi, machine);
        twi->doing = TWI_IDLE;
        twi->owns_bus = false;
        avr->data[address] &= (uint8_t) ~(TWSTO | TWINT);
        set_status(machine, STATUS_NONE);
        return;
    }
    if (!clears || twi->doing != TWI_IDLE) {
        // A STOP or START asked for without clearing TWINT waits for it to be cleared,
        // but a START on a free bus goes at once.
        if (twi->doing == TWI_IDLE && (now & TWSTA) && !(old & TWINT) &&
            !twi->owns_bus) {
            begin_start(machine);
        }
        machine_poll_interrupts(machine);
        return;
    }
    if (now & TWSTO) {
        if (!twi->owns_bus) {
            avr->data[address] &= (uint8_t)~TWSTO;
            set_status(machine, STATUS_NONE);
            if (now & TWSTA) {
                begin_start(machine);
            }
            return;
        }
        twi->doing = TWI_STOP;
        avr_cycle_timer_register(avr, bit_cycles(avr), on_twi, machine);
    } else if (now & TWSTA) {
        begin_start(machine);
    } else if (twi->owns_bus && !twi->is_lost) {
        twi->doing = TWI_BYTE;
        avr_cycle_timer_register(avr, 9 * bit_cycles(avr), on_twi, machine);
    } else {
        set_status(machine, STATUS_NONE);  // not addressed, nothing to do
    }
}

static void write_twdr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)param;
    if (avr->data[REG_TWCR] & TWINT) {
        avr->data[address] = value;
        avr->data[REG_TWCR] &= (uint8_t)~TWWC;
    } else {
        avr->data[REG_TWCR] |= TWWC;  // data sheet 22.9.2: write collision
    }
}

static void write_twsr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    avr->data[address] = (uint8_t)(machine->twi.status | (value & PRESCALER));
}

static bool is_own(const struct machine *machine) {
    return machine_fixes(machine, FIX_TWI_BYTE_TIME) &&
           machine_fixes(machine, FIX_TWI_ADDRESS_STATUS) &&
           machine_fixes(machine, FIX_TWI_FLAG) &&
           machine_fixes(machine, FIX_TWI_BUS_HELD);
}

// simavr's own interface on the same chip, for comparison.
static void on_stock_message(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    struct machine *machine = param;
    avr_twi_msg_irq_t message = {.u.v = value};
    const uint64_t ns = machine_ns(machine_now(machine));
    avr_irq_t *input =
        avr_io_getirq(machine->avr, AVR_IOCTL_TWI_GETIRQ('0'), TWI_IRQ_INPUT);
    if (message.u.twi.msg & TWI_COND_STOP) {
        i2c_bus_stop(bus(machine), ns);
    }
    if (message.u.twi.msg & TWI_COND_START) {
        const uint8_t address = (uint8_t)message.u.twi.addr;
        if (i2c_bus_start(bus(machine), ns, address >> 1, (address & 1) != 0)) {
            avr_raise_irq(input, avr_twi_irq_msg(TWI_COND_ACK, address, 1));
        }
    } else if (message.u.twi.msg & TWI_COND_WRITE) {
        if (i2c_bus_write(bus(machine), ns, (uint8_t)message.u.twi.data)) {
            avr_raise_irq(
                input, avr_twi_irq_msg(TWI_COND_ACK, (uint8_t)message.u.twi.addr, 1));
        }
    } else if (message.u.twi.msg & TWI_COND_READ) {
        const uint8_t byte = i2c_bus_read(bus(machine), ns, true);
        avr_raise_irq(
            input, avr_twi_irq_msg(TWI_COND_READ, (uint8_t)message.u.twi.addr, byte));
    }
    machine_follow_module(machine);
}

void twi_init(struct machine *machine) {
    if (!is_own(machine)) {
        avr_irq_register_notify(
            avr_io_getirq(machine->avr, AVR_IOCTL_TWI_GETIRQ('0'), TWI_IRQ_OUTPUT),
            on_stock_message, machine);
        return;
    }
    machine_take(machine, REG_TWCR, write_twcr, NULL, NULL);
    machine_take(machine, REG_TWDR, write_twdr, NULL, NULL);
    machine_take(machine, REG_TWSR, write_twsr, NULL, NULL);
}

void twi_reset(struct machine *machine) {
    if (!is_own(machine)) {
        return;
    }
    avr_t *avr = machine->avr;
    machine->twi = (struct machine_twi){.doing = TWI_IDLE};
    avr->data[REG_TWBR] = 0;
    avr->data[REG_TWCR] = 0;
    avr->data[REG_TWDR] = 0xFF;
    avr->data[REG_TWAR] = 0xFE;
    avr->data[REG_TWSR] = 0;
    set_status(machine, STATUS_NONE);
}

// The lines: both have pull-ups; the processor pulls down by DDR = 1, PORT = 0.

static bool pulls_down(const struct machine *machine, uint8_t pin) {
    const uint8_t *data = machine->avr->data;
    const uint16_t at = machine->kind->lines;  // PINx, then DDRx and PORTx
    return (data[REG_TWCR] & TWEN) == 0 && (data[at + 1] & pin) != 0 &&
           (data[at + 2] & pin) == 0;
}

static void follow_lines(struct machine *machine) {
    const uint64_t ns = machine_ns(machine_now(machine));
    const bool scl = !pulls_down(machine, machine->kind->scl);
    if (machine->module == NULL) {
        return;
    }
    if (scl && !machine->scl_was_high) {
        i2c_bus_scl_pulse(bus(machine), ns);
    }
    const bool sda = !pulls_down(machine, machine->kind->sda) && !is_held(machine);
    if (scl && machine->scl_was_high && sda && !machine->sda_was_high) {
        i2c_bus_stop(bus(machine), ns);  // SDA rises while SCL is high
        if (machine->on_bus != NULL) {
            machine->on_bus(machine->context, false);
        }
    }
    machine->scl_was_high = scl;
    machine->sda_was_high = sda;
    machine_follow_module(machine);
}

static void write_line_port(avr_t *avr, avr_io_addr_t address, uint8_t value,
                            void *param) {
    struct machine *machine = param;
    machine->line_port.write(avr, address, value, machine->line_port.write_param);
    follow_lines(machine);
}

static void write_line_ddr(avr_t *avr, avr_io_addr_t address, uint8_t value,
                           void *param) {
    struct machine *machine = param;
    machine->line_ddr.write(avr, address, value, machine->line_ddr.write_param);
    follow_lines(machine);
}

static uint8_t read_line_pins(avr_t *avr, avr_io_addr_t address, void *param) {
    struct machine *machine = param;
    uint8_t value =
        machine->line_pins.read(avr, address, machine->line_pins.read_param);
    const struct machine_kind *kind = machine->kind;
    value |= kind->sda | kind->scl;
    if (pulls_down(machine, kind->scl)) {
        value &= (uint8_t)~kind->scl;
    }
    if (pulls_down(machine, kind->sda) || is_held(machine)) {
        value &= (uint8_t)~kind->sda;
    }
    avr->data[address] = value;
    return value;
}

void lines_init(struct machine *machine) {
    if (machine_fixes(machine, FIX_BUS_LINES)) {
        machine_take(machine, machine->kind->lines + 2, write_line_port, NULL,
                     &machine->line_port);
        machine_take(machine, machine->kind->lines + 1, write_line_ddr, NULL,
                     &machine->line_ddr);
        machine_take(machine, machine->kind->lines, NULL, read_line_pins,
                     &machine->line_pins);
    }
}

void lines_reset(struct machine *machine) {
    machine->scl_was_high = true;
    machine->sda_was_high = true;
}
