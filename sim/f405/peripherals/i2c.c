// SPDX-License-Identifier: MIT
// I2C1 as a master, byte by byte (RM, "Inter-integrated circuit (I2C) interface", "I2C
// master mode").
//
// The order of events is the manual's. A flag holds the clock low until the software
// has read and written what it asks for. Whether a byte is acknowledged is decided at
// its end, from ACK as it is then, or with POS as it was at the end of the byte before.
// Data register and shift register are separate. The lines SCL and SDA are the sensor's
// and ours, or those of two pins that the firmware works by hand.
#include "chips/i2c_slave.h"
#include "chips/lsm9ds0.h"
#include "f405/f405.h"

enum {
    CR1 = 0x00,
    CR2 = 0x04,
    OAR1 = 0x08,
    OAR2 = 0x0C,
    DR = 0x10,
    SR1 = 0x14,
    SR2 = 0x18,
    CCR = 0x1C,
    TRISE = 0x20,
    FLTR = 0x24,
    CR1_PE = 1 << 0,
    CR1_START = 1 << 8,
    CR1_STOP = 1 << 9,
    CR1_ACK = 1 << 10,
    CR1_POS = 1 << 11,
    CR1_SWRST = 1 << 15,
    CR1_KNOWN = CR1_PE | CR1_START | CR1_STOP | CR1_ACK | CR1_POS | CR1_SWRST,
    CR2_ITERREN = 1 << 8,
    CR2_ITEVTEN = 1 << 9,
    CR2_ITBUFEN = 1 << 10,
    CR2_DMAEN = 1 << 11,
    CR2_LAST = 1 << 12,
    SB = 1 << 0,
    ADDR = 1 << 1,
    BTF = 1 << 2,
    RXNE = 1 << 6,
    TXE = 1 << 7,
    BERR = 1 << 8,
    ARLO = 1 << 9,
    AF = 1 << 10,
    ERRORS = BERR | ARLO | AF | 0xD800,
    MSL = 1 << 0,
    BUSY = 1 << 1,
    TRA = 1 << 2,
    CCR_FAST = 1 << 15,
    CCR_DUTY = 1 << 14,
    FASTEST_HZ = 400000,
    BYTE_BITS = 9,
    DMA1_UNIT = 0,
    CHANNEL = 1,
    PIN_SCL = 6,  // PB6
    PIN_SDA = 7,  // PB7
    AF_I2C = 4,
};
#define RETRY_PS (10 * F405_PS_PER_US)  // how often a held bus is looked at again

static struct i2c_slave *wire(const struct f405 *m) {
    return sensor_chip_wire(m->sensor);
}

bool i2c_is_held(const struct f405 *m) {
    return i2c_slave_holds_sda(wire(m), f405_ns(f405_when(m)));
}

static bool has_pins(const struct f405 *m) {
    return pins_is_alternate(m, PORT_B, PIN_SCL, AF_I2C) &&
           pins_is_alternate(m, PORT_B, PIN_SDA, AF_I2C);
}

static void tell_bus(struct f405 *m, bool is_start) {
    if (m->on_bus != NULL) {
        m->on_bus(m->context, is_start);
    }
}

static uint64_t bit_ps(struct f405 *m) {
    const uint32_t ccr = m->i2c.ccr;
    const uint32_t parts = (ccr & CCR_FAST) == 0 ? 2 : (ccr & CCR_DUTY) == 0 ? 3 : 25;
    const uint32_t cycles = parts * ((ccr & 0xFFF) != 0 ? ccr & 0xFFF : 1);
    const uint32_t pclk_hz = rcc_nominal_hz(m, m->pclk_hz[0]);
    if ((uint64_t)FASTEST_HZ * cycles < pclk_hz) {
        f405_complain(m, "I2C faster than 400 kHz");
    }
    if ((m->i2c.cr2 & 0x3F) != pclk_hz / 1000000) {
        f405_complain(m, "I2C told another clock than the bus has (FREQ)");
    }
    return f405_ps(cycles, m->pclk_hz[0]);
}

