// SPDX-License-Identifier: MIT
// An SD card in SPI mode as a state machine over exchanges of bytes.
//
// Document: SD Specifications Part 1, Physical Layer Simplified Specification, version
// 6.00; bare section numbers are its.
#include "core/drivers/sdcard.h"

#include <stddef.h>
#include <string.h>

#include "core/math/fixed.h"
#include "core/wire/frame.h"

// Commands, 7.3.1.3.
enum {
    GO_IDLE_STATE = 0,
    SEND_IF_COND = 8,
    SEND_CSD = 9,
    STOP_TRANSMISSION = 12,
    SEND_STATUS = 13,
    SET_BLOCKLEN = 16,
    READ_SINGLE_BLOCK = 17,
    WRITE_MULTIPLE_BLOCK = 25,
    SD_SEND_OP_COND = 41,  // behind APP_CMD
    APP_CMD = 55,
    READ_OCR = 58,
    CRC_ON_OFF = 59,
};

enum {
    SILENCE = 0xFF,
    COMMAND_START = 0x40,
    COMMAND_AT = 1,     // behind a byte that shows whether the card is busy
    ANSWER_AT = 7,      // of SDCARD_ANSWER, behind the six bytes of a command
    ANSWER_WITHIN = 9,  // N_CR is up to 8 bytes, 7.5.4

    IF_COND = 0x1AA,  // 2.7 to 3.6 V, and a pattern to come back: 4.3.13

    // R1, 7.3.2.1.
    R1_NONE = 0x80,
    R1_IDLE = 0x01,
    R1_ILLEGAL = 0x04,
    R1_CRC = 0x08,

    // Tokens, 7.3.3.
    TOKEN_START = 0xFE,
    TOKEN_START_OF_RUN = 0xFC,
    TOKEN_STOP_RUN = 0xFD,
    TOKEN_ERROR_ZEROS = 0xF0,
    RESPONSE_MASK = 0x1F,
    RESPONSE_ACCEPTED = 0x05,
    RESPONSE_WRITE_ERROR = 0x0D,
    RESPONSE_WITHIN = 8,

    OCR_POWERED_UP = 0x80,  // first byte: 5.1
    OCR_CCS = 0x40,
    CSD_LENGTH = 16,
    CSD_PROTECTED = 0x30,  // byte 14: PERM_ and TMP_WRITE_PROTECT, 5.3

    // A millisecond of clocks, where 74 are asked for (6.4.1.4), for a card that has
    // just been put in.
    POWER_UP_CLOCKS = 64,
    POLL_SHORT = 16,    // bytes to look for an end of waiting: 6 us
    POLL_LONG = 256,    // 98 us at 21 MHz
    CHECK_BYTES = 128,  // of a block's checksum in one step: 12 us
    TRIES = 3,
    PAUSE_US = 2000,           // between two questions whether it has started
    EXCHANGE_US_MAX = 100000,  // four times a block's time at 200 kHz
};

// The commands to the card, in their order.
enum stage {
    STAGE_OVER,
    STAGE_WAKE,       // clocks for a card that has just got power
    STAGE_RESET,      // CMD0
    STAGE_UNJAM,      // the rest of a block, for a card that waits for it
    STAGE_UNJAM_RUN,  // and the end of a run
    STAGE_INTERFACE,
    STAGE_CRC_ON,
    STAGE_APPLICATION,
    STAGE_INITIALISE,
    STAGE_CAPACITY,
    STAGE_LENGTH,
    STAGE_DESCRIBE,
    STAGE_READ,
    STAGE_CHECK,
    STAGE_OPEN,
    STAGE_RUNNING,  // a run is open, without an operation
    STAGE_WRITE,
    STAGE_STOP,
    STAGE_VERIFY,  // CMD13 behind a run
    STAGE_ABORT,   // CMD12 behind a refused block
    STAGE_CLEAR,   // CMD13, which clears the error
};

// The event that the stage waits for.
enum wait {
    WAIT_NOTHING,
    WAIT_BEGINNING,  // the first step of an operation
    WAIT_ANSWER,
    WAIT_READY,  // no longer busy
    WAIT_TOKEN,
    WAIT_INCOMING,  // the rest of a block
    WAIT_CHECKING,  // of its checksum
    WAIT_SUMMING,   // of the one to send
    WAIT_OUTGOING,
    WAIT_RESPONSE,
    WAIT_CLOCKS,  // sent for their own sake
    WAIT_PAUSE,
    WAIT_CLOSING,
};

