// SPDX-License-Identifier: MIT
// Shared by the files of the SD card's model. See ../sdcard.h for the document that SD
// stands for.
#ifndef SIM_CHIPS_SDCARD_CHIP_H
#define SIM_CHIPS_SDCARD_CHIP_H

#include <stddef.h>

#include "../sdcard.h"

#define NEVER UINT64_MAX
#define US UINT64_C(1000)     // in nanoseconds
#define MS UINT64_C(1000000)  // in nanoseconds

enum {
    BLOCK = SDCARD_CHIP_BLOCK,
    BUFFER = SDCARD_CHIP_BUFFER,
    CRC_SIZE = 2,
    COMMAND_SIZE = 6,
    NCR_MAX = 8,           // bytes before an answer (SD 7.5.4)
    NCX_MAX = 8,           // bytes before CSD and CID
    ANSWER_MAX = 5,        // R3 and R7
    POWER_UP_CLOCKS = 74,  // SD 6.4.1
};

// SD 7.3.2.1: R1.
enum {
    R1_IDLE = 1 << 0,
    R1_ERASE_RESET = 1 << 1,
    R1_ILLEGAL = 1 << 2,
    R1_CRC = 1 << 3,
    R1_ERASE_SEQUENCE = 1 << 4,
    R1_ADDRESS = 1 << 5,
    R1_PARAMETER = 1 << 6,
};

// SD 7.3.2.3: the second byte of R2.
enum {
    R2_ERROR = 1 << 2,
    R2_ECC = 1 << 4,
    R2_ERASE_PARAM = 1 << 6,
    R2_RANGE = 1 << 7,
};

struct pending {
    uint64_t block;
    bool is_lost;  // by wear
    uint8_t data[BLOCK];
};

// What goes out: an answer to a command, a data response, a gap before busy.
enum out_kind { OUT_ANSWER, OUT_RESPONSE, OUT_GAP };

struct sdcard_chip {
    struct sdcard_chip_config config;
    int file;
    uint64_t blocks;
    bool is_high_capacity;
    uint8_t csd[16], cid[16];
    uint64_t random;
    struct sdcard_chip_fault faults[SDCARD_CHIP_FAULTS_MAX];
    unsigned fault_count;
    const char *complaint;
    uint64_t came, written, bad_crc, busy_worst_ns;

    uint64_t now_ns;
    bool has_power, is_cut;
    uint64_t power_ns;
    unsigned clocks;     // with CS and MOSI high, since a millisecond after power
    bool is_unexpected;  // is back: the host can't know, until it restarts
    bool is_deaf;        // is dead, or has been: until it is deselected

    enum { MODE_SD, MODE_IDLE, MODE_READY } mode;
    bool has_seen_cmd8, is_version_2_host;
    bool is_initializing, can_initialize;
    uint64_t ready_ns;
    bool checks_crc, is_application;
    uint32_t block_length;
    uint8_t errors, errors_r2;
    unsigned erase_step;  // of CMD32, CMD33, CMD38
    uint64_t erase_first, erase_last;

    // The wire
    bool is_selected, is_just_selected;
    uint8_t command[COMMAND_SIZE];
    unsigned command_count;
    uint8_t out[NCR_MAX + 1 + ANSWER_MAX];
    unsigned out_at, out_count;
    enum out_kind out_kind;
    bool has_just_answered;
    bool is_low, has_seen_ready;

    enum { NOTHING, READING, WRITING } transfer;
    bool is_run, is_failed;  // CMD18, CMD25; a data error has ended it
    uint8_t data[1 + BLOCK + CRC_SIZE];
    unsigned data_at, data_length;  // on their way out; in: data_at 0 is no block yet
    unsigned data_gap;
    uint64_t data_ns;     // not before then
    uint64_t at, length;  // bytes on the card
    uint64_t announced;   // by ACMD23
    uint64_t run_written;

    // Programming: what waits for 8 clocks, what busy stands for, blocks on their way.
    enum { DUE_NOTHING, DUE_REST, DUE_BLOCK, DUE_SINGLE, DUE_STOP, DUE_ERASE } due;
    bool is_closing;  // all is in flash once busy is over
    uint64_t busy_until_ns;
    struct pending pending[BUFFER];
    unsigned pending_count;
    uint64_t wipe_from, wipe_count;  // blocks to be erased with it
};