static uint64_t now_ns(const struct f405 *m) {
    return f405_ns(f405_when(m));
}

static bool is_master(const struct f405 *m) {
    return (m->i2c.sr2 & MSL) != 0;
}

static void follow_line(struct f405 *m) {
    const struct f405_i2c *i2c = &m->i2c;
    const uint32_t buffer = (i2c->cr2 & CR2_ITBUFEN) != 0 ? TXE | RXNE : 0;
    core_irq(m, EXCEPTION_IRQ + IRQ_I2C1_EVENT,
             (i2c->cr2 & CR2_ITEVTEN) && (i2c->sr1 & (SB | ADDR | BTF | buffer)));
    core_irq(m, EXCEPTION_IRQ + IRQ_I2C1_ERROR,
             (i2c->cr2 & CR2_ITERREN) && (i2c->sr1 & ERRORS));
}

static void plan(struct f405 *m, int doing, uint64_t length_ps) {
    m->i2c.doing = doing;
    f405_at(m, EVENT_I2C, f405_when(m) + length_ps);
}

// Starts the next step on the bus, if it is idle and the flags allow one.
static void go_on(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if ((i2c->cr1 & CR1_PE) == 0 || i2c->doing != BUS_IDLE) {
        return;
    }
    if (!is_master(m)) {
        if ((i2c->cr1 & CR1_START) != 0) {
            plan(m, BUS_START, bit_ps(m));
        }
        return;
    }
    if ((i2c->sr1 & ADDR) != 0) {
        return;  // the clock is held
    }
    const bool has_unread = i2c->is_reading && i2c->is_shift_full;
    if ((i2c->cr1 & CR1_STOP) != 0) {
        if (i2c->is_reading && i2c->had_ack) {
            f405_complain(m, "a STOP after an acknowledged byte");
        }
        plan(m, BUS_STOP, bit_ps(m));
    } else if ((i2c->cr1 & CR1_START) != 0) {
        plan(m, BUS_START, bit_ps(m));
    } else if ((i2c->sr1 & SB) != 0 || i2c->is_refused || has_unread) {
        return;  // the clock is held
    } else if (i2c->is_reading) {
        if (i2c->had_ack) {
            plan(m, BUS_RECEIVE, BYTE_BITS * bit_ps(m));
        }
    } else if ((i2c->sr2 & TRA) != 0 && i2c->is_data_full) {
        i2c->shift = i2c->data;
        i2c->is_data_full = false;
        i2c->sr1 |= TXE;
        i2c->sr1 &= ~(uint32_t)BTF;
        plan(m, BUS_SEND, BYTE_BITS * bit_ps(m));
    }
}

// A one was sent but a zero seen (RM, "Arbitration lost").
static void lose(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    i2c->sr1 |= ARLO;
    i2c->sr1 &= ~(uint32_t)(TXE | BTF);
    i2c->sr2 &= ~(uint32_t)(MSL | TRA);
    i2c->is_busy = true;
    i2c->is_data_full = false;
}

static void refuse(struct f405 *m) {
    m->i2c.sr1 |= AF;
    m->i2c.is_refused = true;
}

static void end_start(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if (!has_pins(m)) {
        f405_complain(m, "I2C1 used with its pins elsewhere");
    }
    if (i2c_is_held(m) || !has_pins(m) || (i2c->is_busy && !is_master(m))) {
        i2c->is_busy = true;
        plan(m, BUS_START, RETRY_PS);
        return;
    }
    tell_bus(m, true);
    i2c->cr1 &= ~(uint32_t)CR1_START;
    i2c->sr1 &= ~(uint32_t)(TXE | BTF);
    i2c->sr1 |= SB;
    i2c->sr2 = (i2c->sr2 & ~(uint32_t)TRA) | MSL;
    i2c->is_busy = true;
    i2c->is_reading = i2c->is_data_full = i2c->is_refused = false;
    i2c->is_shift_full = i2c->had_ack = false;
}