// What few steps need: the others, of which there are thousands, save no registers
// for it.
#define NOINLINE __attribute__((noinline))

#define HOST_HAS_HIGH_CAPACITY UINT32_C(0x40000000)  // 4.2.3: HCS

static enum sdcard_result enter(struct sdcard *card, enum stage stage, uint32_t now_us);

void sdcard_init(struct sdcard *card, const struct spi_device *spi) {
    *card = (struct sdcard){.spi = spi};
}

// The polynomial x^7 + x^3 + 1, in the upper seven bits (4.5).
static uint8_t crc7(const uint8_t *bytes, uint8_t length) {
    uint8_t crc = 0;
    for (; length > 0; length--, bytes++) {
        crc ^= *bytes;
        for (uint8_t bit = 0; bit < 8; bit++) {
            crc = (uint8_t)((crc & 0x80) != 0 ? (crc << 1) ^ (0x09 << 1) : crc << 1);
        }
    }
    return crc;
}

static enum sdcard_result exchange(struct sdcard *card, const uint8_t *out, uint8_t *in,
                                   uint16_t length, enum wait wait, uint32_t now_us) {
    card->wait = (uint8_t)wait;
    card->began_us = now_us;
    card->spi->begin(card->spi->port, out, in, length);
    return SDCARD_WAITS;
}

static void count_fault(struct sdcard *card) {
    if (card->blocks != 0 && card->faults < UINT16_MAX) {
        card->faults++;
    }
}

// Ends the operation with its outcome: a byte of clocks with the card let go.
static enum sdcard_result end(struct sdcard *card, enum sdcard_result outcome,
                              uint32_t now_us) {
    if (outcome < 0) {
        count_fault(card);
    }
    card->stage = STAGE_OVER;
    card->outcome = (int8_t)outcome;
    card->spi->select(card->spi->port, false);
    return exchange(card, NULL, NULL, 1, WAIT_CLOSING, now_us);
}

static enum sdcard_result command(struct sdcard *card, uint8_t index, uint32_t argument,
                                  uint32_t now_us) {
    uint8_t *bytes = card->command + COMMAND_AT;
    memset(card->command, SILENCE, sizeof card->command);
    bytes[0] = (uint8_t)(COMMAND_START | index);
    for (uint8_t i = 4; i > 0; i--) {
        bytes[i] = (uint8_t)argument;
        argument >>= 8;
    }
    bytes[5] = (uint8_t)(crc7(bytes, 5) | 1);
    card->spi->select(card->spi->port, true);
    return exchange(card, card->command, card->answer, SDCARD_ANSWER, WAIT_ANSWER,
                    now_us);
}

// Checks that many bytes from the card, which go to the blocks' buffer.
static enum sdcard_result poll(struct sdcard *card, uint16_t length, enum wait wait,
                               uint32_t now_us) {
    card->polled = length;
    return exchange(card, NULL, sdcard_block(card), length, wait, now_us);
}

// Waits until the card is no longer busy, then enters `then`.
static enum sdcard_result await_ready(struct sdcard *card, enum stage then,
                                      uint32_t now_us) {
    card->then = (uint8_t)then;
    card->waited_us = now_us;
    return poll(card, POLL_SHORT, WAIT_READY, now_us);
}

// Tries the stage's command once more, or gives up with that failure.
static enum sdcard_result again(struct sdcard *card, enum sdcard_result failure,
                                uint32_t now_us) {
    card->tries++;
    if (card->tries >= TRIES) {
        return end(card, failure, now_us);
    }
    count_fault(card);
    const enum stage stage = (enum stage)card->stage;
    return enter(card, stage == STAGE_INITIALISE ? STAGE_APPLICATION : stage, now_us);
}

// Begin another stage, whose command has its full number of tries.
NOINLINE static enum sdcard_result go_on(struct sdcard *card, enum stage stage,
                                         uint32_t now_us) {
    card->tries = 0;
    return enter(card, stage, now_us);
}

static uint32_t address_of_block(const struct sdcard *card) {
    // Cards of up to 2 GB (4 with their largest blocks) count bytes: 4.3.14.
    return card->has_high_capacity ? card->address : card->address * SDCARD_BLOCK;
}

