// SPDX-License-Identifier: MIT
// The SD card as a parser of commands and tokens, a buffer of blocks on their way into
// flash, and a file. See the header for the document that SD stands for.
#define _GNU_SOURCE  // NOLINT(bugprone-reserved-identifier): it names fallocate()
#include "sdcard.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define NEVER UINT64_MAX
#define US UINT64_C(1000)     // in nanoseconds
#define MS UINT64_C(1000000)  // in nanoseconds

enum {
    BLOCK = SDCARD_CHIP_BLOCK,
    BUFFER = SDCARD_CHIP_BUFFER,
    CRC_SIZE = 2,
    COMMAND_SIZE = 6,
    NCR_MAX = 8,             // bytes before an answer (SD 7.5.4)
    NCX_MAX = 8,             // bytes before CSD and CID
    ANSWER_MAX = 5,          // R3 and R7
    POWER_UP_CLOCKS = 74,    // SD 6.4.1
    IDENTIFY_HZ = 400000,    // SD 4.2: fOD
    CLOCK_HZ = 25000000,     // SD 5.3.2: TRAN_SPEED 32h
    LARGEST_SDSC = 1 << 22,  // blocks: 2 GB
    LONG_AFTER = 200,        // of so many busy times one is long
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

// SD 7.3.2.3: the second byte of R2; SD 7.3.3.3: data error token.
enum {
    R2_ERROR = 1 << 2,
    R2_ECC = 1 << 4,
    R2_ERASE_PARAM = 1 << 6,
    R2_RANGE = 1 << 7,
    TOKEN_ERROR = 1 << 0,
    TOKEN_ECC = 1 << 2,
    TOKEN_RANGE = 1 << 3,
};

// SD 7.3.3.1, 7.3.3.2.
enum {
    START_BLOCK = 0xFE,
    START_RUN = 0xFC,
    STOP_RUN = 0xFD,
    ACCEPTED = 0x05,
    CRC_REJECTED = 0x0B,
    WRITE_REJECTED = 0x0D,
    RESPONSE_FREE = 0xE0,  // bits of a data response that may be anything
    START_MASK = 0xC0,     // of a command: start bit 0, then 1 for "from the host"
    START_VALUE = 0x40,
};

#define OCR_READY (UINT32_C(1) << 31)
#define OCR_CCS (UINT32_C(1) << 30)      // in ACMD41's argument: HCS
#define OCR_VOLTAGES UINT32_C(0xFF8000)  // 2.7 to 3.6 V

struct pending {
    uint64_t block;
    bool is_lost;  // by wear
    uint8_t data[BLOCK];
};

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
    bool is_unexpected;  // is back: the host can't know, until it begins anew
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
    // What is in out: an answer to a command, a data response, a gap before busy.
    enum { OUT_ANSWER, OUT_RESPONSE, OUT_GAP } out_kind;
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

static void complain(struct sdcard_chip *chip, const char *what) {
    if (chip->complaint == NULL && !chip->is_unexpected) {
        chip->complaint = what;
    }
}

// splitmix64.
static uint64_t draw(struct sdcard_chip *chip) {
    chip->random += UINT64_C(0x9E3779B97F4A7C15);
    uint64_t z = chip->random;
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

// From low to high, both included.
static uint64_t between(struct sdcard_chip *chip, uint64_t low, uint64_t high) {
    return low + draw(chip) % (high - low + 1);
}

// SD 4.5: x^7 + x^3 + 1, the end bit behind it.
static uint8_t crc7(const uint8_t *bytes, unsigned count) {
    uint8_t crc = 0;
    for (unsigned i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint8_t)((crc << 1) ^ ((crc & 0x80) != 0 ? 0x09 << 1 : 0));
        }
    }
    return crc | 1;
}

// SD 4.5: x^16 + x^12 + x^5 + 1.
static uint16_t crc16(const uint8_t *bytes, unsigned count) {
    uint16_t crc = 0;
    for (unsigned i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ (bytes[i] << 8));
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000) != 0 ? 0x1021 : 0));
        }
    }
    return crc;
}

// The file

static void read_bytes(struct sdcard_chip *chip, uint64_t at, uint8_t *bytes,
                       size_t count) {
    memset(bytes, 0, count);
    if (pread(chip->file, bytes, count, (off_t)at) < 0) {
        complain(chip, "SD card: its image can't be read");
    }
}

static void write_block(struct sdcard_chip *chip, uint64_t block,
                        const uint8_t bytes[BLOCK]) {
    if (pwrite(chip->file, bytes, BLOCK, (off_t)(block * BLOCK)) != BLOCK) {
        complain(chip, "SD card: its image can't be written");
    }
}

// Erased blocks read as zeros: DATA_STAT_AFTER_ERASE of the SCR is 0.
static void wipe(struct sdcard_chip *chip, uint64_t block, uint64_t count) {
    static const uint8_t zeros[BLOCK];
    if (count == 0 || fallocate(chip->file, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
                                (off_t)(block * BLOCK), (off_t)(count * BLOCK)) == 0) {
        return;
    }
    for (uint64_t i = 0; i < count; i++) {
        write_block(chip, block + i, zeros);
    }
}

// Faults

static bool is_of_presence(const struct sdcard_chip_fault *fault) {
    return fault->kind == SDCARD_CHIP_PULLED || fault->kind == SDCARD_CHIP_DEAD;
}

static bool is_in_force(const struct sdcard_chip *chip,
                        const struct sdcard_chip_fault *fault) {
    if (fault->count > 0) {
        return !is_of_presence(fault) && chip->came >= fault->first &&
               chip->came - fault->first < fault->count;
    }
    return chip->now_ns >= fault->from_ns &&
           (fault->for_ns == 0 || chip->now_ns - fault->from_ns < fault->for_ns);
}