static void end_address(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    i2c->is_reading = (i2c->shift & 1) != 0;
    const bool ack =
        i2c_slave_start(wire(m), now_ns(m), i2c->shift >> 1, i2c->is_reading);
    if (i2c_is_held(m)) {
        lose(m);
    } else if (!ack) {
        refuse(m);
    } else {
        i2c->sr1 |= ADDR;
        i2c->sr2 |= i2c->is_reading ? 0 : TRA;
        i2c->acks_next = (i2c->cr1 & CR1_ACK) != 0;
        i2c->had_ack = i2c->is_reading;  // so that a first byte is received
    }
}

static void end_send(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    const bool ack = i2c_slave_write(wire(m), now_ns(m), i2c->shift);
    const bool held = i2c_is_held(m);
    if (held && i2c->shift != 0) {
        lose(m);
    } else if (!ack && !held) {
        refuse(m);
    } else if (!i2c->is_data_full) {
        i2c->sr1 |= BTF;
    }
}

static bool is_last_of_dma(const struct f405 *m) {
    const uint32_t wanted = CR2_DMAEN | CR2_LAST;
    return (m->i2c.cr2 & wanted) == wanted &&
           (dma_left(m, DMA1_UNIT, 0, CHANNEL) == 1 ||
            dma_left(m, DMA1_UNIT, 5, CHANNEL) == 1);
}

static void end_receive(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    const bool acks = (i2c->cr1 & CR1_ACK) != 0;
    i2c->had_ack =
        ((i2c->cr1 & CR1_POS) != 0 ? i2c->acks_next : acks) && !is_last_of_dma(m);
    i2c->acks_next = acks;
    i2c->shift = i2c_slave_read(wire(m), now_ns(m), i2c->had_ack) & i2c->torn;
    i2c->torn = 0xFF;
    if (!i2c->had_ack && i2c_is_held(m)) {
        lose(m);  // the NACK did not get through
        return;
    }
    if (!i2c->had_ack) {
        tell_bus(m, false);  // all bytes are there; the STOP follows
    }
    if ((i2c->sr1 & RXNE) == 0) {
        i2c->data = i2c->shift;
        i2c->sr1 |= RXNE;
    } else {
        i2c->is_shift_full = true;
        i2c->sr1 |= BTF;
    }
}

static void end_stop(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if (i2c_is_held(m)) {
        plan(m, BUS_STOP, RETRY_PS);  // SDA can't rise
        return;
    }
    i2c_slave_stop(wire(m), now_ns(m));
    if (!i2c->is_reading) {
        tell_bus(m, false);
    }
    i2c->cr1 &= ~(uint32_t)CR1_STOP;
    i2c->sr1 &= ~(uint32_t)(TXE | SB);
    if (!i2c->is_reading) {
        i2c->sr1 &= ~(uint32_t)BTF;
    }
    i2c->sr2 = 0;
    i2c->is_busy = i2c->is_refused = i2c->is_data_full = false;
}

void i2c_event(struct f405 *m) {
    const int doing = (int)m->i2c.doing;
    m->i2c.doing = BUS_IDLE;
    switch (doing) {
    case BUS_START:
        end_start(m);
        break;
    case BUS_ADDRESS:
        end_address(m);
        break;
    case BUS_SEND:
        end_send(m);
        break;
    case BUS_RECEIVE:
        end_receive(m);
        break;
    case BUS_STOP:
        end_stop(m);
        break;
    default:
        break;
    }
    pins_follow(m);
    follow_line(m);
    f405_pump(m);  // DMA may fill the data register before the clock stands still
    go_on(m);
    follow_line(m);
}

// Errata sheet ES0182, "Spurious bus error detection in master mode": the flag rises
// while nothing has happened on the wires.
void f405_spurious_berr(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if (i2c->doing != BUS_IDLE) {
        i2c->sr1 |= BERR;
        i2c->bus_errors++;
        follow_line(m);
    }
}