static enum sdcard_result enter(struct sdcard *card, enum stage stage,
                                uint32_t now_us) {
    static const uint8_t stop[] = {TOKEN_STOP_RUN, SILENCE};
    const struct spi_device *spi = card->spi;
    card->stage = (uint8_t)stage;
    switch (stage) {
    case STAGE_WAKE:
        spi->select(spi->port, false);
        spi->set_fast(spi->port, false);
        return exchange(card, NULL, NULL, POWER_UP_CLOCKS, WAIT_CLOCKS, now_us);
    case STAGE_RESET:
        return command(card, GO_IDLE_STATE, 0, now_us);
    case STAGE_UNJAM:
        card->has_unjammed = true;
        return exchange(card, NULL, NULL, sizeof card->frame, WAIT_CLOCKS, now_us);
    case STAGE_UNJAM_RUN:
    case STAGE_STOP:
        return exchange(card, stop, NULL, sizeof stop, WAIT_CLOCKS, now_us);
    case STAGE_INTERFACE:
        return command(card, SEND_IF_COND, IF_COND, now_us);
    case STAGE_CRC_ON:
        return command(card, CRC_ON_OFF, 1, now_us);
    case STAGE_APPLICATION:
        return command(card, APP_CMD, 0, now_us);
    case STAGE_INITIALISE:
        return command(card, SD_SEND_OP_COND,
                       card->is_version_2 ? HOST_HAS_HIGH_CAPACITY : 0, now_us);
    case STAGE_CAPACITY:
        return command(card, READ_OCR, 0, now_us);
    case STAGE_LENGTH:
        return command(card, SET_BLOCKLEN, SDCARD_BLOCK, now_us);
    case STAGE_DESCRIBE:
        spi->set_fast(spi->port, true);
        return command(card, SEND_CSD, 0, now_us);
    case STAGE_READ:
        return command(card, READ_SINGLE_BLOCK, address_of_block(card), now_us);
    case STAGE_CHECK:
    case STAGE_VERIFY:
    case STAGE_CLEAR:
        return command(card, SEND_STATUS, 0, now_us);
    case STAGE_OPEN:
        return command(card, WRITE_MULTIPLE_BLOCK, address_of_block(card), now_us);
    case STAGE_WRITE:
        card->place = 0;
        card->crc = 0;
        card->wait = WAIT_SUMMING;
        return SDCARD_GOES_ON;
    case STAGE_ABORT:
        return command(card, STOP_TRANSMISSION, 0, now_us);
    default:  // STAGE_RUNNING
        card->wait = WAIT_NOTHING;
        return SDCARD_OK;
    }
}

// Looks for the token among the first `have` bytes of the block's place.
static enum sdcard_result find_token(struct sdcard *card, uint16_t have,
                                     uint32_t now_us) {
    uint8_t *bytes = sdcard_block(card);
    const uint16_t length =
        (uint16_t)((card->stage == STAGE_DESCRIBE ? CSD_LENGTH : SDCARD_BLOCK) +
                   SDCARD_CRC);
    for (uint16_t i = 0; i < have; i++) {
        if (bytes[i] == TOKEN_START) {
            const uint16_t got = (uint16_t)(have - i - 1);
            memmove(bytes, bytes + i + 1, got);
            card->place = 0;
            card->crc = 0;
            return exchange(card, NULL, bytes + got, (uint16_t)(length - got),
                            WAIT_INCOMING, now_us);
        }
        if ((bytes[i] & TOKEN_ERROR_ZEROS) == 0) {
            return again(card, SDCARD_FAILED, now_us);
        }
    }
    if (now_us - card->waited_us > SDCARD_US_MAX) {
        return again(card, SDCARD_TIMEOUT, now_us);
    }
    // A CSD with its checksum is longer than the short poll.
    const bool is_soon = card->stage == STAGE_DESCRIBE || card->wait != WAIT_TOKEN;
    return poll(card, is_soon ? POLL_SHORT : POLL_LONG, WAIT_TOKEN, now_us);
}

_Static_assert(CSD_LENGTH + SDCARD_CRC > POLL_SHORT &&
                   CSD_LENGTH + SDCARD_CRC > SDCARD_ANSWER - ANSWER_AT - 1,
               "no look for a token reads beyond what follows it");

// What follows from the answers of a card that is being identified: `r1` is the first
// byte of one, `rest` and `ocr` what comes behind it.

// No answer, or a wrong one, to CMD0: a card that a reset of ours left in the middle of
// a run takes what it is sent for data.
NOINLINE static enum sdcard_result reset_again(struct sdcard *card, uint32_t now_us) {
    return card->has_unjammed ? again(card, SDCARD_ABSENT, now_us)
                              : go_on(card, STAGE_UNJAM, now_us);
}