static const struct sdcard_chip_fault *find_fault(const struct sdcard_chip *chip,
                                                  enum sdcard_chip_fault_kind kind) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (chip->faults[i].kind == kind && is_in_force(chip, &chip->faults[i])) {
            return &chip->faults[i];
        }
    }
    return NULL;
}

static bool is_worn(const struct sdcard_chip *chip, uint64_t block,
                    enum sdcard_chip_wear wear) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct sdcard_chip_fault *fault = &chip->faults[i];
        if (fault->kind == SDCARD_CHIP_WORN && fault->wear == wear &&
            block >= fault->block && block - fault->block < fault->blocks &&
            is_in_force(chip, fault)) {
            return true;
        }
    }
    return false;
}

// Those that wait for this block have a span of time from here on.
static void begin_spans(struct sdcard_chip *chip) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        struct sdcard_chip_fault *fault = &chip->faults[i];
        if (is_of_presence(fault) && fault->count > 0 && fault->first == chip->came) {
            fault->from_ns = chip->now_ns + (fault->after_ns > 0 ? fault->after_ns : 1);
            fault->count = 0;
        }
    }
}

// Programming

static void forget_pending(struct sdcard_chip *chip) {
    chip->pending_count = 0;
    chip->wipe_count = 0;
    chip->due = DUE_NOTHING;
    chip->is_closing = false;
    chip->busy_until_ns = 0;
}

static void program(struct sdcard_chip *chip, const struct pending *pending) {
    if (!pending->is_lost) {
        write_block(chip, pending->block, pending->data);
    }
}

static void program_all(struct sdcard_chip *chip) {
    for (unsigned i = 0; i < chip->pending_count; i++) {
        program(chip, &chip->pending[i]);
    }
    wipe(chip, chip->wipe_from, chip->wipe_count);
    forget_pending(chip);
}

static bool is_busy(const struct sdcard_chip *chip) {
    return chip->now_ns < chip->busy_until_ns;
}

static void settle(struct sdcard_chip *chip) {
    if (chip->is_closing && !is_busy(chip)) {
        program_all(chip);
    }
}

static uint64_t busy_ns(struct sdcard_chip *chip) {
    const bool is_long = draw(chip) % LONG_AFTER == 0;
    if (chip->due == DUE_REST) {
        return between(chip, 20 * US, 200 * US);
    }
    const struct sdcard_chip_fault *slow = find_fault(chip, SDCARD_CHIP_SLOW);
    if (slow != NULL) {
        return slow->ms * MS;
    }
    if (chip->due == DUE_ERASE) {
        return between(chip, 1 * MS, 50 * MS);
    }
    if (is_long) {
        return between(chip, 4 * MS, 40 * MS);
    }
    return chip->due == DUE_BLOCK ? between(chip, 5 * US, 60 * US)
                                  : between(chip, 300 * US, 2000 * US);
}

// It begins with the clocks behind the answer, whatever CS (SD 4.4).
static void begin_busy(struct sdcard_chip *chip) {
    const uint64_t ns = busy_ns(chip);
    const bool is_block = chip->due == DUE_BLOCK || chip->due == DUE_SINGLE;
    chip->is_closing = chip->due != DUE_BLOCK && chip->due != DUE_REST;
    chip->due = DUE_NOTHING;
    chip->busy_until_ns = chip->now_ns + ns;
    chip->has_seen_ready = false;
    if (ns > chip->busy_worst_ns) {
        chip->busy_worst_ns = ns;
    }
    if (is_block) {
        begin_spans(chip);
        if (chip->config.on_block != NULL) {
            chip->config.on_block(chip->config.context, chip->came);
        }
    }
}

static void put_pending(struct sdcard_chip *chip) {
    if (chip->pending_count == BUFFER) {
        program(chip, &chip->pending[0]);
        chip->pending_count--;
        memmove(&chip->pending[0], &chip->pending[1],
                chip->pending_count * sizeof chip->pending[0]);
    }
    struct pending *pending = &chip->pending[chip->pending_count++];
    pending->block = chip->at / BLOCK;
    pending->is_lost = is_worn(chip, pending->block, SDCARD_CHIP_KEEPS);
    memcpy(pending->data, chip->data, BLOCK);
}

// The block that power left amid: how much of it is new, and what follows.
static void tear(struct sdcard_chip *chip, const struct pending *pending) {
    enum { OLD, OLD_REST, ERASED_REST, NOISE_REST, OUTCOMES };
    const uint64_t outcome = draw(chip) % OUTCOMES;
    const size_t kept = (size_t)between(chip, 0, BLOCK - 1);
    if (outcome == OLD || pending->is_lost) {
        return;
    }
    uint8_t bytes[BLOCK];
    read_bytes(chip, pending->block * BLOCK, bytes, BLOCK);
    memcpy(bytes, pending->data, kept);
    for (size_t i = kept; outcome != OLD_REST && i < BLOCK; i++) {
        bytes[i] = outcome == ERASED_REST ? 0xFF : (uint8_t)draw(chip);
    }
    write_block(chip, pending->block, bytes);
}

// What stands in flash where programming is broken off.
static void break_off(struct sdcard_chip *chip) {
    const bool is_ordered = draw(chip) % 2 == 0;
    const uint64_t torn = between(chip, 0, chip->pending_count);
    for (unsigned i = 0; i < chip->pending_count; i++) {
        const bool is_done = is_ordered ? i < torn : draw(chip) % 2 == 0;
        if (i == torn) {
            tear(chip, &chip->pending[i]);
        } else if (is_done) {
            program(chip, &chip->pending[i]);
        }
    }
    wipe(chip, chip->wipe_from, between(chip, 0, chip->wipe_count));
    forget_pending(chip);
}

// Transfers

static void end_run(struct sdcard_chip *chip) {
    const uint64_t left = chip->blocks - chip->at / BLOCK;
    chip->transfer = NOTHING;
    chip->due = DUE_STOP;
    if (chip->announced > chip->run_written) {
        const uint64_t count = chip->announced - chip->run_written;
        chip->wipe_from = chip->at / BLOCK;
        chip->wipe_count = between(chip, 0, count < left ? count : left);
    }
    chip->announced = 0;
}

