// SPDX-License-Identifier: MIT
// Tests firmware/avr by hand: each received letter calls one function of board.h and
// prints a line, or does something that must end in a reset. test_board.py sends the
// letters.
#include "board.h"

#include <avr/interrupt.h>
#include <stdio.h>
#include <string.h>

enum { ADDRESS = 0x68, ABSENT = 0x22, WHO_AM_I = 0x75, FIRST_DATA = 0x3B };

static const struct bus_burst burst = {ADDRESS, FIRST_DATA, 14};

static void say(const char *text) {
    while (!board_send((const uint8_t *)text, (uint8_t)strlen(text))) {
        board_watchdog_kick();
        board_idle();
    }
}

#define SAY(...)                                                                       \
    do {                                                                               \
        char line[64];                                                                 \
        (void)snprintf(line, sizeof line, __VA_ARGS__);                                \
        say(line);                                                                     \
    } while (0)

static void read_chip(uint8_t address) {
    uint8_t value = 0;
    const IN_FLASH struct bus_device *bus = &board_bus;
    const uint32_t begun = board_time_us();
    const enum bus_result result = bus->read(bus->port, address, WHO_AM_I, &value, 1);
    SAY("read %d %02x %lu\n", result, value, board_time_us() - begun);
}

static void recover(void) {
    const uint32_t begun = board_time_us();
    const enum bus_result result = board_bus_recover();
    SAY("recover %d %lu\n", result, board_time_us() - begun);
}

// 200 samples a second, each a pulse on INT.
static void set_chip_up(void) {
    static const uint8_t rate[] = {4, 2, 0x18, 0x18, 2};  // SMPLRT_DIV and on
    static const uint8_t pulse[] = {0, 1};                // INT_PIN_CFG, INT_ENABLE
    const IN_FLASH struct bus_device *bus = &board_bus;
    const enum bus_result first = bus->write(bus->port, ADDRESS, 0x19, rate, 5);
    const enum bus_result second = bus->write(bus->port, ADDRESS, 0x37, pulse, 2);
    SAY("set up %d %d\n", first, second);
}

static void take_all(void) {
    struct reading sample;
    uint16_t taken = 0;
    uint16_t missed = 0;
    enum reading_result result = board_reading_take(&sample);
    for (; result == READING_OK; result = board_reading_take(&sample)) {
        taken++;
        missed = (uint16_t)(missed + sample.missed);
    }
    SAY("took %u missed %u ready %lu then %d %d\n", taken, missed,
        board_samples_ready(), result < 0 ? -1 : result, result < 0 ? result : 0);
}

static void one_sample(void) {
    struct reading sample;
    while (board_reading_take(&sample) != READING_OK) {
        board_idle();
    }
    SAY("sample 0x%02x%02x at %lu missed %u ready %lu\n", sample.bytes[4],
        sample.bytes[5], sample.time_us, sample.missed, board_samples_ready());
}

static void wait_us(uint32_t us) {
    const uint32_t begun = board_time_us();
    while (board_time_us() - begun < us) {
    }
}

// More than the ring holds, in two parts that fit and one that does not.
static void fill_wire(void) {
    static uint8_t bytes[150];
    while (!board_send_is_idle()) {
        board_idle();
    }
    const bool one = board_send((const uint8_t *)"-", 1);  // straight to the UART
    const bool is_gone = board_send_is_idle();
    while (!board_send_is_idle()) {
        board_idle();
    }
    memset(bytes, '.', sizeof bytes);
    const bool first = board_send(bytes, 150);
    const bool second = board_send(bytes, 60);
    const bool third = board_send(bytes, 40);
    const bool is_idle = board_send_is_idle();
    while (!board_send_is_idle()) {
        board_idle();
    }
    SAY("\nsent %d %d %d %d gone %d idle %d\n", one, first, second, third, is_gone,
        is_idle);
}

static void use_eeprom(void) {
    const IN_FLASH struct memory *storage = &board_memory;
    uint8_t differences = 0;
    for (uint16_t offset = 500; offset < 520; offset++) {
        storage->write(storage->port, offset, (uint8_t)(offset * 7));
        while (!storage->is_ready(storage->port)) {
            board_watchdog_kick();
        }
    }
    for (uint16_t offset = 500; offset < 520; offset++) {
        if (storage->read(storage->port, offset) != (uint8_t)(offset * 7)) {
            differences++;
        }
    }
    SAY("eeprom %u %02x\n", differences, storage->read(storage->port, 520));
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
    SAY("clock %lu\n", longest);
}

__attribute__((noinline)) static void go_deep(void) {
    volatile uint8_t bytes[300];
    for (uint16_t i = 0; i < sizeof bytes; i++) {
        bytes[i] = 0;
    }
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

static void obey(char letter) {
    switch (letter) {
    case 'r':
        read_chip(ADDRESS);
        break;
    case 'n':
        read_chip(ABSENT);
        break;
    case 'v':
        recover();
        break;
    case 'u':
        set_chip_up();
        break;
    case 's':
        board_sampling_start(&burst, 1);
        say("started\n");
        break;
    case 'p':
        board_sampling_stop();
        say("stopped\n");
        break;
    case 't':
        take_all();
        break;
    case 'o':
        one_sample();
        break;
    case 'w':
        wait_us(52000);
        say("waited\n");
        break;
    case 'l':
        SAY("lost %u\n", board_receive_lost());
        break;
    case 'f':
        fill_wire();
        break;
    case 'e':
        use_eeprom();
        break;
    case 'x':
        SAY("entropy %04x %04x\n", board_entropy(), board_entropy());
        break;
    case 'm':
        SAY("supply %u\n", board_supply_mv());
        break;
    case 'c':
        watch_clock();
        break;
    case 'd':
        SAY("stack %u ", board_stack_free());
        go_deep();
        SAY("%u\n", board_stack_free());
        break;
    case 'b':
        SAY("button %d\n", board_button_is_down());
        break;
    case 'k':
        SAY("masks %d\n", PCICR | TIMSK0 | TIMSK2 | SPCR | (ACSR & _BV(ACIE)) | SPMCSR);
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
        SAY("what is %c\n", letter);
        break;
    }
}

int main(void) {
    board_init();
    SAY("start %02x\n", board_reset_cause());
    for (;;) {
        board_watchdog_kick();
        const int16_t byte = board_receive();
        if (byte >= 0) {
            obey((char)byte);
        } else {
            board_idle();
        }
    }
}
