// SPDX-License-Identifier: MIT
// A card on SPI1: identified at 250 kHz, then five blocks written and read back by DMA
// at 8 MHz. Their content is numbered() of test_sdcard.py.
#include "bare.h"

enum {
    BLOCK = 512,
    FIRST = 40,  // first block
    BLOCKS = 5,  // the first alone, the others in a run
    TRIES = 200000,
    RXNE = 1,
    BSY = 128,
    SLOWLY = 5 << 3,  // 16 MHz / 64
    QUICKLY = 0,      // 16 MHz / 2
};

static uint8_t sent[BLOCK + 2], got[BLOCK + 2];

static uint8_t exchange(uint8_t byte) {
    SPI(0x0C) = byte;
    while ((SPI(0x08) & RXNE) == 0) {
    }
    return (uint8_t)SPI(0x0C);
}

static void set_rate(uint32_t rate) {
    SPI(0x00) = BIT(9) | BIT(8) | BIT(2) | rate | BIT(6);
}

static void select(bool is_on) {
    GPIO(GPIOA, BSRR) = is_on ? BIT(16 + 4) : BIT(4);
    exchange(0xFF);
}

// Sends a command; returns R1, or 0xFF without an answer.
static uint8_t command(uint8_t index, uint32_t argument, uint8_t crc) {
    exchange(0xFF);
    exchange(0x40 | index);
    for (int shift = 24; shift >= 0; shift -= 8) {
        exchange((uint8_t)(argument >> shift));
    }
    exchange(crc);
    uint8_t r1 = 0xFF;
    for (unsigned i = 0; i < 10 && (r1 & 0x80) != 0; i++) {
        r1 = exchange(0xFF);
    }
    return r1;
}

static uint32_t word(void) {
    uint32_t value = 0;
    for (unsigned i = 0; i < 4; i++) {
        value = value << 8 | exchange(0xFF);
    }
    return value;
}

static bool wait_for(uint8_t byte) {
    for (uint32_t i = 0; i < TRIES; i++) {
        if (exchange(0xFF) == byte) {
            return true;
        }
    }
    return false;
}

// Sends `sent` by stream 3 and receives `got` by stream 0 of DMA2, both channel 3.
static void exchange_all(void) {
    AT(0x40026408) = AT(0x4002640C) = 0xFFFFFFFF;
    const volatile void *ends[2] = {got, sent};
    for (unsigned i = 0; i < 2; i++) {
        const unsigned stream = i == 0 ? 0 : 3;
        DMA2_STREAM(stream, S_NDTR) = sizeof sent;
        DMA2_STREAM(stream, S_PAR) = 0x4001300C;
        DMA2_STREAM(stream, S_M0AR) = (uint32_t)ends[i];
        DMA2_STREAM(stream, S_CR) = 3U << 25 | BIT(10) | (i == 0 ? 0 : BIT(6)) | BIT(0);
    }
    SPI(0x04) = BIT(0) | BIT(1);
    while ((AT(0x40026400) & BIT(5)) == 0) {  // TCIF of stream 0
    }
    SPI(0x04) = 0;
}

static void fill(uint32_t block) {
    for (unsigned i = 0; i < BLOCK; i++) {
        sent[i] = (uint8_t)(block * 7 + i * 13 + (i >> 8));
    }
}

// Writes a block; returns the low bits of the data response.
static uint8_t put(uint32_t block, uint8_t token) {
    fill(block);
    exchange(0xFF);
    exchange(token);
    exchange_all();
    const uint8_t response = exchange(0xFF) & 0x1F;
    const uint32_t from = now_us();
    (void)wait_for(0xFF);
    say("busy_us", now_us() - from);
    return response;
}

static bool read(uint32_t address, uint32_t block) {
    if (command(17, address, 0xFF) != 0 || !wait_for(0xFE)) {
        return false;
    }
    for (unsigned i = 0; i < sizeof sent; i++) {
        sent[i] = 0xFF;
    }
    exchange_all();
    fill(block);
    bool is_same = true;
    for (unsigned i = 0; i < BLOCK; i++) {
        is_same = is_same && got[i] == sent[i];
    }
    return is_same;
}

static bool identify(void) {
    const uint8_t idle = command(0, 0, 0x95);
    say("idle", idle);
    if (idle != 1 || command(8, 0x1AA, 0x87) != 1) {
        return false;
    }
    say("echo", word());
    for (unsigned i = 0; i < 1000; i++) {
        (void)command(55, 0, 0xFF);
        if (command(41, BIT(30), 0xFF) == 0) {
            return true;
        }
        wait_us(500);
    }
    return false;
}

void program(void) {
    RCC_APB2ENR |= BIT(12);
    RCC_AHB1ENR |= BIT(22);
    GPIO(GPIOA, BSRR) = BIT(4);
    pin_mode(GPIOA, 4, 1);
    for (unsigned pin = 5; pin <= 7; pin++) {
        pin_alternate(GPIOA, pin, 5);
    }
    set_rate(SLOWLY);
    wait_us(1000);
    for (unsigned i = 0; i < 10; i++) {
        exchange(0xFF);
    }
    select(true);
    if (!identify()) {
        return;
    }
    (void)command(58, 0, 0xFF);
    const uint32_t ocr = word();
    const uint32_t unit = (ocr & BIT(30)) != 0 ? 1 : BLOCK;
    say("ocr", ocr);
    set_rate(QUICKLY);
    say("r1", command(24, FIRST * unit, 0xFF));
    say("response", put(FIRST, 0xFE));
    say("r1", command(25, (FIRST + 1) * unit, 0xFF));
    bool is_good = true;
    for (uint32_t i = 1; i < BLOCKS && is_good; i++) {
        const uint8_t response = put(FIRST + i, 0xFC);
        say("response", response);
        is_good = response == 5;
    }
    if (is_good) {
        exchange(0xFF);
        exchange(0xFD);
        exchange(0xFF);
    } else {
        (void)command(12, 0, 0xFF);
    }
    (void)wait_for(0xFF);
    for (uint32_t i = 0; i < BLOCKS; i++) {
        say("same", read((FIRST + i) * unit, FIRST + i));
    }
    exchange(0xFF);
    select(false);
}
