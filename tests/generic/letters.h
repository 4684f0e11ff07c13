// SPDX-License-Identifier: MIT
// What board_test.c of each board has in common: lines of text without a C library, and
// letters that each call a function of board.h.
#ifndef LETTERS_H
#define LETTERS_H

#include "board.h"

// The sensor that the board is wired to.
struct letters_sensor {
    uint8_t address, who_am_i;
    uint8_t absent;  // an address that nobody has
    uint8_t sample_bytes;
    const struct bus_burst *bursts;
    uint8_t bursts_count;
    // Starts samples, each with an edge of data-ready; the results of two writes.
    void (*set_up)(enum bus_result results[2]);
};

extern const struct letters_sensor letters_sensor;
// A turn of the main loop without work.
void letters_rest(void);

// Parts of a line, each but the first with a space in front; then its end.
void put(const char *text);
void put_number(int32_t value);
void put_hex(const uint8_t *bytes, uint8_t length);
void end_line(void);
void say(const char *text);

void read_registers(uint8_t address, uint8_t reg, uint8_t length);
void start_sampling(const struct bus_burst *bursts, uint8_t count);
void wait_us(uint32_t us);
void await_idle_wire(void);
// False for a letter that only this board knows.
bool obey_common(char letter);
_Noreturn void obey_for_ever(void (*obey)(char letter));

#endif
