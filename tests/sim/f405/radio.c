// SPDX-License-Identifier: MIT
// The radio at 921,600 baud: start-up, command mode, connection, data in both
// directions, and a reset by its pin.
#include "bare.h"

static char answer[64];
static uint8_t got[256];

static void on_tick(void) {
}

// Sleeps until the next tick, at most 0.1 ms.
static void doze(void) {
    __asm__ volatile("wfi");
}

static uint32_t pio2(void) {
    return (GPIO(GPIOB, IDR) >> 12) & 1;
}

static void put(const char *text) {
    for (; *text != '\0'; text++) {
        while ((USART(U_SR) & BIT(7)) == 0) {
        }
        USART(U_DR) = (uint8_t)*text;
    }
}

// Receives up to a line feed, for half a second at most.
static unsigned take_line(void) {
    unsigned length = 0;
    for (const uint32_t from = now_us(); now_us() - from < 500000;) {
        if ((USART(U_SR) & BIT(5)) != 0) {
            answer[length] = (char)USART(U_DR);
            if (answer[length++] == '\n' || length == sizeof answer) {
                break;
            }
        }
    }
    return length;
}

static uint32_t word(unsigned at) {
    uint32_t value = 0;
    for (unsigned i = 0; i < 4; i++) {
        value = value << 8 | (uint8_t)answer[at + i];
    }
    return value;
}

static void receive_late(void) {
    // 200 bytes come at 4 s. Nothing reads them until 4.1 s, and RTS holds them back.
    while (now_us() < 4100000) {
        doze();
    }
    const uint32_t errors = USART(U_SR) & 0x0F;
    unsigned count = 0;
    for (uint32_t last = now_us(); now_us() - last < 100000;) {
        if ((USART(U_SR) & BIT(5)) != 0) {
            got[count++ % sizeof got] = (uint8_t)USART(U_DR);
            last = now_us();
        }
    }
    uint32_t right = 0;
    for (unsigned i = 0; i < count && i < sizeof got; i++) {
        right += got[i] == i ? 1U : 0U;
    }
    say("errors", errors);
    say("count", count);
    say("right", right);
}

// Resets the radio by its pin, as an open drain.
static void reset_by_pin(void) {
    flush();
    wait_us(200000);
    GPIO(GPIOB, OTYPER) |= BIT(13);
    GPIO(GPIOB, BSRR) = BIT(29);
    pin_mode(GPIOB, 13, 1);
    wait_us(10000);
    const uint32_t during = pio2();
    GPIO(GPIOB, BSRR) = BIT(13);
    const uint32_t released = now_us();
    while (pio2() != 0) {
        doze();
    }
    const uint32_t again = now_us() - released;
    while (pio2() == 0) {
        doze();
    }
    say("during", during);
    say("again", again);
}

void program(void) {
    vectors[TICK] = on_tick;
    SYSTICK(4) = 1599;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    pin_pull_up(GPIOB, 12);
    GPIO(GPIOA, PUPDR) = (GPIO(GPIOA, PUPDR) & ~UINT32_C(3)) | 2;
    pin_alternate(GPIOA, 0, 7);
    pin_alternate(GPIOA, 1, 7);
    USART(U_BRR) = 17;  // 941,176: 2.1 % too fast
    USART(U_CR3) = BIT(9) | BIT(8);
    const uint32_t starting = pio2();
    while (pio2() != 0) {
        doze();
    }
    const uint32_t up = now_us();
    put("$$$");
    const unsigned entered = take_line();
    const uint32_t command = word(0);
    put("GN\r");
    const unsigned length = take_line();
    const uint32_t name = word(0);
    put("---\r");
    const unsigned left = take_line();
    while (pio2() == 0) {
        doze();
    }
    const uint32_t connected = now_us();
    say("starting", starting);
    say("up", up);
    say("entered", entered);
    say("command", command);
    say("length", length);
    say("name", name);
    say("left", left);
    say("connected", connected);
    receive_late();
    flush();
    const uint32_t from = now_us();
    for (unsigned i = 0; i < 20000; i++) {
        while ((USART(U_SR) & BIT(7)) == 0) {
        }
        USART(U_DR) = i == 19999 ? '\n' : '.';
    }
    flush();
    say("us", now_us() - from);
    reset_by_pin();
    flush();
    wait_us(100000);
}