// SDA is pulled low for a moment: the sensor sees a START within a byte and drops out
// of the transfer; the peripheral reports it and continues (RM, "Bus error"). Of a byte
// that the sensor was sending the bits still to come are ones.
void f405_glitch(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if (i2c->doing != BUS_ADDRESS && i2c->doing != BUS_SEND &&
        i2c->doing != BUS_RECEIVE) {
        return;
    }
    if (i2c->doing == BUS_RECEIVE) {
        const uint64_t now = f405_when(m);
        const uint64_t end = m->at[EVENT_I2C];
        const uint64_t left = (end > now ? end - now : 0) / bit_ps(m);
        i2c->torn &= i2c_slave_read(wire(m), f405_ns(now), true) |
                     (uint8_t)((1U << (left > 8 ? 8 : left)) - 1);
    }
    i2c_slave_stop(wire(m), f405_ns(f405_when(m)));
    f405_spurious_berr(m);
}

// The lines driven as pins: pulses that free a sensor holding SDA, and a STOP by hand.
void i2c_follow_pins(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    const bool is_ours = !has_pins(m);
    const bool scl = !is_ours || pins_level(m, PORT_B, PIN_SCL);
    if (is_ours && scl && !i2c->scl_was_high) {
        i2c_slave_scl_pulse(wire(m), f405_ns(f405_when(m)));
    }
    const bool sda = !is_ours || pins_level(m, PORT_B, PIN_SDA);
    if (is_ours && scl && i2c->scl_was_high && sda && !i2c->sda_was_high) {
        // SDA rises while SCL is high.
        i2c_slave_stop(wire(m), f405_ns(f405_when(m)));
        tell_bus(m, false);
    }
    i2c->scl_was_high = scl;
    i2c->sda_was_high = sda;
}

bool i2c_pump(struct f405 *m) {
    const struct f405_i2c *i2c = &m->i2c;
    if ((i2c->cr2 & CR2_DMAEN) == 0) {
        return false;
    }
    if ((i2c->sr1 & RXNE) != 0) {
        return dma_serve(m, DMA1_UNIT, 0, CHANNEL, false) ||
               dma_serve(m, DMA1_UNIT, 5, CHANNEL, false);
    }
    if ((i2c->sr1 & TXE) != 0 && (i2c->sr2 & TRA) != 0 && !i2c->is_data_full) {
        return dma_serve(m, DMA1_UNIT, 6, CHANNEL, true) ||
               dma_serve(m, DMA1_UNIT, 7, CHANNEL, true);
    }
    return false;
}

// Registers

static void stand_still(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    i2c->sr1 = i2c->sr2 = i2c->seen = 0;
    i2c->doing = BUS_IDLE;
    i2c->is_reading = i2c->is_data_full = i2c->is_shift_full = false;
    i2c->is_busy = i2c->is_refused = i2c->had_ack = false;
    i2c->torn = 0xFF;
    f405_never(m, EVENT_I2C);
}

static void write_control(struct f405 *m, uint32_t value) {
    struct f405_i2c *i2c = &m->i2c;
    if ((value & ~(uint32_t)CR1_KNOWN) != 0) {
        f405_not_modelled(m, "SMBus, slave mode, packet errors of I2C1");
    }
    if ((value & CR1_SWRST) != 0) {
        i2c_reset(m, 0);
        i2c->cr1 = CR1_SWRST;
        return;
    }
    i2c->cr1 = value & CR1_KNOWN;
    if ((value & CR1_PE) == 0) {
        i2c->cr1 &= ~(uint32_t)(CR1_START | CR1_STOP);
        stand_still(m);
    }
}

static void write_data(struct f405 *m, uint8_t value) {
    struct f405_i2c *i2c = &m->i2c;
    if ((i2c->cr1 & CR1_PE) == 0) {
        return;
    }
    if ((i2c->sr1 & SB) != 0) {
        if ((i2c->seen & SB) == 0) {
            f405_complain(m, "an address sent before SB was seen");
            return;
        }
        i2c->sr1 &= ~(uint32_t)SB;
        i2c->shift = value;
        if (i2c->doing == BUS_IDLE) {
            plan(m, BUS_ADDRESS, BYTE_BITS * bit_ps(m));
        }
        return;
    }
    if ((i2c->sr2 & TRA) == 0 || (i2c->sr1 & ADDR) != 0) {
        f405_complain(m, "a byte for I2C1 that has nowhere to go");
        return;
    }
    if (i2c->is_data_full) {
        f405_complain(m, "a byte for I2C1 written over another");
    }
    i2c->data = value;
    i2c->is_data_full = true;
    i2c->sr1 &= ~(uint32_t)(TXE | BTF);
}

