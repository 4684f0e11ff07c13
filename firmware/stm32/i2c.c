// SPDX-License-Identifier: MIT
// The reference manual's sequences ("I2C master mode") as a state machine, and the
// lines of a bus to be freed.
#include "i2c.h"

#include "../board.h"
#include "clock.h"
#include "cpu.h"
#include "generic/bus_recovery.h"
#include "gpio.h"
#include "pins.h"

enum {
    // "I2C clock control register", fast mode, low twice as long as high: a period is
    // 3 * CCR cycles of APB1: 400 kHz, low for 1.67 us (1.3 at least), high for 0.83
    // (0.6).
    CCR = APB1_HZ / (3 * 400000),
    // "I2C TRISE register": 300 ns, the longest rise of fast mode, and one.
    TRISE = 300 * (APB1_HZ / 1000000) / 1000 + 1,
    FREQ = APB1_HZ / 1000000,
    // A whole transfer: 150 bytes, and twice what set-up's longest takes at a tenth of
    // the clock.
    TRANSFER_US_MAX = 4000,
    // A STOP takes 3 us.
    STOP_US_MAX = 20,
    READ = 1,  // in the byte of the address
};

enum phase {
    IDLE,
    STARTING,     // the START is on its way
    POINTING,     // the address for writing
    REGISTERING,  // the register, and then what is written
    RESTARTING,   // the START before reading
    ADDRESSING,   // the address for reading
    RECEIVING,
};

static struct {
    enum phase phase;
    enum bus_result result;
    struct bus_burst polled;
    const struct bus_burst *burst;  // that is under way
    uint8_t bursts;                 // still to come, that one included
    uint8_t remaining;              // bytes of it still to come
    bool is_write;
    uint8_t *in;
    const uint8_t *out;
    uint32_t interrupts;  // bits of CR2; 0 where the transfer is polled
    // A bus error was seen while this burst was read, and no byte since has shown that
    // the device is still sending.
    bool is_suspect;
    uint8_t older;  // bytes still to be taken that had begun before the bus error
} transfer;

void i2c_init(void) {
    transfer.phase = IDLE;
    I2C1->cr1 = I2C_CR1_SWRST;
    I2C1->cr1 = 0;
    I2C1->cr2 = FREQ;
    I2C1->ccr = I2C_CCR_FS | CCR;
    I2C1->trise = TRISE;
    I2C1->cr1 = I2C_CR1_PE;
}

static bool lines_are_high(void) {
    const uint32_t lines = BIT(PIN_SDA) | BIT(PIN_SCL);
    return (GPIOB->idr & lines) == lines;
}

enum bus_result i2c_abort(void) {
    i2c_init();
    return lines_are_high() ? BUS_TIMEOUT : BUS_STUCK;
}

enum bus_result i2c_result(void) {
    return transfer.result;
}

// While a START or a STOP is on its way, CR1 must not be written ("I2C control register
// 1", note).
static bool stop_is_out(void) {
    const uint32_t begun_us = clock_us();
    while ((I2C1->cr1 & I2C_CR1_STOP) != 0) {
        if (clock_us() - begun_us > STOP_US_MAX) {
            return false;
        }
    }
    return true;
}

static bool begin(const struct bus_burst *bursts, uint8_t count, uint32_t interrupts) {
    if (!stop_is_out()) {
        return false;
    }
    transfer.phase = STARTING;
    transfer.result = BUS_OK;
    transfer.burst = bursts;
    transfer.bursts = count;
    transfer.remaining = bursts->length;
    transfer.is_suspect = false;
    transfer.older = 0;
    transfer.interrupts = interrupts;
    I2C1->cr2 = FREQ | interrupts;
    I2C1->cr1 = I2C_CR1_PE | I2C_CR1_START;
    return true;
}

bool i2c_read(const struct bus_burst *bursts, uint8_t count, uint8_t *bytes) {
    transfer.is_write = false;
    transfer.in = bytes;
    return begin(bursts, count, I2C_CR2_ITEVTEN | I2C_CR2_ITERREN);
}

static enum i2c_progress end(enum bus_result result) {
    transfer.phase = IDLE;
    transfer.result = result;
    I2C1->cr2 = FREQ;
    return I2C_OVER;
}

// What goes out behind the last byte of a burst: it is asked for ahead of time.
static void ask_for_end(void) {
    I2C1->cr1 |= transfer.bursts > 1 ? I2C_CR1_START : I2C_CR1_STOP;
}

