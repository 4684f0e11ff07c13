// SPDX-License-Identifier: MIT
// Tests firmware/stm32 by hand: each received letter calls one function of board.h and
// prints a line, or does something that must end in a reset (break_down.c).
// test_board.py sends the letters; tests/generic/letters.c has those of all boards.
#include "board.h"

#include <string.h>

#include "break_down.h"
#include "core/wire/messages.h"
#include "letters.h"
#include "stm32/pins.h"
#include "stm32/power.h"
#include "stm32/radio.h"
#include "stm32/registers.h"

enum {
    GYR = 0x6B,
    XM = 0x1D,
    WHO_AM_I = 0x0F,
    CTRL_REG1 = 0x20,  // of either half
    OUT_X_G = 0x28,
    STATUS = 0x27,
    STATUS_M = 0x07,
    MANY = 0x80,  // the register number increments automatically
};

static const struct bus_burst whole[] = {
    {GYR, STATUS | MANY, 7}, {XM, STATUS | MANY, 7}, {XM, STATUS_M | MANY, 7}};
// One, two and three bytes, which the hardware wants each in its own way, behind and in
// front of a repeated START.
static const struct bus_burst short_first[] = {
    {XM, WHO_AM_I, 1}, {XM, CTRL_REG1 | MANY, 2}, {GYR, OUT_X_G | MANY, 6}};
static const struct bus_burst short_last[] = {
    {GYR, OUT_X_G | MANY, 6}, {XM, CTRL_REG1 | MANY, 3}, {XM, WHO_AM_I, 1}};
static const struct bus_burst two_last[] = {{GYR, OUT_X_G | MANY, 6},
                                            {XM, CTRL_REG1 | MANY, 2}};

static void put_word(uint32_t word) {
    uint8_t bytes[4];
    for (uint8_t i = 0; i < sizeof bytes; i++) {
        bytes[i] = (uint8_t)(word >> (24 - 8 * i));
    }
    put_hex(bytes, sizeof bytes);
}

static uint8_t lows, links, drops, faults;  // told by power and radio

void letters_rest(void) {
    board_watchdog_kick();
    lows = (uint8_t)(lows + power_step(board_time_us()));
    const enum rn41_event event = radio_step(board_time_us());
    links = (uint8_t)(links + (event == RN41_LINKED));
    drops = (uint8_t)(drops + (event == RN41_DROPPED));
    faults = (uint8_t)(faults + (event == RN41_FAULT));
    board_idle();
}

// 380 readings a second, each with data-ready at DRDY_G; 400 and 100 of the other half.
static void set_chip_up(enum bus_result results[2]) {
    static const uint8_t gyr[] = {0x8F, 0x00, 0x08, 0xA0};
    static const uint8_t xm[] = {0x8F, 0x20, 0x00, 0x00, 0x74, 0x00, 0x00};
    const IN_FLASH struct bus_device *bus = &board_bus;
    results[0] = bus->write(bus->port, XM, CTRL_REG1 | MANY, xm, sizeof xm);
    results[1] = bus->write(bus->port, GYR, CTRL_REG1 | MANY, gyr, sizeof gyr);
}

const struct letters_sensor letters_sensor = {
    .address = GYR,
    .who_am_i = WHO_AM_I,
    .absent = 0x22,
    .sample_bytes = 21,
    .bursts = whole,
    .bursts_count = 3,
    .set_up = set_chip_up,
};

// More than the ring holds: what fits, and one more.
static void fill_wire(void) {
    static uint8_t bytes[250];
    await_idle_wire();
    const bool one = board_send((const uint8_t *)"-", 1);  // at once in the hardware
    const bool is_gone = board_send_is_idle();
    await_idle_wire();
    memset(bytes, '.', sizeof bytes);
    uint8_t sent = 0;
    while (board_send(bytes, 250)) {
        sent++;
    }
    const bool is_idle = board_send_is_idle();
    await_idle_wire();
    say("");
    put("sent");
    put_number(one);
    put_number(sent);
    put_number(is_gone);
    put_number(is_idle);
    end_line();
}

// As much as raw and pose at 380 Hz are, 38 kB, in a second; counts what is refused.
static void stream(void) {
    static uint8_t bytes[100];
    memset(bytes, ':', sizeof bytes);
    int32_t refused = 0;
    const uint32_t begun = board_time_us();
    for (uint16_t i = 0; i < 380; i++) {
        while (board_time_us() - begun < (uint32_t)i * 2631) {
            letters_rest();
        }
        refused += !board_send(bytes, sizeof bytes);
    }
    say("");
    put("refused");
    put_number(refused);
    end_line();
}

// A second of CTS held high, by the pull of its pin, in the middle of a message; how
// long board_send_is_idle() waits for that.
static void hold_wire(void) {
    await_idle_wire();
    GPIOA->pupdr ^= UINT32_C(3) << (2 * PIN_CTS);
    const bool is_taken = board_send((const uint8_t *)"held", 4);
    const uint32_t begun = board_time_us();
    await_idle_wire();
    const uint32_t took = board_time_us() - begun;
    while (board_time_us() - begun < 1000000) {
        letters_rest();
    }
    GPIOA->pupdr ^= UINT32_C(3) << (2 * PIN_CTS);
    say("");
    put("held");
    put_number(is_taken);
    put_number((int32_t)took);
    end_line();
}

static void tell_radio(void) {
    put("radio");
    put_number((int32_t)radio_state());
    put_number(radio_resets());
    put_number((int32_t)radio_cause());
    put_number(links);
    put_number(drops);
    put_number(faults);
    end_line();
}

static void tell_battery(void) {
    put("battery");
    put_number(power_battery_mv());
    put_number(power_flags());
    put_number(lows);
    end_line();
}

static void look_at_storage(void) {
    const struct memory *storage = &board_memory;
    put("holds");
    put_number(storage->read(storage->port, 100));
    put_number(storage->read(storage->port, 119));
    end_line();
}

static void watch_clock(void) {
    uint32_t longest = 0;
    uint32_t before = board_time_us();
    const uint32_t begun = before;
    while (before - begun < 100000) {
        const uint32_t now = board_time_us();
        longest = now - before > longest ? now - before : longest;
        before = now;
    }
    put("clock");
    put_number((int32_t)longest);
    end_line();
}

static void tell_id(void) {
    uint8_t id[8] = {0};
    put("id");
    put_number(board_unique_id(id));
    put_hex(id, sizeof id);
    end_line();
}

static void obey(char letter) {
    switch (letter) {
    case '2':
        read_registers(XM, CTRL_REG1 | MANY, 2);
        break;
    case '3':
        read_registers(XM, CTRL_REG1 | MANY, 3);
        break;
    case '4':
        read_registers(XM, CTRL_REG1 | MANY, 4);
        break;
    case '<':
        start_sampling(short_first, 3);
        break;
    case '>':
        start_sampling(short_last, 3);
        break;
    case '=':
        start_sampling(two_last, 2);
        break;
    case 'f':
        fill_wire();
        break;
    case 'k':
        look_at_storage();
        break;
    case 'i':
        tell_id();
        break;
    case 'c':
        watch_clock();
        break;
    case 'a':
        stream();
        break;
    case 'j':
        hold_wire();
        break;
    case 'g':
        tell_radio();
        break;
    case 'y':
        tell_battery();
        break;
    case 'S':
        power_sleep();
    default:
        break_down(letter);
        break;
    }
}

int main(void) {
    board_init();
    const uint8_t cause = board_reset_cause();
    put("start");
    put_hex(&cause, 1);
    put_word(board_reset_address());
    end_line();
    obey_for_ever(obey);
}
