// SPDX-License-Identifier: MIT
// What the files of the SD card's driver share.
//
//   sdcard.c        operations, commands, blocks
//   sdcard_start.c  the answers of a card that is being identified
//
// Document: SD Specifications Part 1, Physical Layer Simplified Specification, version
// 6.00; bare section numbers are its.
#ifndef SDCARD_PRIVATE_H
#define SDCARD_PRIVATE_H

#include "core/drivers/sdcard.h"

enum {
    SDCARD_IF_COND = 0x1AA,  // 2.7 to 3.6 V, and a pattern to come back: 4.3.13

    // R1, 7.3.2.1.
    SDCARD_R1_NONE = 0x80,
    SDCARD_R1_IDLE = 0x01,
    SDCARD_R1_ILLEGAL = 0x04,
    SDCARD_R1_CRC = 0x08,
};

// What is asked of the card, in the order in which it is.
enum sdcard_stage {
    SDCARD_STAGE_OVER,
    SDCARD_STAGE_WAKE,       // clocks for a card that has just got power
    SDCARD_STAGE_RESET,      // CMD0
    SDCARD_STAGE_UNJAM,      // the rest of a block, for a card that waits for it
    SDCARD_STAGE_UNJAM_RUN,  // and the end of a run
    SDCARD_STAGE_INTERFACE,
    SDCARD_STAGE_CRC_ON,
    SDCARD_STAGE_APPLICATION,
    SDCARD_STAGE_INITIALISE,
    SDCARD_STAGE_CAPACITY,
    SDCARD_STAGE_LENGTH,
    SDCARD_STAGE_DESCRIBE,
    SDCARD_STAGE_READ,
    SDCARD_STAGE_CHECK,
    SDCARD_STAGE_OPEN,
    SDCARD_STAGE_RUNNING,  // a run is open, and nothing goes on
    SDCARD_STAGE_WRITE,
    SDCARD_STAGE_STOP,
    SDCARD_STAGE_VERIFY,  // CMD13 behind a run
    SDCARD_STAGE_ABORT,   // CMD12 behind a refused block
    SDCARD_STAGE_CLEAR,   // CMD13, which clears what was wrong
};

// What the stage waits for.
enum sdcard_wait {
    SDCARD_WAIT_NOTHING,
    SDCARD_WAIT_BEGINNING,  // the first step of an operation
    SDCARD_WAIT_ANSWER,
    SDCARD_WAIT_READY,  // no longer busy
    SDCARD_WAIT_TOKEN,
    SDCARD_WAIT_INCOMING,  // the rest of a block
    SDCARD_WAIT_CHECKING,  // of its checksum
    SDCARD_WAIT_SUMMING,   // of the one to send
    SDCARD_WAIT_OUTGOING,
    SDCARD_WAIT_RESPONSE,
    SDCARD_WAIT_CLOCKS,  // sent for their own sake
    SDCARD_WAIT_PAUSE,
    SDCARD_WAIT_CLOSING,
};

// Ends the operation with its outcome.
enum sdcard_result sdcard_end(struct sdcard *card, enum sdcard_result outcome,
                              uint32_t now_us);
// On to another stage, whose command has tries of its own.
enum sdcard_result sdcard_go_on(struct sdcard *card, enum sdcard_stage stage,
                                uint32_t now_us);
// Tries the stage's command once more, or gives up with that failure.
enum sdcard_result sdcard_again(struct sdcard *card, enum sdcard_result failure,
                                uint32_t now_us);

// sdcard_start.c: what follows from an answer. `r1` is its first byte, `rest` and `ocr`
// what comes behind it.

// No answer, or a wrong one, to CMD0.
enum sdcard_result sdcard_reset_again(struct sdcard *card, uint32_t now_us);
enum sdcard_result sdcard_judge_interface(struct sdcard *card, uint8_t r1,
                                          const uint8_t *rest, uint32_t now_us);
enum sdcard_result sdcard_judge_initialise(struct sdcard *card, uint8_t r1,
                                           uint32_t now_us);
enum sdcard_result sdcard_judge_capacity(struct sdcard *card, const uint8_t *ocr,
                                         uint32_t now_us);
// The card's block holds its description: size and write protection.
enum sdcard_result sdcard_take_description(struct sdcard *card, uint32_t now_us);

#endif