static enum i2c_progress end_burst(void) {
    if (transfer.is_suspect) {
        return end(BUS_STUCK);
    }
    transfer.bursts--;
    if (transfer.bursts == 0) {
        return end(BUS_OK);
    }
    transfer.burst++;
    transfer.remaining = transfer.burst->length;
    transfer.older = 0;
    transfer.phase = STARTING;
    return I2C_MOVED;
}

// A bus error alone ends nothing. The hardware can report one that did not happen
// (ES0182, "Spurious bus error detection in master mode"), and continues with the
// transfer in any case ("Bus error (BERR)"). After a real one, a START or STOP that is
// not ours, the device is off the bus. Then it acknowledges no byte, which AF tells,
// or, if it was sending, all that follows reads as ones. Those are looked for here.
static void suspect(uint32_t sr1) {
    const bool is_receiving = transfer.phase == RECEIVING;
    transfer.is_suspect = is_receiving || transfer.phase == ADDRESSING;
    transfer.older = (uint8_t)(is_receiving + ((sr1 & I2C_SR1_RXNE) != 0) +
                               ((sr1 & I2C_SR1_BTF) != 0));
}

static void take_byte(void) {
    const uint8_t byte = (uint8_t)I2C1->dr;
    *transfer.in++ = byte;
    transfer.remaining--;
    // The byte in which the bus error came is whole where its last bit is a zero; then
    // only what follows it can be missing.
    const bool is_proof =
        transfer.older == 0 ? byte != 0xFF : transfer.remaining == 0 && (byte & 1) == 0;
    if (is_proof) {
        transfer.is_suspect = false;
    }
    if (transfer.older > 0) {
        transfer.older--;
    }
}

// The address was acknowledged; reading SR2 lets the first byte come. What comes behind
// a single byte must be asked for before that byte is there: 22 us.
static void begin_receiving(void) {
    transfer.phase = RECEIVING;
    if (transfer.remaining == 2) {  // POS: acknowledge the first, refuse the second
        I2C1->cr1 = I2C_CR1_PE | I2C_CR1_POS;
    }
    const uint32_t primask = cpu_mask();
    (void)I2C1->sr2;
    if (transfer.remaining == 1) {
        ask_for_end();
    }
    cpu_unmask(primask);
    if (transfer.interrupts != 0 &&
        (transfer.remaining == 1 || transfer.remaining > 3)) {
        I2C1->cr2 |= I2C_CR2_ITBUFEN;
    }
}

// "Master receiver": up to three bytes before the end each byte is taken as it comes.
// Of the last three the hardware holds the clock until they are dealt with (BTF), so
// that none depends on how soon this is called.
static enum i2c_progress receive(uint32_t sr1) {
    if (transfer.remaining > 3 || transfer.remaining == 1) {
        if ((sr1 & I2C_SR1_RXNE) == 0) {
            return I2C_WAITS;
        }
        take_byte();
        if (transfer.remaining == 3) {
            I2C1->cr2 &= ~I2C_CR2_ITBUFEN;
        }
        return transfer.remaining == 0 ? end_burst() : I2C_MOVED;
    }
    if ((sr1 & I2C_SR1_BTF) == 0) {
        return I2C_WAITS;
    }
    if (transfer.remaining ==
        3) {  // one in DR, one behind it; the last is to be refused
        I2C1->cr1 &= ~I2C_CR1_ACK;
        take_byte();
        return I2C_MOVED;
    }
    ask_for_end();
    take_byte();
    take_byte();
    return end_burst();
}

// The register or a written byte has left, acknowledged. BTF goes only with the START
// or STOP: until then, two bits or so, the interrupt comes again and again and finds
// nothing.
static enum i2c_progress send_more(void) {
    if (!transfer.is_write) {
        I2C1->cr1 |= I2C_CR1_START;
        (void)
            I2C1->dr;  // clears BTF, which else would interrupt until the START is out
        transfer.phase = RESTARTING;
        return I2C_MOVED;
    }
    if (transfer.remaining > 0) {
        I2C1->dr = *transfer.out++;
        transfer.remaining--;
        return I2C_MOVED;
    }
    I2C1->cr1 |= I2C_CR1_STOP;
    return end(BUS_OK);
}