// Whatever is under way on the wire is no more. A run's blocks go their way into flash.
static void drop(struct sdcard_chip *chip) {
    chip->command_count = 0;
    chip->out_count = 0;
    if (chip->transfer == WRITING && chip->is_run) {
        if (chip->due != DUE_NOTHING) {
            begin_busy(chip);
        }
        end_run(chip);
        begin_busy(chip);
    }
    chip->transfer = NOTHING;
}

static void reset_interface(struct sdcard_chip *chip) {
    chip->mode = MODE_IDLE;
    chip->has_seen_cmd8 = false;
    chip->is_version_2_host = false;
    chip->is_initializing = false;
    chip->checks_crc = false;
    chip->is_application = false;
    chip->block_length = BLOCK;
    chip->errors = 0;
    chip->errors_r2 = 0;
    chip->erase_step = 0;
    chip->announced = 0;
    chip->run_written = 0;
    chip->transfer = NOTHING;
    chip->command_count = 0;
    chip->out_count = 0;
    chip->has_just_answered = false;
    chip->is_low = false;
    chip->has_seen_ready = true;
}

static void lose_power(struct sdcard_chip *chip) {
    if (chip->transfer == WRITING && chip->is_run) {
        end_run(chip);
    }
    break_off(chip);
    reset_interface(chip);
    chip->mode = MODE_SD;
    chip->clocks = 0;
    chip->has_power = false;
    chip->is_unexpected = false;
}

static void follow_socket(struct sdcard_chip *chip) {
    const bool is_in = !chip->is_cut && find_fault(chip, SDCARD_CHIP_PULLED) == NULL;
    if (chip->has_power && !is_in) {
        lose_power(chip);
    } else if (!chip->has_power && is_in) {
        chip->has_power = true;
        chip->power_ns = chip->now_ns;
    }
}

// Answers

static void push(struct sdcard_chip *chip, uint8_t byte) {
    chip->out[chip->out_count++] = byte;
}

// NCR, R1 with the errors that are reported once, and what follows it.
static void answer_with(struct sdcard_chip *chip, const uint8_t *more, unsigned count) {
    chip->out_at = 0;
    chip->out_count = 0;
    chip->out_kind = OUT_ANSWER;
    for (uint64_t gap = between(chip, 1, NCR_MAX); gap > 0; gap--) {
        push(chip, 0xFF);
    }
    push(chip, chip->errors | (chip->mode == MODE_IDLE ? R1_IDLE : 0));
    chip->errors = 0;
    for (unsigned i = 0; i < count; i++) {
        push(chip, more[i]);
    }
}

static void answer(struct sdcard_chip *chip) {
    answer_with(chip, NULL, 0);
}

static void refuse(struct sdcard_chip *chip, uint8_t error) {
    chip->errors |= error;
    answer(chip);
}

static void answer_word(struct sdcard_chip *chip, uint32_t word) {
    const uint8_t bytes[4] = {(uint8_t)(word >> 24), (uint8_t)(word >> 16),
                              (uint8_t)(word >> 8), (uint8_t)word};
    answer_with(chip, bytes, sizeof bytes);
}

// Reading

static void offer_error(struct sdcard_chip *chip, uint8_t token, uint8_t status) {
    chip->data[0] = token;
    chip->data_length = 1;
    chip->is_failed = true;
    chip->errors_r2 |= status;
}

// What stands in data from 1 on goes out behind a token.
static void offer(struct sdcard_chip *chip, unsigned length) {
    const uint16_t crc = crc16(chip->data + 1, length);
    chip->data[0] = START_BLOCK;
    chip->data[1 + length] = (uint8_t)(crc >> 8);
    chip->data[2 + length] = (uint8_t)crc;
    chip->data_length = 1 + length + CRC_SIZE;
}

static void load_block(struct sdcard_chip *chip) {
    chip->data_at = 0;
    if (chip->at + chip->length > chip->blocks * BLOCK) {
        offer_error(chip, TOKEN_RANGE, R2_RANGE);
    } else if (chip->at % BLOCK + chip->length > BLOCK) {
        offer_error(chip, TOKEN_ERROR, R2_ERROR);
    } else if (is_worn(chip, chip->at / BLOCK, SDCARD_CHIP_UNREADABLE)) {
        offer_error(chip, TOKEN_ECC, R2_ECC);
    } else {
        read_bytes(chip, chip->at, chip->data + 1, (size_t)chip->length);
        offer(chip, (unsigned)chip->length);
        chip->at += chip->length;
    }
}

static void begin_reading(struct sdcard_chip *chip, uint64_t gap, uint64_t after_ns) {
    chip->transfer = READING;
    chip->is_failed = false;
    chip->data_at = 0;
    chip->data_gap = (unsigned)gap;
    chip->data_ns = chip->now_ns + after_ns;
}

static void send_register(struct sdcard_chip *chip, const uint8_t *bytes,
                          unsigned count, uint64_t gap, uint64_t after_ns) {
    begin_reading(chip, gap, after_ns);
    chip->is_run = false;
    memcpy(chip->data + 1, bytes, count);
    offer(chip, count);
}

static uint8_t next_read(struct sdcard_chip *chip) {
    if (chip->data_gap > 0 || chip->now_ns < chip->data_ns) {
        chip->data_gap -= chip->data_gap > 0 ? 1 : 0;
        return 0xFF;
    }
    if (chip->data_at == chip->data_length) {
        return 0xFF;  // a run that has failed, until its CMD12
    }
    const uint8_t byte = chip->data[chip->data_at++];
    if (chip->data_at == chip->data_length) {
        if (!chip->is_run) {
            chip->transfer = NOTHING;
        } else if (!chip->is_failed) {
            begin_reading(chip, 1, between(chip, 2 * US, 30 * US));
            load_block(chip);
        }
    }
    return byte;
}

