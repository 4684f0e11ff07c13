// SPDX-License-Identifier: MIT
// Tests firmware/stm32 by hand: each received letter calls one function of board.h and
// prints a line, or does something that must end in a reset (break_down.c).
// test_board.py sends the letters.
#include "board.h"

#include <string.h>

#include "break_down.h"
#include "core/wire/messages.h"
#include "stm32/pins.h"
#include "stm32/power.h"
#include "stm32/radio.h"
#include "stm32/registers.h"

enum {
    GYR = 0x6B,
    XM = 0x1D,
    ABSENT = 0x22,
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

static char line[120];
static uint8_t used;

static void put(const char *text) {
    for (; *text != '\0' && used < sizeof line; text++) {
        line[used++] = *text;
    }
}

static void put_number(int32_t value) {
    char digits[12];
    uint8_t at = sizeof digits;
    uint32_t rest = value < 0 ? (uint32_t)-value : (uint32_t)value;
    digits[--at] = '\0';
    do {
        digits[--at] = (char)('0' + rest % 10);
        rest /= 10;
    } while (rest != 0);
    put(value < 0 ? " -" : " ");
    put(digits + at);
}

static void put_hex(const uint8_t *bytes, uint8_t length) {
    static const char digits[] = "0123456789abcdef";
    put(" ");
    for (uint8_t i = 0; i < length; i++) {
        const char pair[] = {digits[bytes[i] >> 4], digits[bytes[i] & 15], '\0'};
        put(pair);
    }
}

static void put_word(uint32_t word) {
    uint8_t bytes[4];
    for (uint8_t i = 0; i < sizeof bytes; i++) {
        bytes[i] = (uint8_t)(word >> (24 - 8 * i));
    }
    put_hex(bytes, sizeof bytes);
}

static uint8_t lows, links, drops, faults;  // told by power and radio

static void rest(void) {
    board_watchdog_kick();
    lows = (uint8_t)(lows + power_step(board_time_us()));
    const enum rn41_event event = radio_step(board_time_us());
    links = (uint8_t)(links + (event == RN41_LINKED));
    drops = (uint8_t)(drops + (event == RN41_DROPPED));
    faults = (uint8_t)(faults + (event == RN41_FAULT));
    board_idle();
}

static void end_line(void) {
    put("\n");
    while (!board_send((const uint8_t *)line, used)) {
        rest();
    }
    used = 0;
}

static void say(const char *text) {
    put(text);
    end_line();
}

static void read_chip(uint8_t address, uint8_t reg, uint8_t length) {
    uint8_t bytes[8] = {0};
    const IN_FLASH struct bus_device *bus = &board_bus;
    const uint32_t begun = board_time_us();
    const enum bus_result result = bus->read(bus->port, address, reg, bytes, length);
    const uint32_t took = board_time_us() - begun;
    put("read");
    put_number(result);
    put_hex(bytes, length);
    put_number((int32_t)took);
    end_line();
}

static void recover(void) {
    const uint32_t begun = board_time_us();
    const enum bus_result result = board_bus_recover();
    const uint32_t took = board_time_us() - begun;
    put("recover");
    put_number(result);
    put_number((int32_t)took);
    end_line();
}

// 380 readings a second, each with data-ready at DRDY_G; 400 and 100 of the other half.
static void set_chip_up(void) {
    static const uint8_t gyr[] = {0x8F, 0x00, 0x08, 0xA0};
    static const uint8_t xm[] = {0x8F, 0x20, 0x00, 0x00, 0x74, 0x00, 0x00};
    const IN_FLASH struct bus_device *bus = &board_bus;
    const enum bus_result first =
        bus->write(bus->port, XM, CTRL_REG1 | MANY, xm, sizeof xm);
    const enum bus_result second =
        bus->write(bus->port, GYR, CTRL_REG1 | MANY, gyr, sizeof gyr);
    put("set up");
    put_number(first);
    put_number(second);
    end_line();
}

static void take_all(void) {
    struct reading sample;
    int32_t taken = 0;
    int32_t missed = 0;
    enum reading_result result = board_reading_take(&sample);
    for (; result == READING_OK; result = board_reading_take(&sample)) {
        taken++;
        missed += sample.missed;
    }
    put("took");
    put_number(taken);
    put_number(missed);
    put_number((int32_t)board_samples_ready());
    put_number(result < 0 ? -1 : result);
    put_number(result < 0 ? result : 0);
    end_line();
}

static void one_sample(void) {
    struct reading sample;
    while (board_reading_take(&sample) != READING_OK) {
        board_idle();
    }
    put("sample");
    put_hex(sample.bytes, 21);
    put_number((int32_t)sample.time_us);
    put_number(sample.missed);
    put_number((int32_t)board_samples_ready());
    end_line();
}

static void wait_us(uint32_t us) {
    const uint32_t begun = board_time_us();
    while (board_time_us() - begun < us) {
        board_watchdog_kick();
    }
}

// More than the ring holds: what fits, and one more.
static void fill_wire(void) {
    static uint8_t bytes[250];
    while (!board_send_is_idle()) {
        rest();
    }
    const bool one = board_send((const uint8_t *)"-", 1);  // at once in the hardware
    const bool is_gone = board_send_is_idle();
    while (!board_send_is_idle()) {
        rest();
    }
    memset(bytes, '.', sizeof bytes);
    uint8_t sent = 0;
    while (board_send(bytes, 250)) {
        sent++;
    }
    const bool is_idle = board_send_is_idle();
    while (!board_send_is_idle()) {
        rest();
    }
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
            rest();
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
    while (!board_send_is_idle()) {
        rest();
    }
    GPIOA->pupdr ^= UINT32_C(3) << (2 * PIN_CTS);
    const bool is_taken = board_send((const uint8_t *)"held", 4);
    const uint32_t begun = board_time_us();
    while (!board_send_is_idle()) {
        rest();
    }
    const uint32_t took = board_time_us() - begun;
    while (board_time_us() - begun < 1000000) {
        rest();
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

static void use_storage(void) {
    const struct memory *storage = &board_memory;
    int32_t differences = 0;
    uint32_t longest = 0;
    for (uint16_t offset = 100; offset < 120; offset++) {
        const uint32_t begun = board_time_us();
        storage->write(storage->port, offset, (uint8_t)(offset * 7));
        const uint32_t took = board_time_us() - begun;
        longest = took > longest ? took : longest;
        while (!storage->is_ready(storage->port)) {
            board_watchdog_kick();
        }
    }
    for (uint16_t offset = 100; offset < 120; offset++) {
        if (storage->read(storage->port, offset) != (uint8_t)(offset * 7)) {
            differences++;
        }
    }
    put("stored");
    put_number(differences);
    put_number(storage->read(storage->port, 120));
    put_number((int32_t)longest);
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

__attribute__((noinline)) static void go_deep(void) {
    volatile uint8_t bytes[600];
    for (uint16_t i = 0; i < sizeof bytes; i++) {
        bytes[i] = 0;
    }
}

static void measure_stack(void) {
    put("stack");
    put_number(board_stack_free());
    go_deep();
    put_number(board_stack_free());
    end_line();
}

static void tell_id(void) {
    uint8_t id[8] = {0};
    put("id");
    put_number(board_unique_id(id));
    put_hex(id, sizeof id);
    end_line();
}

static void start_sampling(const struct bus_burst *bursts, uint8_t count) {
    board_sampling_start(bursts, count);
    say("started");
}

static void obey(char letter) {
    switch (letter) {
    case 'r':
        read_chip(GYR, WHO_AM_I, 1);
        break;
    case '2':
        read_chip(XM, CTRL_REG1 | MANY, 2);
        break;
    case '3':
        read_chip(XM, CTRL_REG1 | MANY, 3);
        break;
    case '4':
        read_chip(XM, CTRL_REG1 | MANY, 4);
        break;
    case 'n':
        read_chip(ABSENT, WHO_AM_I, 1);
        break;
    case 'v':
        recover();
        break;
    case 'u':
        set_chip_up();
        break;
    case 's':
        start_sampling(whole, 3);
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
    case 'p':
        board_sampling_stop();
        say("stopped");
        break;
    case 't':
        take_all();
        break;
    case 'o':
        one_sample();
        break;
    case 'w':
        wait_us(52000);
        say("waited");
        break;
    case 'l':
        put("lost");
        put_number(board_receive_lost());
        end_line();
        break;
    case 'f':
        fill_wire();
        break;
    case 'e':
        use_storage();
        break;
    case 'k':
        look_at_storage();
        break;
    case 'i':
        tell_id();
        break;
    case 'm':
        put("supply");
        put_number(board_supply_mv());
        end_line();
        break;
    case 'c':
        watch_clock();
        break;
    case 'd':
        measure_stack();
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
    case 'b':
        put("button");
        put_number(board_button_is_down());
        end_line();
        break;
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
    for (;;) {
        board_watchdog_kick();
        const int16_t byte = board_receive();
        if (byte >= 0) {
            obey((char)byte);
        } else {
            rest();
        }
    }
}