enum i2c_progress i2c_step(void) {
    if (transfer.phase == IDLE) {
        I2C1->cr2 = FREQ;
        return I2C_OVER;
    }
    const uint32_t sr1 = I2C1->sr1;
    const uint32_t errors = sr1 & (I2C_SR1_BERR | I2C_SR1_ARLO | I2C_SR1_AF);
    if (errors != 0) {
        I2C1->sr1 = (uint16_t)~errors;
        if ((errors & I2C_SR1_AF) != 0) {
            I2C1->cr1 |= I2C_CR1_STOP;
            return end(BUS_NACK);
        }
        if ((errors & I2C_SR1_ARLO) != 0) {
            // With one master on the bus, something else drives the wires.
            return end(BUS_STUCK);
        }
        suspect(sr1);
    }
    const uint8_t address = (uint8_t)(transfer.burst->address << 1);
    switch (transfer.phase) {
    case STARTING:
        if ((sr1 & I2C_SR1_SB) == 0) {
            return I2C_WAITS;
        }
        I2C1->dr = address;
        transfer.phase = POINTING;
        return I2C_MOVED;
    case POINTING:
        if ((sr1 & I2C_SR1_ADDR) == 0) {
            return I2C_WAITS;
        }
        (void)I2C1->sr2;
        I2C1->dr = transfer.burst->reg;
        transfer.phase = REGISTERING;
        return I2C_MOVED;
    case REGISTERING:
        return (sr1 & I2C_SR1_BTF) != 0 ? send_more() : I2C_WAITS;
    case RESTARTING:
        if ((sr1 & I2C_SR1_SB) == 0) {
            return I2C_WAITS;
        }
        I2C1->cr1 = I2C_CR1_PE | (transfer.remaining > 1 ? I2C_CR1_ACK : 0);
        I2C1->dr = address | READ;
        transfer.phase = ADDRESSING;
        return I2C_MOVED;
    case ADDRESSING:
        if ((sr1 & I2C_SR1_ADDR) == 0) {
            return I2C_WAITS;
        }
        begin_receiving();
        return I2C_MOVED;
    default:
        return receive(sr1);
    }
}

// Moves a transfer on until it is over.
static enum bus_result finish(uint32_t begun_us) {
    while (i2c_step() != I2C_OVER) {
        if (clock_us() - begun_us > TRANSFER_US_MAX) {
            return i2c_abort();
        }
    }
    // So that the lines are at rest at the return.
    if (!stop_is_out()) {
        return i2c_abort();
    }
    return transfer.result;
}

static enum bus_result poll(uint8_t address, uint8_t reg, uint8_t length) {
    const uint32_t begun_us = clock_us();
    transfer.polled = (struct bus_burst){address, reg, length};
    return begin(&transfer.polled, 1, 0) ? finish(begun_us) : i2c_abort();
}

static enum bus_result read_registers(void *port, uint8_t address, uint8_t reg,
                                      uint8_t *data, uint8_t length) {
    (void)port;
    transfer.is_write = false;
    transfer.in = data;
    return poll(address, reg, length);
}

static enum bus_result write_registers(void *port, uint8_t address, uint8_t reg,
                                       const uint8_t *data, uint8_t length) {
    (void)port;
    transfer.is_write = true;
    transfer.out = data;
    return poll(address, reg, length);
}

const IN_FLASH struct bus_device board_bus = {read_registers, write_registers, 0};

static void wait_half_clock(void) {
    const uint32_t begun_us = clock_us();
    while (clock_us() - begun_us <= BUS_HALF_CLOCK_US) {
    }
}

// The pins are open drains: 0 pulls, 1 lets go.
uint8_t bus_lines(uint8_t pulled) {
    gpio_set(GPIOB, PIN_SDA, (pulled & BUS_SDA) == 0);
    gpio_set(GPIOB, PIN_SCL, (pulled & BUS_SCL) == 0);
    wait_half_clock();
    return (uint8_t)((gpio_is_high(GPIOB, PIN_SDA) ? BUS_SDA : 0) |
                     (gpio_is_high(GPIOB, PIN_SCL) ? BUS_SCL : 0));
}

static void hand_pins_to(enum gpio_mode mode) {
    gpio_set_mode(GPIOB, PIN_SCL, mode);
    gpio_set_mode(GPIOB, PIN_SDA, mode);
}

// Takes 4 ms at most, 0.2 ms where nobody holds SCL. That both lines move, and the
// reset of the hardware behind it, also free an input filter that sees a bus at rest as
// busy (ES0182, "I2C analog filter may provide wrong value, locking BUSY flag").
enum bus_result board_bus_recover(void) {
    (void)i2c_abort();
    GPIOB->bsrr = BIT(PIN_SCL) | BIT(PIN_SDA);
    hand_pins_to(GPIO_OUTPUT);
    const enum bus_result result = bus_recovery_run();
    hand_pins_to(GPIO_ALTERNATE);
    i2c_init();
    return result;
}