// Where data begin, in bytes. False once it has been refused.
static bool find_place(struct sdcard_chip *chip, uint32_t argument, uint64_t length) {
    const uint64_t at =
        chip->is_high_capacity ? (uint64_t)argument * BLOCK : (uint64_t)argument;
    if (at % BLOCK + length > BLOCK) {
        refuse(chip, R1_ADDRESS);
        return false;
    }
    if (at + length > chip->blocks * BLOCK) {
        refuse(chip, R1_PARAMETER);
        return false;
    }
    chip->at = at;
    chip->length = length;
    return true;
}

static void begin_blocks(struct sdcard_chip *chip, uint32_t argument, bool is_run) {
    if (!find_place(chip, argument,
                    chip->is_high_capacity ? BLOCK : chip->block_length)) {
        return;
    }
    answer(chip);
    chip->is_run = is_run;
    begin_reading(chip, 1, between(chip, 60 * US, 400 * US));
    load_block(chip);
}

static void read_single(struct sdcard_chip *chip, uint32_t argument) {
    begin_blocks(chip, argument, false);
}

static void read_run(struct sdcard_chip *chip, uint32_t argument) {
    begin_blocks(chip, argument, true);
}

// The two bits that still come, then the line's rest (SD 7.5.2).
static void stop_reading(struct sdcard_chip *chip) {
    uint8_t stuff = 0xFF;
    if (chip->data_gap == 0 && chip->now_ns >= chip->data_ns &&
        chip->data_at < chip->data_length) {
        stuff = chip->data[chip->data_at] | 0x3F;
    }
    chip->transfer = NOTHING;
    answer(chip);
    chip->out[0] = stuff;
    chip->due = draw(chip) % 2 == 0 ? DUE_NOTHING : DUE_REST;
}

// Writing

static void begin_writing(struct sdcard_chip *chip, uint32_t argument, bool is_run) {
    if (!chip->is_high_capacity && chip->block_length != BLOCK) {
        refuse(chip, R1_PARAMETER);  // WRITE_BL_PARTIAL is 0
        return;
    }
    if (!find_place(chip, argument, BLOCK)) {
        return;
    }
    answer(chip);
    chip->transfer = WRITING;
    chip->is_run = is_run;
    chip->is_failed = false;
    chip->data_at = 0;
    chip->has_seen_ready = true;
    chip->run_written = 0;
    chip->announced = is_run ? chip->announced : 0;
}

static void write_single(struct sdcard_chip *chip, uint32_t argument) {
    begin_writing(chip, argument, false);
}

static void write_run(struct sdcard_chip *chip, uint32_t argument) {
    begin_writing(chip, argument, true);
}

// The data response to the block that stands in data, CRC included.
static uint8_t judge(struct sdcard_chip *chip) {
    const uint16_t crc = (uint16_t)(chip->data[BLOCK] << 8 | chip->data[BLOCK + 1]);
    const bool is_wrong = chip->checks_crc && crc != crc16(chip->data, BLOCK);
    if (is_wrong) {
        complain(chip, "SD card: a block with a wrong CRC");
    }
    if (is_wrong || find_fault(chip, SDCARD_CHIP_CRC) != NULL) {
        chip->bad_crc++;
        return CRC_REJECTED;
    }
    if (chip->at / BLOCK >= chip->blocks) {
        chip->errors_r2 |= R2_RANGE;
        return WRITE_REJECTED;
    }
    if (find_fault(chip, SDCARD_CHIP_ERROR) != NULL ||
        is_worn(chip, chip->at / BLOCK, SDCARD_CHIP_REFUSES)) {
        chip->errors_r2 |= R2_ERROR;
        return WRITE_REJECTED;
    }
    return ACCEPTED;
}

static void finish_block(struct sdcard_chip *chip) {
    chip->data_at = 0;
    chip->came++;
    if (chip->is_failed) {
        complain(chip, "SD card: a block after one that was rejected");
        return;
    }
    const uint8_t response = judge(chip);
    chip->out_at = 0;
    chip->out_count = 0;
    chip->out_kind = OUT_RESPONSE;
    push(chip, response | (uint8_t)(draw(chip) & RESPONSE_FREE));
    chip->transfer = chip->is_run ? WRITING : NOTHING;
    chip->is_failed = response != ACCEPTED;
    if (!chip->is_failed) {
        put_pending(chip);
        chip->at += BLOCK;
        chip->written++;
        chip->run_written++;
        chip->due = chip->is_run ? DUE_BLOCK : DUE_SINGLE;
    }
}

static void take_data(struct sdcard_chip *chip, uint8_t byte) {
    chip->data[chip->data_at++ - 1] = byte;
    if (chip->data_at == 1 + BLOCK + CRC_SIZE) {
        finish_block(chip);
    }
}

static void take_token(struct sdcard_chip *chip, uint8_t byte, bool is_answering) {
    if (is_answering || is_busy(chip)) {
        complain(chip, "SD card: a token before it is ready");
        return;
    }
    if (chip->has_just_answered) {
        complain(chip, "SD card: a token with no byte before it (NWR)");
    }
    if (byte == (chip->is_run ? START_RUN : START_BLOCK)) {
        chip->data_at = 1;
    } else if (byte == STOP_RUN && chip->is_run) {
        if (chip->is_failed) {  // SD 7.3.3.1
            complain(chip, "SD card: a rejected run ended by a token, not CMD12");
        }
        end_run(chip);
        if (draw(chip) % 2 == 0) {  // NBR: 0 or 1
            chip->out_at = 0;
            chip->out_count = 0;
            chip->out_kind = OUT_GAP;
            push(chip, 0xFF);
        }
    } else {
        complain(chip, "SD card: no token of this write");
    }
}

// Commands

static void go_idle(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    if (chip->pending_count > 0 || chip->wipe_count > 0) {
        break_off(chip);  // SD 7.2.4
    }
    forget_pending(chip);
    reset_interface(chip);
    answer(chip);
}