static uint32_t read_data(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    const uint8_t value = i2c->data;
    if (i2c->is_shift_full) {
        i2c->data = i2c->shift;
        i2c->is_shift_full = false;
        i2c->sr1 &= ~(uint32_t)BTF;
    } else {
        i2c->sr1 &= ~(uint32_t)(RXNE | (i2c->is_reading ? BTF : 0));
    }
    go_on(m);
    return value;
}

static uint32_t read_status2(struct f405 *m) {
    struct f405_i2c *i2c = &m->i2c;
    if ((i2c->cr1 & CR1_PE) != 0 && i2c_is_held(m)) {
        i2c->is_busy = true;
    }
    const uint32_t value = i2c->sr2 | (i2c->is_busy ? BUSY : 0);
    if ((i2c->seen & i2c->sr1 & ADDR) != 0) {
        i2c->sr1 &= ~(uint32_t)ADDR;
        i2c->sr1 |= (i2c->sr2 & TRA) != 0 ? TXE : 0;
        if (i2c->is_reading) {
            // The byte is received, whatever else is asked for meanwhile.
            plan(m, BUS_RECEIVE, BYTE_BITS * bit_ps(m));
        } else {
            go_on(m);
        }
    }
    return value;
}

uint32_t i2c_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    struct f405_i2c *i2c = &m->i2c;
    uint32_t value = 0;
    switch (at) {
    case CR1:
        return i2c->cr1;
    case CR2:
        return i2c->cr2;
    case OAR1:
        return i2c->oar1;
    case OAR2:
        return i2c->oar2;
    case DR:
        value = read_data(m);
        break;
    case SR1:
        i2c->seen = i2c->sr1;
        return i2c->sr1;
    case SR2:
        value = read_status2(m);
        break;
    case CCR:
        return i2c->ccr;
    case TRISE:
        return i2c->trise;
    case FLTR:
        return i2c->fltr;
    default:
        f405_not_modelled(m, "no register of I2C1");
        return 0;
    }
    follow_line(m);
    return value;
}

void i2c_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_i2c *i2c = &m->i2c;
    if ((i2c->cr1 & CR1_SWRST) != 0 && at != CR1) {
        return;
    }
    switch (at) {
    case CR1:
        write_control(m, value);
        break;
    case CR2:
        i2c->cr2 = value & 0x1F3F;
        break;
    case OAR1:
        i2c->oar1 = value & 0xC3FF;
        break;
    case OAR2:
        i2c->oar2 = value & 0xFF;
        break;
    case DR:
        write_data(m, (uint8_t)value);
        break;
    case SR1:
        i2c->sr1 &= value | ~(uint32_t)ERRORS;
        break;
    case SR2:
        break;
    case CCR:
    case TRISE:
        if ((i2c->cr1 & CR1_PE) != 0) {
            f405_complain(m, "the clock of I2C1 changed while it is on");
        }
        *(at == CCR ? &i2c->ccr : &i2c->trise) = value & (at == CCR ? 0xCFFF : 0x3F);
        break;
    case FLTR:
        i2c->fltr = value & 0x1F;
        break;
    default:
        f405_not_modelled(m, "no register of I2C1");
        break;
    }
    go_on(m);
    follow_line(m);
}

void i2c_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    struct f405_i2c *i2c = &m->i2c;
    stand_still(m);
    *i2c = (struct f405_i2c){.trise = 2,
                             .scl_was_high = true,
                             .sda_was_high = true,
                             .torn = 0xFF,
                             .bus_errors = i2c->bus_errors};
    follow_line(m);
}