NOINLINE static enum sdcard_result
judge_interface(struct sdcard *card, uint8_t r1, const uint8_t *rest, uint32_t now_us) {
    card->is_version_2 = (r1 & R1_ILLEGAL) == 0;
    if (card->is_version_2 && (r1 != R1_IDLE || (rest[2] & 0x0F) != IF_COND / 256 ||
                               rest[3] != IF_COND % 256)) {
        return end(card, SDCARD_REFUSED, now_us);
    }
    return go_on(card, STAGE_CRC_ON, now_us);
}

NOINLINE static enum sdcard_result judge_initialise(struct sdcard *card, uint8_t r1,
                                                    uint32_t now_us) {
    if (r1 == R1_IDLE) {
        if (now_us - card->initialising_us > SDCARD_US_MAX) {
            return end(card, SDCARD_TIMEOUT, now_us);
        }
        card->wait = WAIT_PAUSE;
        card->began_us = now_us;
        return SDCARD_WAITS;
    }
    return go_on(card, card->is_version_2 ? STAGE_CAPACITY : STAGE_LENGTH, now_us);
}

NOINLINE static enum sdcard_result judge_capacity(struct sdcard *card,
                                                  const uint8_t *ocr, uint32_t now_us) {
    if ((ocr[0] & OCR_POWERED_UP) == 0) {
        return end(card, SDCARD_REFUSED, now_us);
    }
    card->has_high_capacity = (ocr[0] & OCR_CCS) != 0;
    return go_on(card, card->has_high_capacity ? STAGE_DESCRIBE : STAGE_LENGTH, now_us);
}

// CSD, 5.3.2 and 5.3.3. Version 1: (C_SIZE + 1) * 2^(C_SIZE_MULT + 2) blocks of
// 2^READ_BL_LEN bytes, 2^12 * 2^9 * 2^2 of ours at most; version 2: C_SIZE + 1 times
// 512 KB, of which the last of 2 TB is left out.
NOINLINE static enum sdcard_result take_description(struct sdcard *card,
                                                    uint32_t now_us) {
    const uint8_t *csd = sdcard_block(card);
    const uint8_t version = csd[0] / 64;
    if (version == 1 && card->has_high_capacity) {
        const uint32_t size =
            (csd[7] & UINT32_C(0x3F)) * 65536 + csd[8] * UINT32_C(256) + csd[9];
        card->blocks = size == UINT32_C(0x3FFFFF) ? UINT32_MAX : (size + 1) * 1024;
    } else if (version == 0 && !card->has_high_capacity) {
        const uint8_t length = csd[5] & 0x0F;
        const uint32_t size =
            (csd[6] & UINT32_C(3)) * 1024 + csd[7] * UINT32_C(4) + csd[8] / 64;
        const uint8_t factor = (uint8_t)((csd[9] & 3) * 2 + csd[10] / 128);
        if (length < 9 || length > 11) {
            return end(card, SDCARD_REFUSED, now_us);
        }
        card->blocks =
            (uint32_t)fixed_scale_up((int32_t)size + 1, (uint8_t)(factor + length - 7));
    } else {
        return end(card, SDCARD_REFUSED, now_us);
    }
    card->is_read_only = (csd[14] & CSD_PROTECTED) != 0;
    return end(card, SDCARD_OK, now_us);
}

// A command has been answered without a complaint about its checksum.
static enum sdcard_result judge(struct sdcard *card, uint8_t r1, const uint8_t *rest,
                                uint32_t now_us) {
    const enum stage stage = (enum stage)card->stage;
    if (stage == STAGE_RESET) {
        card->initialising_us = now_us;
        return r1 == R1_IDLE ? go_on(card, STAGE_INTERFACE, now_us)
                             : reset_again(card, now_us);
    }
    if (stage == STAGE_INTERFACE) {
        return judge_interface(card, r1, rest, now_us);
    }
    const bool may_be_idle = stage == STAGE_CRC_ON || stage == STAGE_APPLICATION ||
                             stage == STAGE_INITIALISE || stage == STAGE_CLEAR ||
                             stage == STAGE_ABORT;
    if ((r1 & (uint8_t) ~(may_be_idle ? R1_IDLE : 0)) != 0 && stage != STAGE_CLEAR) {
        return end(card, SDCARD_REFUSED, now_us);
    }
    switch (stage) {
    case STAGE_CRC_ON:
        return go_on(card, STAGE_APPLICATION, now_us);
    case STAGE_APPLICATION:
        return enter(card, STAGE_INITIALISE, now_us);
    case STAGE_INITIALISE:
        return judge_initialise(card, r1, now_us);
    case STAGE_CAPACITY:
        return judge_capacity(card, rest, now_us);
    case STAGE_LENGTH:
        return go_on(card, STAGE_DESCRIBE, now_us);
    case STAGE_DESCRIBE:
    case STAGE_READ: {
        const uint16_t have = (uint16_t)(card->answer + SDCARD_ANSWER - rest);
        memcpy(sdcard_block(card), rest, have);
        card->waited_us = now_us;
        return find_token(card, have, now_us);
    }
    case STAGE_OPEN:
        return go_on(card, STAGE_RUNNING, now_us);
    case STAGE_ABORT:
        return await_ready(card, STAGE_CLEAR, now_us);
    case STAGE_CLEAR:
        return end(card, (enum sdcard_result)card->outcome, now_us);
    default:  // CHECK, VERIFY: R2, whose second byte has the error, 7.3.2.3
        return end(card, rest[0] == 0 ? SDCARD_OK : SDCARD_FAILED, now_us);
    }
}

