// SPDX-License-Identifier: MIT
// The sensor's bus: reads of one to six bytes, NACKs, a read in the wrong order, and
// the recovery of a held line.
#include "i2c.h"

enum { G = 0x6B, XM = 0x1D, MORE = 0x80, WHO_AM_I = 0x0F, CTRL1 = 0x20 };

static void read_and_say(unsigned length) {
    uint8_t data[6] = {0};
    const bool is_good = i2c_read(G, CTRL1 | MORE, data, length);
    say("length", is_good ? length : 0);
    for (unsigned i = 0; i < length; i++) {
        say("data", data[i]);
    }
}

// Without POS, the NACK for the second byte comes too late and a third byte follows.
static void read_two_without_pos(void) {
    I2C(I_CR1) = PE | ACK;
    (void)i2c_point(G, CTRL1 | MORE);
    (void)i2c_address(G << 1 | 1);
    (void)I2C(I_SR2);
    (void)i2c_wait(BTF);
    I2C(I_CR1) &= ~(uint32_t)ACK;
    const uint32_t first = I2C(I_DR);
    const uint32_t second = I2C(I_DR);
    (void)i2c_wait(RXNE);
    say("late", first << 16 | second << 8 | I2C(I_DR));
    (void)i2c_stop(0);
}

// Nine clocks by hand, then a STOP.
static void recover(void) {
    I2C(I_CR1) = 0;
    GPIO(GPIOB, BSRR) = BIT(6) | BIT(7);
    pin_mode(GPIOB, 6, 1);
    pin_mode(GPIOB, 7, 1);
    unsigned pulses = 0;
    for (; pulses < 9 && (GPIO(GPIOB, IDR) & BIT(7)) == 0; pulses++) {
        GPIO(GPIOB, BSRR) = BIT(22);
        wait_us(5);
        GPIO(GPIOB, BSRR) = BIT(6);
        wait_us(5);
    }
    say("pulses", pulses);
    GPIO(GPIOB, BSRR) = BIT(23);
    wait_us(5);
    GPIO(GPIOB, BSRR) = BIT(7);
    wait_us(5);
    say("free", (GPIO(GPIOB, IDR) >> 6) & 3);
    i2c_setup();
}

void program(void) {
    i2c_setup();
    wait_us(30000);  // the sensor's start-up
    uint8_t who[2] = {0};
    say("good", i2c_read(G, WHO_AM_I, &who[0], 1));
    say("good", i2c_read(XM, WHO_AM_I, &who[1], 1));
    say("who", (uint32_t)who[0] << 8 | who[1]);
    static const uint8_t values[] = {0x0F, 0x00, 0x08, 0x30, 0x00};
    for (uint8_t i = 0; i < sizeof values; i++) {
        say("good", i2c_write(G, CTRL1 + i, values[i]));
    }
    for (unsigned length = 1; length <= 6; length++) {
        read_and_say(length);
    }
    read_two_without_pos();
    uint8_t data[6] = {0};
    const uint32_t from = now_us();
    (void)i2c_read(G, CTRL1 | MORE, data, 1);
    say("us", now_us() - from);
    // No device has that address.
    say("nobody", i2c_address(0x30 << 1));
    say("af", I2C(I_SR1));
    say("stopped", i2c_stop(AF));
    say("status", I2C(I_SR1) | I2C(I_SR2) << 16);
    read_and_say(3);
    // A held line does not change a zero that is sent, but it delays the STOP.
    const uint32_t start = now_us() + 2000;
    say("zero_at", start);
    flush();
    wait_us(start - now_us());
    const bool is_sent = i2c_write(G, CTRL1 + 1, 0x00);
    const uint32_t took = now_us() - start;
    say("zero", is_sent);
    say("zero_us", took);
    // The read that the faults of a test hit.
    wait_us(60000);
    i2c_errors = 0;
    say("at", now_us());
    flush();
    const bool is_good = i2c_read(G, CTRL1 | MORE, data, 6);
    const uint32_t sr1 = I2C(I_SR1) & ERRORS;
    say("faulty", is_good);
    say("busy", (I2C(I_SR2) >> 1) & 1);
    say("errors", i2c_errors | sr1);
    recover();
    read_and_say(2);
}