// SD 7.3.1.4.
static void send_if_cond(struct sdcard_chip *chip, uint32_t argument) {
    chip->has_seen_cmd8 = true;
    if (chip->config.is_version_1 || chip->mode != MODE_IDLE) {
        refuse(chip, R1_ILLEGAL);
        return;
    }
    if (argument >> 12 != 0) {
        complain(chip, "SD card: reserved bits of CMD8 set");
    }
    const bool is_27_36 = ((argument >> 8) & 15) == 1;
    chip->is_version_2_host = is_27_36;
    answer_word(chip, (is_27_36 ? UINT32_C(1) << 8 : 0) | (argument & 0xFF));
}

static void send_csd(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    answer(chip);
    send_register(chip, chip->csd, sizeof chip->csd, between(chip, 0, NCX_MAX), 0);
}

static void send_cid(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    answer(chip);
    send_register(chip, chip->cid, sizeof chip->cid, between(chip, 0, NCX_MAX), 0);
}

static void answer_status(struct sdcard_chip *chip) {
    answer_with(chip, &chip->errors_r2, 1);
    chip->errors_r2 = 0;
}

static void send_status(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    answer_status(chip);
}

static void set_block_length(struct sdcard_chip *chip, uint32_t argument) {
    if (argument == 0 || argument > BLOCK) {
        refuse(chip, R1_PARAMETER);
        return;
    }
    chip->block_length = argument;
    answer(chip);
}

// A block's number from an address as this card takes it; false: refused.
static bool find_erase(struct sdcard_chip *chip, uint32_t argument, uint64_t *block) {
    *block = chip->is_high_capacity ? argument : argument / BLOCK;
    if (*block < chip->blocks) {
        return true;
    }
    chip->erase_step = 0;
    refuse(chip, R1_PARAMETER);
    return false;
}

static void erase_start(struct sdcard_chip *chip, uint32_t argument) {
    if (find_erase(chip, argument, &chip->erase_first)) {
        chip->erase_step = 1;
        answer(chip);
    }
}

static bool is_erase_step(struct sdcard_chip *chip, unsigned step) {
    if (chip->erase_step == step) {
        return true;
    }
    chip->erase_step = 0;
    refuse(chip, R1_ERASE_SEQUENCE);
    return false;
}

static void erase_end(struct sdcard_chip *chip, uint32_t argument) {
    if (is_erase_step(chip, 1) && find_erase(chip, argument, &chip->erase_last)) {
        chip->erase_step = 2;
        answer(chip);
    }
}

static void erase(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    if (!is_erase_step(chip, 2)) {
        return;
    }
    chip->erase_step = 0;
    answer(chip);
    if (chip->erase_last < chip->erase_first) {
        chip->errors_r2 |= R2_ERASE_PARAM;
        return;
    }
    chip->wipe_from = chip->erase_first;
    chip->wipe_count = chip->erase_last - chip->erase_first + 1;
    chip->due = DUE_ERASE;
}

static void application(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    chip->is_application = true;
    answer(chip);
}

static void read_ocr(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const bool is_ready = chip->mode == MODE_READY;
    answer_word(chip, OCR_VOLTAGES | (is_ready ? OCR_READY : 0) |
                          (is_ready && chip->is_high_capacity ? OCR_CCS : 0));
}

static void set_crc(struct sdcard_chip *chip, uint32_t argument) {
    chip->checks_crc = (argument & 1) != 0;
    answer(chip);
}

static void not_modelled(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    complain(chip, "SD card: a command that is not modelled");
    refuse(chip, R1_ILLEGAL);
}

// SD 4.10.2: SD status. Class 4; an allocation unit of 512 KB or 4 MB.
static void send_sd_status(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const uint8_t status[64] = {
        [8] = 0x02, [9] = 0x02, [10] = chip->is_high_capacity ? 0x90 : 0x60};
    answer_status(chip);
    send_register(chip, status, sizeof status, 1, between(chip, 10 * US, 100 * US));
}

static void send_written(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const uint64_t count = chip->run_written;
    const uint8_t bytes[4] = {(uint8_t)(count >> 24), (uint8_t)(count >> 16),
                              (uint8_t)(count >> 8), (uint8_t)count};
    answer(chip);
    send_register(chip, bytes, sizeof bytes, 1, between(chip, 10 * US, 100 * US));
}

static void announce(struct sdcard_chip *chip, uint32_t argument) {
    chip->announced = argument & 0x7FFFFF;
    answer(chip);
}

// SD 7.2.1. A card of high capacity that has met no CMD8, or no HCS, stays idle.
static void send_op_cond(struct sdcard_chip *chip, uint32_t argument) {
    if ((argument & ~OCR_CCS) != 0) {
        complain(chip, "SD card: reserved bits of ACMD41 set");
    }
    if (chip->mode == MODE_IDLE && !chip->is_initializing) {
        if (!chip->has_seen_cmd8) {
            complain(chip, "SD card: ACMD41 with no CMD8 before it");
        }
        chip->is_initializing = true;
        chip->can_initialize = !chip->is_high_capacity ||
                               (chip->is_version_2_host && (argument & OCR_CCS) != 0);
        chip->ready_ns = chip->now_ns + between(chip, 20 * MS, 300 * MS);
    }
    if (chip->is_initializing && chip->can_initialize &&
        chip->now_ns >= chip->ready_ns) {
        chip->is_initializing = false;
        chip->mode = MODE_READY;
    }
    answer(chip);
}

static void set_card_detect(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    answer(chip);
}

// SD 5.6: version 2.00 (1.10), security as each capacity has it, both bus widths.
static void send_scr(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const uint8_t scr[8] = {chip->config.is_version_1 ? 0x01 : 0x02,
                            chip->is_high_capacity ? 0x35 : 0x25};
    answer(chip);
    send_register(chip, scr, sizeof scr, 1, between(chip, 10 * US, 100 * US));
}

