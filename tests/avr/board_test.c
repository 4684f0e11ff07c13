// SPDX-License-Identifier: MIT
// Tests firmware/avr by hand: each received letter calls one function of board.h and
// prints a line, or does something that must end in a reset. test_board.py sends the
// letters; tests/generic/letters.c has those of all boards.
#include "board.h"

#include <avr/interrupt.h>
#include <string.h>

#include "letters.h"

enum { ADDRESS = 0x68, WHO_AM_I = 0x75, FIRST_DATA = 0x3B };

static const struct bus_burst burst = {ADDRESS, FIRST_DATA, 14};

// 200 samples a second, each a pulse on INT.
static void set_chip_up(enum bus_result results[2]) {
    static const uint8_t rate[] = {4, 2, 0x18, 0x18, 2};  // SMPLRT_DIV and on
    static const uint8_t pulse[] = {0, 1};                // INT_PIN_CFG, INT_ENABLE
    const IN_FLASH struct bus_device *bus = &board_bus;
    results[0] = bus->write(bus->port, ADDRESS, 0x19, rate, 5);
    results[1] = bus->write(bus->port, ADDRESS, 0x37, pulse, 2);
}

const struct letters_sensor letters_sensor = {
    .address = ADDRESS,
    .who_am_i = WHO_AM_I,
    .absent = 0x22,
    .sample_bytes = 14,
    .bursts = &burst,
    .bursts_count = 1,
    .set_up = set_chip_up,
};

void letters_rest(void) {
    board_watchdog_kick();
    board_idle();
}

// More than the ring holds, in two parts that fit and one that does not.
static void fill_wire(void) {
    static uint8_t bytes[150];
    await_idle_wire();
    const bool one = board_send((const uint8_t *)"-", 1);  // straight to the UART
    const bool is_gone = board_send_is_idle();
    await_idle_wire();
    memset(bytes, '.', sizeof bytes);
    const bool first = board_send(bytes, 150);
    const bool second = board_send(bytes, 60);
    const bool third = board_send(bytes, 40);
    const bool is_idle = board_send_is_idle();
    await_idle_wire();
    say("");
    put("sent");
    put_number(one);
    put_number(first);
    put_number(second);
    put_number(third);
    put_number(is_gone);
    put_number(is_idle);
    end_line();
}

// Reads the clock over at least one overflow of its timer, with interrupts on and off.
static void watch_clock(void) {
    uint32_t longest = 0;
    uint32_t before = board_time_us();
    const uint32_t begun = before;
    for (uint16_t i = 0; before - begun < 100000; i++) {
        if ((i & 1) != 0) {
            cli();
        }
        const uint32_t now = board_time_us();
        sei();
        longest = now - before > longest ? now - before : longest;
        before = now;
    }
    put("clock");
    put_number((int32_t)longest);
    end_line();
}

// What the watchdog's interrupt does after ATmegaBOOT, at a moment of a burst that the
// next letter says, 25 us apart; with interrupts enabled that nobody handles.
static void strike(void) {
    int16_t letter;
    while ((letter = board_receive()) < 0) {
    }
    const uint32_t edges = board_samples_ready();
    while (board_samples_ready() == edges) {
    }
    wait_us((uint32_t)(letter - 'A') * 25);
    cli();
    PCICR = TIMSK0 = TIMSK2 = 7;
    SPCR = _BV(SPIE);
    ACSR = _BV(ACIE);
    SPMCSR = _BV(SPMIE);
    __asm__ volatile("jmp __vector_default");
}

static void tell_entropy(void) {
    put("entropy");
    put_number(board_entropy());
    put_number(board_entropy());
    end_line();
}

static void tell_masks(void) {
    put("masks");
    put_number(PCICR | TIMSK0 | TIMSK2 | SPCR | (ACSR & _BV(ACIE)) | SPMCSR);
    end_line();
}

static void obey(char letter) {
    switch (letter) {
    case 'f':
        fill_wire();
        break;
    case 'x':
        tell_entropy();
        break;
    case 'c':
        watch_clock();
        break;
    case 'k':
        tell_masks();
        break;
    case 'J':
        strike();
        break;
    case 'R':
        board_reset();
    case 'H':  // hangs, interrupts on
        for (;;) {
        }
    case 'I':  // an interrupt that nobody handles
        TIMSK0 = _BV(TOIE0);
        TCCR0B = _BV(CS00);
        for (;;) {
            board_watchdog_kick();
        }
    default:
        say("what is that");
        break;
    }
}

int main(void) {
    board_init();
    const uint8_t cause = board_reset_cause();
    put("start");
    put_hex(&cause, 1);
    end_line();
    obey_for_ever(obey);
}