// chip.c
// Keeps the first thing that the host did against the document, unless it can't know
// better: the card was out of its socket.
void sdcard_chip_complain(struct sdcard_chip *chip, const char *what);
// What the document leaves open: a number from the seed (splitmix64), and one from low
// to high, both included.
uint64_t sdcard_chip_draw(struct sdcard_chip *chip);
uint64_t sdcard_chip_between(struct sdcard_chip *chip, uint64_t low, uint64_t high);

// crc.c
// SD 4.5: x^7 + x^3 + 1, the end bit behind it.
uint8_t sdcard_chip_crc7(const uint8_t *bytes, unsigned count);
// SD 4.5: x^16 + x^12 + x^5 + 1.
uint16_t sdcard_chip_crc16(const uint8_t *bytes, unsigned count);

// faults.c
// An active fault of that kind; null: none.
const struct sdcard_chip_fault *
sdcard_chip_find_fault(const struct sdcard_chip *chip,
                       enum sdcard_chip_fault_kind kind);
bool sdcard_chip_is_worn(const struct sdcard_chip *chip, uint64_t block,
                         enum sdcard_chip_wear wear);
// Programming of a block has begun: the faults that wait for it have their span of time
// from here on.
void sdcard_chip_begin_spans(struct sdcard_chip *chip);
// When the card next leaves its socket or comes back, ns; UINT64_MAX: never.
uint64_t sdcard_chip_next_pull(const struct sdcard_chip *chip);

// flash.c
void sdcard_chip_read_bytes(struct sdcard_chip *chip, uint64_t at, uint8_t *bytes,
                            size_t count);
// The block that stands in `data` is on its way to the place `at`.
void sdcard_chip_put_pending(struct sdcard_chip *chip);
// What is on its way into flash is there at once; never comes; comes in part, as where
// power goes.
void sdcard_chip_program_pending(struct sdcard_chip *chip);
void sdcard_chip_forget_pending(struct sdcard_chip *chip);
void sdcard_chip_break_off(struct sdcard_chip *chip);
// Busy with what is due. It begins with the clocks behind the answer, whatever CS
// (SD 4.4).
void sdcard_chip_begin_busy(struct sdcard_chip *chip);
// Programs what busy stood for, once it is over.
void sdcard_chip_settle(struct sdcard_chip *chip);

// registers.c
// CSD of version 1 (SD 5.3.2) and 2 (SD 5.3.3). False where a card can't tell its size.
bool sdcard_chip_fill_csd_1(struct sdcard_chip *chip);
bool sdcard_chip_fill_csd_2(struct sdcard_chip *chip);
void sdcard_chip_fill_cid(struct sdcard_chip *chip);

// transfer.c
// Reads from the address of the command on: a block, or a run until it is stopped.
void sdcard_chip_begin_blocks(struct sdcard_chip *chip, uint32_t argument, bool is_run);
// Sends bytes as a block of data, after a gap in bytes and a time.
void sdcard_chip_send_register(struct sdcard_chip *chip, const uint8_t *bytes,
                               unsigned count, uint64_t gap, uint64_t after_ns);
uint8_t sdcard_chip_next_read(struct sdcard_chip *chip);
void sdcard_chip_stop_reading(struct sdcard_chip *chip);
void sdcard_chip_begin_writing(struct sdcard_chip *chip, uint32_t argument,
                               bool is_run);
// A byte of a block; a byte where a token is expected; the end of a run of blocks.
void sdcard_chip_take_data(struct sdcard_chip *chip, uint8_t byte);
void sdcard_chip_take_token(struct sdcard_chip *chip, uint8_t byte, bool is_answering);
void sdcard_chip_end_run(struct sdcard_chip *chip);

// wire.c
// One byte goes out next that answers no command: OUT_RESPONSE or OUT_GAP.
void sdcard_chip_put_out(struct sdcard_chip *chip, enum out_kind kind, uint8_t byte);
// Answers after a gap (NCR) with R1, which has the errors that are reported once, and
// what follows it.
void sdcard_chip_answer_with(struct sdcard_chip *chip, const uint8_t *more,
                             unsigned count);
void sdcard_chip_answer(struct sdcard_chip *chip);
void sdcard_chip_answer_word(struct sdcard_chip *chip, uint32_t word);
void sdcard_chip_refuse(struct sdcard_chip *chip, uint8_t error);
// Whatever is under way on the wire is no more. A run's blocks go their way into flash.
void sdcard_chip_drop(struct sdcard_chip *chip);
// Idle, as after CMD0.
void sdcard_chip_reset_interface(struct sdcard_chip *chip);

// commands.c
// Obeys the command that has come.
void sdcard_chip_finish_command(struct sdcard_chip *chip);

#endif