// SD table 7-3: in idle state only a few (SD 7.2.1).
static const struct entry {
    uint8_t index;
    bool is_application, is_for_idle;
    void (*run)(struct sdcard_chip *chip, uint32_t argument);
} entries[] = {
    {0, false, true, go_idle},
    {8, false, true, send_if_cond},
    {55, false, true, application},
    {58, false, true, read_ocr},
    {59, false, true, set_crc},
    {41, true, true, send_op_cond},
    {6, false, false, not_modelled},
    {9, false, false, send_csd},
    {10, false, false, send_cid},
    {13, false, false, send_status},
    {16, false, false, set_block_length},
    {17, false, false, read_single},
    {18, false, false, read_run},
    {24, false, false, write_single},
    {25, false, false, write_run},
    {27, false, false, not_modelled},
    {32, false, false, erase_start},
    {33, false, false, erase_end},
    {38, false, false, erase},
    {42, false, false, not_modelled},
    {56, false, false, not_modelled},
    {13, true, false, send_sd_status},
    {22, true, false, send_written},
    {23, true, false, announce},
    {42, true, false, set_card_detect},
    {51, true, false, send_scr},
};

static const struct entry *look_up(uint8_t index, bool is_application) {
    const struct entry *plain = NULL;
    for (size_t i = 0; i < sizeof entries / sizeof *entries; i++) {
        if (entries[i].index == index && entries[i].is_application == is_application) {
            return &entries[i];
        }
        if (entries[i].index == index && !entries[i].is_application) {
            plain = &entries[i];
        }
    }
    return plain;  // SD 4.3.9.1: what is no application command is the plain one
}

static uint8_t command_index(const struct sdcard_chip *chip) {
    return chip->command[0] & 0x3F;
}

static bool is_crc_good(const struct sdcard_chip *chip) {
    return crc7(chip->command, COMMAND_SIZE - 1) == chip->command[COMMAND_SIZE - 1];
}

// From SD mode into SPI mode. There is no answer before.
static void wake(struct sdcard_chip *chip) {
    if (chip->clocks < POWER_UP_CLOCKS) {
        complain(chip, "SD card: a command before 1 ms and 74 clocks with CS high");
    } else if (command_index(chip) != 0 || !is_crc_good(chip)) {
        complain(chip, "SD card: no valid CMD0 first");
    } else {
        chip->is_unexpected = false;
        reset_interface(chip);
        answer(chip);
    }
}

static void interrupt(struct sdcard_chip *chip, uint8_t index) {
    if (chip->transfer == READING && chip->is_run && index == 12) {
        stop_reading(chip);
        return;
    }
    if (chip->transfer == WRITING && chip->is_run && chip->is_failed && index == 12) {
        answer(chip);
        end_run(chip);
        return;
    }
    complain(chip, "SD card: a command amid a transfer");
    if (chip->transfer == WRITING && index == 0) {
        go_idle(chip, 0);
        return;
    }
    chip->transfer = chip->transfer == READING ? NOTHING : chip->transfer;
    refuse(chip, R1_ILLEGAL);
}

static void dispatch(struct sdcard_chip *chip, uint8_t index, bool is_application) {
    const struct entry *entry = look_up(index, is_application);
    const uint8_t *c = chip->command;
    const uint32_t argument =
        (uint32_t)c[1] << 24 | (uint32_t)c[2] << 16 | (uint32_t)c[3] << 8 | c[4];
    const bool is_of_erase = index == 32 || index == 33 || index == 38;
    if (chip->erase_step > 0 && !is_of_erase && index != 13) {
        chip->erase_step = 0;
        chip->errors |= R1_ERASE_RESET;
    }
    if (chip->is_initializing && index != 0 && index != 55 && index != 41) {
        complain(chip, "SD card: another command while ACMD41 is repeated");
    }
    if (entry == NULL) {
        refuse(chip, R1_ILLEGAL);
    } else if (chip->mode == MODE_IDLE && !entry->is_for_idle) {
        complain(chip, "SD card: a command that must wait until it is ready");
        refuse(chip, R1_ILLEGAL);
    } else {
        entry->run(chip, argument);
    }
}

static void finish_command(struct sdcard_chip *chip) {
    const uint8_t index = command_index(chip);
    const bool is_application = chip->is_application;
    chip->command_count = 0;
    if (chip->mode == MODE_SD) {
        wake(chip);
        return;
    }
    if (is_busy(chip)) {
        complain(chip, "SD card: a command while it is busy");
        if (index == 0) {
            go_idle(chip, 0);
        }
        return;
    }
    chip->is_application = false;
    if ((chip->checks_crc || index == 8) && !is_crc_good(chip)) {
        complain(chip, "SD card: a command with a wrong CRC");
        chip->bad_crc++;
        refuse(chip, R1_CRC);
    } else if (chip->transfer != NOTHING) {
        interrupt(chip, index);
    } else {
        dispatch(chip, index, is_application);
    }
}

// The wire

static void begin_command(struct sdcard_chip *chip, uint8_t byte, bool is_answering) {
    if (is_answering) {
        complain(chip, "SD card: a command before the answer to the last one");
        chip->out_count = 0;
    } else if (chip->has_just_answered) {
        complain(chip, "SD card: a command with no byte before it (NRC)");
    }
    chip->command[0] = byte;
    chip->command_count = 1;
}

static void take_in(struct sdcard_chip *chip, uint8_t byte, bool is_answering) {
    if (chip->transfer == WRITING && chip->data_at > 0) {
        take_data(chip, byte);
    } else if (chip->command_count > 0) {
        chip->command[chip->command_count++] = byte;
        if (chip->command_count == COMMAND_SIZE) {
            finish_command(chip);
        }
    } else if ((byte & START_MASK) == START_VALUE) {
        begin_command(chip, byte, is_answering);
    } else if (byte != 0xFF) {
        if (chip->transfer == WRITING) {
            take_token(chip, byte, is_answering);
        } else {
            complain(chip, "SD card: MOSI low where nothing is sent");
        }
    }
}