static enum sdcard_result take_answer(struct sdcard *card, uint32_t now_us) {
    const enum stage stage = (enum stage)card->stage;
    if (card->answer[0] != SILENCE) {  // busy: it has heard nothing
        return await_ready(card, stage, now_us);
    }
    const uint8_t *at = card->answer + ANSWER_AT;
    if (stage == STAGE_ABORT) {
        at++;  // CMD12 is followed by a byte that means nothing, 7.2.3
    }
    for (uint8_t i = 0; i < ANSWER_WITHIN; i++, at++) {
        if ((*at & R1_NONE) != 0) {
            continue;
        }
        return (*at & R1_CRC) != 0 ? again(card, SDCARD_GARBLED, now_us)
                                   : judge(card, *at, at + 1, now_us);
    }
    return stage == STAGE_RESET ? reset_again(card, now_us)
                                : again(card, SDCARD_ABSENT, now_us);
}

// A card that is busy holds the line low (7.2.4), and lets it go at any bit.
static enum sdcard_result look_whether_ready(struct sdcard *card, uint32_t now_us) {
    const uint32_t took_us = now_us - card->waited_us;
    if (sdcard_block(card)[card->polled - 1] == SILENCE) {
        if (card->stage == STAGE_WRITE || card->stage == STAGE_STOP) {
            card->busy_us = took_us;
        }
        return enter(card, (enum stage)card->then, now_us);
    }
    if (took_us > SDCARD_US_MAX) {
        return end(card, SDCARD_TIMEOUT, now_us);
    }
    return poll(card, POLL_LONG, WAIT_READY, now_us);
}

static bool sum_is_complete(struct sdcard *card, uint16_t length) {
    const uint16_t left = (uint16_t)(length - card->place);
    const uint8_t part = (uint8_t)(left < CHECK_BYTES ? left : CHECK_BYTES);
    // Polynomial, order and start of a message's (4.5): but from 0.
    card->crc = frame_crc(card->crc, sdcard_block(card) + card->place, part);
    card->place = (uint16_t)(card->place + part);
    return card->place == length;
}

static enum sdcard_result check_block(struct sdcard *card, uint32_t now_us) {
    const bool is_csd = card->stage == STAGE_DESCRIBE;
    const uint16_t length = is_csd ? CSD_LENGTH : SDCARD_BLOCK;
    if (!sum_is_complete(card, length)) {
        return SDCARD_GOES_ON;
    }
    const uint8_t *crc = sdcard_block(card) + length;
    if (crc[0] != (uint8_t)(card->crc >> 8) || crc[1] != (uint8_t)card->crc) {
        return again(card, SDCARD_GARBLED, now_us);
    }
    return is_csd ? take_description(card, now_us) : end(card, SDCARD_OK, now_us);
}

static enum sdcard_result send_block(struct sdcard *card, uint32_t now_us) {
    if (!sum_is_complete(card, SDCARD_BLOCK)) {
        return SDCARD_GOES_ON;
    }
    uint8_t *crc = sdcard_block(card) + SDCARD_BLOCK;
    card->frame[0] = SILENCE;
    card->frame[1] = TOKEN_START_OF_RUN;
    crc[0] = (uint8_t)(card->crc >> 8);
    crc[1] = (uint8_t)card->crc;
    return exchange(card, card->frame, NULL, sizeof card->frame, WAIT_OUTGOING, now_us);
}

