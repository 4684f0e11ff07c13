// SPDX-License-Identifier: MIT
// A log of two seconds on the card in the socket, with raw and pose of a sample 380
// times a second as its frames: what it took of the processor, and what became of it.
// test_spi.py reads the lines.
#include <string.h>

#include "board.h"
#include "core/storage/logbook.h"
#include "core/wire/messages.h"
#include "stm32/radio.h"
#include "stm32/spi.h"

enum {
    FRAME = 118,
    PERIOD_US = 1000000 / 380,
    LOG_US = 2000000,
    LOOK_US = 3000000,  // for a card that is ready, then the log is closed
};

static struct logbook book;
static uint8_t ring[65536];
static uint32_t longest_us;
static uint32_t steps;
static uint32_t kept, dropped;

static void rest(void) {
    board_watchdog_kick();
    (void)radio_step(board_time_us());  // finds that there is a cable
    board_idle();
}

static void put_line(const char *word, uint32_t value) {
    char line[40];
    char digits[11];
    uint8_t used = 0;
    uint8_t at = sizeof digits;
    for (; word[used] != '\0'; used++) {
        line[used] = word[used];
    }
    line[used++] = ' ';
    do {
        digits[--at] = (char)('0' + value % 10);
        value /= 10;
    } while (value != 0);
    memcpy(line + used, digits + at, sizeof digits - at);
    used = (uint8_t)(used + sizeof digits - at);
    line[used++] = '\n';
    while (!board_send((const uint8_t *)line, used)) {
        rest();
    }
}

static void step(void) {
    board_watchdog_kick();
    const uint32_t begun_us = board_time_us();
    const bool goes_on = logbook_step(&book, begun_us);
    const uint32_t took_us = board_time_us() - begun_us;
    longest_us = took_us > longest_us ? took_us : longest_us;
    steps++;
    struct logbook_change change;
    while (logbook_take_change(&book, &change)) {
        put_line(change.event == EVENT_CARD_READY    ? "ready"
                 : change.event == EVENT_LOG_STARTED ? "started"
                 : change.event == EVENT_LOG_ENDED   ? "ended"
                                                     : "fault",
                 change.cause);
    }
    if (!goes_on) {
        rest();
    }
}

// Eight digits, dots, a zero.
static void keep(uint32_t number) {
    uint8_t frame[FRAME];
    memset(frame, '.', sizeof frame);
    for (uint8_t i = 8; i > 0; i--) {
        frame[i - 1] = (uint8_t)('0' + number % 10);
        number /= 10;
    }
    frame[FRAME - 1] = 0;
    if (logbook_put(&book, frame, sizeof frame)) {
        kept++;
    } else {
        dropped++;
    }
}

static enum card state(void) {
    struct message_equipment told;
    logbook_describe(&book, &told);
    return (enum card)told.card;
}

int main(void) {
    board_init();
    spi_init();
    logbook_init(&book, spi_card(), ring, sizeof ring);
    while (state() != CARD_READY && board_time_us() < LOOK_US) {
        step();
    }
    put_line("looked", board_time_us());
    if (logbook_open(&book)) {
        const uint32_t begun_us = board_time_us();
        uint32_t number = 0;
        while (board_time_us() - begun_us < LOG_US) {
            if (board_time_us() - begun_us >= number * PERIOD_US) {
                number++;
                keep(number);
            }
            step();
        }
        logbook_close(&book, CAUSE_COMMAND);
        while (!logbook_is_idle(&book)) {
            step();
        }
    }
    struct message_equipment told;
    logbook_describe(&book, &told);
    put_line("state", told.card);
    put_line("block", told.card_block);
    put_line("faults", told.card_faults);
    put_line("kept", kept);
    put_line("dropped", dropped);
    put_line("steps", steps);
    put_line("longest", longest_us);
    for (;;) {
        rest();
    }
}