static uint8_t next_out(struct sdcard_chip *chip) {
    const bool is_first = chip->is_just_selected;
    chip->is_just_selected = false;
    if (chip->out_count > 0) {
        chip->out_count--;
        return chip->out[chip->out_at++];
    }
    if (is_busy(chip)) {
        chip->is_low = true;
        // SD 7.5.3: low from one clock after selection on.
        return is_first && draw(chip) % 2 == 0 ? 0x80 : 0x00;
    }
    chip->has_seen_ready = true;
    if (chip->is_low) {
        chip->is_low = false;
        return (uint8_t)(0xFF >> draw(chip) % 8);  // it ends within the byte
    }
    return chip->transfer == READING ? next_read(chip) : 0xFF;
}

static void check_clock(struct sdcard_chip *chip, uint32_t clock_hz) {
    // CMD0 is answered at the rate that it came with.
    if (chip->mode != MODE_READY && chip->out_count == 0 && clock_hz > IDENTIFY_HZ) {
        complain(chip, "SD card: a clock above 400 kHz before it is ready");
    } else if (clock_hz > CLOCK_HZ) {
        complain(chip, "SD card: a clock above 25 MHz");
    }
}

static bool is_dead(struct sdcard_chip *chip) {
    if (find_fault(chip, SDCARD_CHIP_DEAD) != NULL) {
        chip->is_deaf = true;
        chip->is_unexpected = chip->is_unexpected || chip->mode == MODE_SD;
        drop(chip);
    } else if (!chip->is_selected) {
        chip->is_deaf = false;
    }
    return chip->is_deaf;
}

uint8_t sdcard_chip_exchange(struct sdcard_chip *chip, uint64_t now_ns,
                             uint32_t clock_hz, uint8_t byte) {
    sdcard_chip_advance(chip, now_ns);
    if (!chip->has_power || is_dead(chip)) {
        return 0xFF;
    }
    check_clock(chip, clock_hz);
    if (chip->due != DUE_NOTHING && chip->out_count == 0) {
        begin_busy(chip);
    }
    if (!chip->is_selected) {
        const bool counts = byte == 0xFF && chip->now_ns >= chip->power_ns + 1 * MS;
        chip->clocks += counts && chip->clocks < POWER_UP_CLOCKS ? 8 : 0;
        chip->has_just_answered = false;
        return 0xFF;
    }
    const bool is_answering = chip->out_count > 0 && chip->out_kind != OUT_GAP;
    const uint8_t out = next_out(chip);
    take_in(chip, byte, is_answering);
    chip->has_just_answered =
        is_answering && chip->out_count == 0 && chip->out_kind == OUT_ANSWER;
    return out;
}

// Between two blocks of a run, while busy, a card may be left alone (SD 7.5.3).
static bool is_between_blocks(const struct sdcard_chip *chip) {
    return chip->transfer == WRITING && chip->is_run && chip->data_at == 0 &&
           !chip->is_failed && chip->out_count == 0 && chip->command_count == 0 &&
           (chip->due != DUE_NOTHING || !chip->has_seen_ready);
}

void sdcard_chip_select(struct sdcard_chip *chip, uint64_t now_ns, bool is_selected) {
    sdcard_chip_advance(chip, now_ns);
    if (is_selected == chip->is_selected) {
        return;
    }
    chip->is_selected = is_selected;
    chip->is_just_selected = is_selected;
    chip->is_low = false;
    if (is_selected || !chip->has_power || is_dead(chip) || is_between_blocks(chip)) {
        return;
    }
    if (chip->command_count > 0 || (chip->out_count > 0 && chip->out_kind != OUT_GAP) ||
        chip->transfer != NOTHING) {
        complain(chip, "SD card: deselected amid a command, answer or transfer");
    }
    drop(chip);
}

void sdcard_chip_host_reset(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    if (chip->has_power) {
        drop(chip);
    }
}

// Time and power

static uint64_t earlier(const struct sdcard_chip *chip, uint64_t at, uint64_t next) {
    return at > chip->now_ns && at < next ? at : next;
}

// When the card next leaves its socket or comes back.
static uint64_t next_pull(const struct sdcard_chip *chip) {
    uint64_t next = NEVER;
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct sdcard_chip_fault *fault = &chip->faults[i];
        if (fault->kind == SDCARD_CHIP_PULLED && fault->count == 0) {
            next = earlier(chip, fault->from_ns, next);
            if (fault->for_ns > 0) {
                next = earlier(chip, fault->from_ns + fault->for_ns, next);
            }
        }
    }
    return next;
}

void sdcard_chip_advance(struct sdcard_chip *chip, uint64_t now_ns) {
    for (uint64_t next = next_pull(chip); next <= now_ns; next = next_pull(chip)) {
        chip->now_ns = next;
        settle(chip);
        follow_socket(chip);
        if (chip->has_power && chip->power_ns == next) {
            chip->is_unexpected = true;
        }
    }
    if (now_ns > chip->now_ns) {
        chip->now_ns = now_ns;
    }
    settle(chip);
}

void sdcard_chip_power_cycle(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    if (chip->has_power) {
        lose_power(chip);
    }
    follow_socket(chip);
}

void sdcard_chip_cut(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    chip->is_cut = true;
    follow_socket(chip);
}

void sdcard_chip_finish(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    program_all(chip);
}

// Registers

// Bits of a register of 128, numbered as in SD 5.2 and 5.3.
static void put_bits(uint8_t bytes[16], unsigned lowest, unsigned width,
                     uint64_t value) {
    for (unsigned i = 0; i < width; i++) {
        const unsigned bit = lowest + i;
        bytes[15 - bit / 8] |= (uint8_t)(((value >> i) & 1) << (bit % 8));
    }
}

