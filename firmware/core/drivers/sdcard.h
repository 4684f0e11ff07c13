// SPDX-License-Identifier: MIT
// An SD card in SPI mode: identification, single reads, runs of writes. One operation
// at a time, moved on by sdcard_step(), which never waits: 20 us of a Cortex-M4 at
// 168 MHz are the longest it takes.
#ifndef SDCARD_H
#define SDCARD_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/spi.h"

enum {
    SDCARD_BLOCK = 512,
    // A card may be busy for 250 ms (4.6.2.2; SDXC 500 ms): what takes that long is
    // slow, and a second is the end of patience. Reads come within 100 ms (4.6.2.1).
    SDCARD_SLOW_US = 250000,
    SDCARD_US_MAX = 1000000,
};

enum sdcard_result {
    SDCARD_OK = 0,
    SDCARD_WAITS = 1,     // for the wire or for time: call again when you are woken
    SDCARD_GOES_ON = 2,   // call again at once
    SDCARD_ABSENT = -1,   // nothing answers
    SDCARD_TIMEOUT = -2,  // busy, starting or silent for SDCARD_US_MAX
    SDCARD_REFUSED = -3,  // a command; or it is no SD card of up to 2 TB
    SDCARD_GARBLED = -4,  // checksums do not fit
    SDCARD_FAILED = -5,   // the card could not read or write the block
};

enum {
    SDCARD_ANSWER = 20,  // bytes of a command with all of its answer
    SDCARD_LEAD = 2,     // before a block's bytes: a pause, a token
    SDCARD_CRC = 2,      // behind them
};

struct sdcard {
    const struct spi_device *spi;
    uint32_t blocks;     // of SDCARD_BLOCK bytes; 0: not identified
    bool is_read_only;   // its own write protection, not a slider's
    uint16_t faults;     // commands and blocks that did not get through at once
    uint32_t busy_us;    // of the last write
    uint32_t address;    // of the operation's block
    uint32_t began_us;   // the exchange or the pause
    uint32_t waited_us;  // start of the wait for the card
    uint32_t initialising_us;
    uint16_t polled;  // bytes of the last look
    uint16_t place;   // bytes of the block that its checksum has taken
    uint16_t crc;
    int8_t outcome;  // of the operation, once it is over
    uint8_t stage;
    uint8_t then;  // the stage behind a wait
    uint8_t wait;
    uint8_t tries;
    bool has_high_capacity;
    bool is_version_2;
    bool has_unjammed;
    uint8_t command[SDCARD_ANSWER];
    uint8_t answer[SDCARD_ANSWER];
    uint8_t frame[SDCARD_LEAD + SDCARD_BLOCK + SDCARD_CRC];
};

void sdcard_init(struct sdcard *card, const struct spi_device *spi);

// The bytes of the block read, or to be written.
static inline uint8_t *sdcard_block(struct sdcard *card) {
    return card->frame + SDCARD_LEAD;
}

// Each begins an operation; sdcard_step() carries it out.
// From power on, or from wherever a card is: up to 1.1 s, and 4 s where it is jammed.
void sdcard_identify(struct sdcard *card);
// Reads a block.
void sdcard_read(struct sdcard *card, uint32_t block);
// Asks for its status: is it there, is all well?
void sdcard_check(struct sdcard *card);
// A run: sdcard_open, then sdcard_write for each block from there on, then
// sdcard_close, after which all of it has been taken for certain. A failure ends the
// run.
void sdcard_open(struct sdcard *card, uint32_t block);
void sdcard_write(struct sdcard *card);
void sdcard_close(struct sdcard *card);

// Positive during an operation, then its result once, then SDCARD_OK.
enum sdcard_result sdcard_step(struct sdcard *card, uint32_t now_us);
// There is no operation, and no open run.
bool sdcard_is_idle(const struct sdcard *card);

#endif
