// SPDX-License-Identifier: MIT
// I2C1 by polling, in the sequences of RM0090, "I2C master mode".
#ifndef I2C_H
#define I2C_H

#include "bare.h"

enum {
    SB = 1 << 0,
    ADDR = 1 << 1,
    BTF = 1 << 2,
    RXNE = 1 << 6,
    TXE = 1 << 7,
    BERR = 1 << 8,
    ARLO = 1 << 9,
    AF = 1 << 10,
    ERRORS = BERR | ARLO | AF,
    PE = 1 << 0,
    START = 1 << 8,
    STOP = 1 << 9,
    ACK = 1 << 10,
    POS = 1 << 11,
    SWRST = 1 << 15,
    TRIES = 4000,  // at 16 MHz, some 5 ms
};

static inline void i2c_setup(void) {
    RCC_APB1ENR |= BIT(21);
    GPIO(GPIOB, OTYPER) |= BIT(6) | BIT(7);
    pin_alternate(GPIOB, 6, 4);
    pin_alternate(GPIOB, 7, 4);
    I2C(I_CR1) = SWRST;
    I2C(I_CR1) = 0;
    I2C(I_CR2) = 16;
    I2C(I_CCR) = BIT(15) | BIT(14) | 2;  // 16 MHz / (25 * 2): 320 kHz
    I2C(I_TRISE) = 5;
    I2C(I_CR1) = PE;
}

// Returns SR1 once it has one of the flags or an error; 0 after TRIES.
static inline uint32_t i2c_wait(uint32_t flags) {
    for (unsigned i = 0; i < TRIES; i++) {
        const uint32_t sr1 = I2C(I_SR1);
        if ((sr1 & (flags | ERRORS)) != 0) {
            return sr1;
        }
    }
    return 0;
}

static uint32_t i2c_errors;  // of the last transaction that failed

static inline bool i2c_stop(uint32_t error) {
    i2c_errors = error & ERRORS;
    I2C(I_CR1) |= STOP;
    for (unsigned i = 0; (I2C(I_CR1) & STOP) != 0 && i < TRIES; i++) {
    }
    I2C(I_SR1) = ~(error & ERRORS);
    return error == 0;
}

static inline bool i2c_address(uint8_t byte) {
    I2C(I_CR1) |= START;
    if ((i2c_wait(SB) & SB) == 0) {
        return false;
    }
    I2C(I_DR) = byte;
    return (i2c_wait(ADDR) & ADDR) != 0;
}

static inline bool i2c_point(uint8_t address, uint8_t reg) {
    if (!i2c_address((uint8_t)(address << 1))) {
        return false;
    }
    (void)I2C(I_SR2);
    I2C(I_DR) = reg;
    return (i2c_wait(BTF) & (BTF | AF)) == BTF;
}

static inline bool i2c_write(uint8_t address, uint8_t reg, uint8_t value) {
    if (!i2c_point(address, reg)) {
        return i2c_stop(I2C(I_SR1) | BIT(31));
    }
    I2C(I_DR) = value;
    const uint32_t sr1 = i2c_wait(BTF);
    return i2c_stop((sr1 & BTF) != 0 ? 0 : sr1 | BIT(31));
}

// RM0090, "Master receiver": the last bytes need a sequence for each length.
static inline bool i2c_read(uint8_t address, uint8_t reg, uint8_t *data,
                            unsigned length) {
    I2C(I_CR1) = PE | ACK;
    if (!i2c_point(address, reg) || !i2c_address((uint8_t)(address << 1 | 1))) {
        return i2c_stop(I2C(I_SR1) | BIT(31));
    }
    if (length == 1) {
        I2C(I_CR1) &= ~(uint32_t)ACK;
        (void)I2C(I_SR2);
        I2C(I_CR1) |= STOP;
        (void)i2c_wait(RXNE);
        data[0] = (uint8_t)I2C(I_DR);
    } else if (length == 2) {
        // With POS the NACK follows the second byte. No byte comes while ADDR is set.
        I2C(I_CR1) |= POS;
        (void)I2C(I_SR2);
        I2C(I_CR1) &= ~(uint32_t)ACK;
        (void)i2c_wait(BTF);
        I2C(I_CR1) |= STOP;
        data[0] = (uint8_t)I2C(I_DR);
        data[1] = (uint8_t)I2C(I_DR);
    } else {
        (void)I2C(I_SR2);
        unsigned i = 0;
        for (; i < length - 3; i++) {
            (void)i2c_wait(RXNE);
            data[i] = (uint8_t)I2C(I_DR);
        }
        (void)i2c_wait(BTF);
        I2C(I_CR1) &= ~(uint32_t)ACK;
        data[i] = (uint8_t)I2C(I_DR);
        (void)i2c_wait(BTF);
        I2C(I_CR1) |= STOP;
        data[i + 1] = (uint8_t)I2C(I_DR);
        data[i + 2] = (uint8_t)I2C(I_DR);
    }
    for (unsigned i = 0; (I2C(I_CR1) & STOP) != 0 && i < TRIES; i++) {
    }
    return (I2C(I_SR1) & (ERRORS | RXNE | BTF)) == 0;
}

#endif