// SD 5.3: what both versions share.
static void fill_csd(struct sdcard_chip *chip, unsigned block_bits) {
    put_bits(chip->csd, 96, 8, 0x32);    // TRAN_SPEED: 25 MHz
    put_bits(chip->csd, 84, 12, 0x5B5);  // CCC: classes 0, 2, 4, 5, 7, 8, 10
    put_bits(chip->csd, 80, 4, block_bits);
    put_bits(chip->csd, 46, 1, 1);     // ERASE_BLK_EN
    put_bits(chip->csd, 39, 7, 0x7F);  // SECTOR_SIZE
    put_bits(chip->csd, 26, 3, 2);     // R2W_FACTOR
    put_bits(chip->csd, 22, 4, block_bits);
    chip->csd[15] = crc7(chip->csd, 15);
}

// SD 5.3.2. The first unit, of a power of 2, in which the size fits into C_SIZE. False
// where it is no size that a card can tell.
static bool fill_csd_1(struct sdcard_chip *chip) {
    for (unsigned block_bits = 9; block_bits <= 10; block_bits++) {
        for (unsigned mult = 0; mult < 8; mult++) {
            const uint64_t unit = UINT64_C(1) << (mult + 2 + block_bits);
            const uint64_t count = chip->blocks * BLOCK / unit;
            if (count >= 1 && count <= 4096) {
                if (count * unit != chip->blocks * BLOCK) {
                    return false;
                }
                put_bits(chip->csd, 112, 8, 0x26);  // TAAC: 1.5 ms
                put_bits(chip->csd, 79, 1, 1);      // READ_BL_PARTIAL
                put_bits(chip->csd, 62, 12, count - 1);
                put_bits(chip->csd, 50, 12, 05555);  // currents: 35, 45 mA
                put_bits(chip->csd, 47, 3, mult);
                fill_csd(chip, block_bits);
                return true;
            }
        }
    }
    return false;
}

// SD 5.3.3. The same.
static bool fill_csd_2(struct sdcard_chip *chip) {
    const uint64_t count = chip->blocks / 1024;  // units of 512 KB
    if (count == 0 || count > UINT64_C(1) << 22 || chip->blocks % 1024 != 0) {
        return false;
    }
    put_bits(chip->csd, 126, 2, 1);
    put_bits(chip->csd, 112, 8, 0x0E);
    put_bits(chip->csd, 48, 22, count - 1);
    fill_csd(chip, 9);
    return true;
}

static void fill_cid(struct sdcard_chip *chip) {
    memcpy(chip->cid, "\x7EIPCARD1\x10", 9);      // MID, OID, PNM, PRV 1.0
    put_bits(chip->cid, 24, 32, draw(chip) | 1);  // PSN
    put_bits(chip->cid, 8, 12, 24 << 4 | 1);      // MDT: January 2024
    chip->cid[15] = crc7(chip->cid, 15);
}

// Null, or what is wrong.
static const char *open_image(struct sdcard_chip *chip) {
    struct stat status;
    if (fstat(chip->file, &status) != 0 || !S_ISREG(status.st_mode)) {
        return "is no file that can be read and written";
    }
    if (status.st_size == 0 || status.st_size % BLOCK != 0) {
        return "is no image of a card: its size is no multiple of 512 bytes";
    }
    chip->blocks = (uint64_t)status.st_size / BLOCK;
    const bool is_large = chip->blocks > LARGEST_SDSC;
    const enum sdcard_chip_kind kind = chip->config.kind;
    chip->is_high_capacity =
        kind == SDCARD_CHIP_SDHC || (kind == SDCARD_CHIP_BY_SIZE && is_large);
    if (chip->is_high_capacity) {
        return fill_csd_2(chip) ? NULL : "is no SDHC card: 512 KB, or so many, to 2 TB";
    }
    return !is_large && fill_csd_1(chip)
               ? NULL
               : "is no SDSC card: a multiple of 512 KB, or less, to 2 GB";
}

struct sdcard_chip *sdcard_chip_new(const struct sdcard_chip_config *config,
                                    const char **problem) {
    struct sdcard_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        *problem = "does not fit into memory";
        return NULL;
    }
    chip->config = *config;
    chip->random = config->seed;
    chip->file = open(config->image, O_RDWR | O_CLOEXEC);
    *problem = open_image(chip);
    if (*problem != NULL) {
        sdcard_chip_free(chip);
        return NULL;
    }
    fill_cid(chip);
    reset_interface(chip);
    chip->mode = MODE_SD;
    chip->has_power = true;
    return chip;
}

void sdcard_chip_free(struct sdcard_chip *chip) {
    if (chip != NULL) {
        if (chip->file >= 0) {
            (void)close(chip->file);
        }
        free(chip);
    }
}

bool sdcard_chip_add_fault(struct sdcard_chip *chip,
                           const struct sdcard_chip_fault *fault) {
    if (chip->fault_count == SDCARD_CHIP_FAULTS_MAX) {
        return false;
    }
    chip->faults[chip->fault_count++] = *fault;
    follow_socket(chip);
    return true;
}

void sdcard_chip_clear_faults(struct sdcard_chip *chip) {
    chip->fault_count = 0;
    follow_socket(chip);
}

// What it has seen

uint64_t sdcard_chip_blocks(const struct sdcard_chip *chip) {
    return chip->blocks;
}

uint64_t sdcard_chip_written(const struct sdcard_chip *chip) {
    return chip->written;
}

uint64_t sdcard_chip_bad_crc(const struct sdcard_chip *chip) {
    return chip->bad_crc;
}

uint64_t sdcard_chip_busy_worst_ns(const struct sdcard_chip *chip) {
    return chip->busy_worst_ns;
}

bool sdcard_chip_is_busy(const struct sdcard_chip *chip) {
    return is_busy(chip);
}

const char *sdcard_chip_complaint(const struct sdcard_chip *chip) {
    return chip->complaint;
}