// Data response, 7.3.3.1. A refused block ends the run by CMD12.
static enum sdcard_result take_response(struct sdcard *card, uint32_t now_us) {
    uint8_t response = SILENCE;
    for (uint8_t i = 0; i < RESPONSE_WITHIN && response == SILENCE; i++) {
        response = card->answer[i];
    }
    if (response == SILENCE) {
        return end(card, SDCARD_ABSENT, now_us);
    }
    response &= RESPONSE_MASK;
    if (response == RESPONSE_ACCEPTED) {
        return await_ready(card, STAGE_RUNNING, now_us);
    }
    card->outcome = response == RESPONSE_WRITE_ERROR ? SDCARD_FAILED : SDCARD_GARBLED;
    return await_ready(card, STAGE_ABORT, now_us);
}

static enum sdcard_result behind_clocks(struct sdcard *card, uint32_t now_us) {
    switch ((enum stage)card->stage) {
    case STAGE_WAKE:  // after a reset of ours it may still be busy
        card->spi->select(card->spi->port, true);
        return await_ready(card, STAGE_RESET, now_us);
    case STAGE_UNJAM:
        return await_ready(card, STAGE_UNJAM_RUN, now_us);
    case STAGE_UNJAM_RUN:
        return await_ready(card, STAGE_RESET, now_us);
    default:
        return await_ready(card, STAGE_VERIFY, now_us);
    }
}

static void begin(struct sdcard *card, enum stage stage) {
    card->stage = (uint8_t)stage;
    card->wait = WAIT_BEGINNING;
    card->tries = 0;
}

void sdcard_identify(struct sdcard *card) {
    card->blocks = 0;
    card->has_high_capacity = false;
    card->has_unjammed = false;
    begin(card, STAGE_WAKE);
}

void sdcard_read(struct sdcard *card, uint32_t block) {
    card->address = block;
    begin(card, STAGE_READ);
}

void sdcard_check(struct sdcard *card) {
    begin(card, STAGE_CHECK);
}

void sdcard_open(struct sdcard *card, uint32_t block) {
    card->address = block;
    begin(card, STAGE_OPEN);
}

void sdcard_write(struct sdcard *card) {
    begin(card, STAGE_WRITE);
}

void sdcard_close(struct sdcard *card) {
    begin(card, STAGE_STOP);
}

bool sdcard_is_idle(const struct sdcard *card) {
    return card->wait == WAIT_NOTHING && card->stage == STAGE_OVER;
}

static enum sdcard_result behind_exchange(struct sdcard *card, uint32_t now_us) {
    const enum wait wait = (enum wait)card->wait;
    switch (wait) {
    case WAIT_ANSWER:
        return take_answer(card, now_us);
    case WAIT_READY:
        return look_whether_ready(card, now_us);
    case WAIT_TOKEN:
        return find_token(card, card->polled, now_us);
    case WAIT_INCOMING:
        card->wait = WAIT_CHECKING;
        return SDCARD_GOES_ON;
    case WAIT_OUTGOING:
        return exchange(card, NULL, card->answer, RESPONSE_WITHIN, WAIT_RESPONSE,
                        now_us);
    case WAIT_RESPONSE:
        return take_response(card, now_us);
    case WAIT_CLOCKS:
        return behind_clocks(card, now_us);
    default:  // WAIT_CLOSING
        card->wait = WAIT_NOTHING;
        return (enum sdcard_result)card->outcome;
    }
}

enum sdcard_result sdcard_step(struct sdcard *card, uint32_t now_us) {
    switch ((enum wait)card->wait) {
    case WAIT_NOTHING:
        return SDCARD_OK;
    case WAIT_BEGINNING:
        return enter(card, (enum stage)card->stage, now_us);
    case WAIT_PAUSE:
        return now_us - card->began_us < PAUSE_US
                   ? SDCARD_WAITS
                   : go_on(card, STAGE_APPLICATION, now_us);
    case WAIT_CHECKING:
        return check_block(card, now_us);
    case WAIT_SUMMING:
        return send_block(card, now_us);
    default:
        break;
    }
    if (card->spi->is_done(card->spi->port)) {
        return behind_exchange(card, now_us);
    }
    if (now_us - card->began_us <= EXCHANGE_US_MAX) {
        return SDCARD_WAITS;
    }
    // A bus that does not end its exchange has no clocks to give either.
    count_fault(card);
    card->stage = STAGE_OVER;
    card->wait = WAIT_NOTHING;
    card->spi->select(card->spi->port, false);
    return SDCARD_TIMEOUT;
}
