// SPDX-License-Identifier: MIT
// Data blocks: reading and writing, single and in runs.
#include "chip.h"

#include <string.h>

// SD 7.3.3.1, 7.3.3.2.
enum {
    START_BLOCK = 0xFE,
    START_RUN = 0xFC,
    STOP_RUN = 0xFD,
    ACCEPTED = 0x05,
    CRC_REJECTED = 0x0B,
    WRITE_REJECTED = 0x0D,
    RESPONSE_FREE = 0xE0,  // bits of a data response that may be anything
};

// SD 7.3.3.3: data error token.
enum {
    TOKEN_ERROR = 1 << 0,
    TOKEN_ECC = 1 << 2,
    TOKEN_RANGE = 1 << 3,
};

// Where data begin, in bytes. False once it has been refused.
static bool find_place(struct sdcard_chip *chip, uint32_t argument, uint64_t length) {
    const uint64_t at =
        chip->is_high_capacity ? (uint64_t)argument * BLOCK : (uint64_t)argument;
    if (at % BLOCK + length > BLOCK) {
        sdcard_chip_refuse(chip, R1_ADDRESS);
        return false;
    }
    if (at + length > chip->blocks * BLOCK) {
        sdcard_chip_refuse(chip, R1_PARAMETER);
        return false;
    }
    chip->at = at;
    chip->length = length;
    return true;
}

static void offer_error(struct sdcard_chip *chip, uint8_t token, uint8_t status) {
    chip->data[0] = token;
    chip->data_length = 1;
    chip->is_failed = true;
    chip->errors_r2 |= status;
}

// What stands in data from 1 on goes out behind a token.
static void offer(struct sdcard_chip *chip, unsigned length) {
    const uint16_t crc = sdcard_chip_crc16(chip->data + 1, length);
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
    } else if (sdcard_chip_is_worn(chip, chip->at / BLOCK, SDCARD_CHIP_UNREADABLE)) {
        offer_error(chip, TOKEN_ECC, R2_ECC);
    } else {
        sdcard_chip_read_bytes(chip, chip->at, chip->data + 1, (size_t)chip->length);
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

void sdcard_chip_send_register(struct sdcard_chip *chip, const uint8_t *bytes,
                               unsigned count, uint64_t gap, uint64_t after_ns) {
    begin_reading(chip, gap, after_ns);
    chip->is_run = false;
    memcpy(chip->data + 1, bytes, count);
    offer(chip, count);
}

uint8_t sdcard_chip_next_read(struct sdcard_chip *chip) {
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
            begin_reading(chip, 1, sdcard_chip_between(chip, 2 * US, 30 * US));
            load_block(chip);
        }
    }
    return byte;
}

void sdcard_chip_begin_blocks(struct sdcard_chip *chip, uint32_t argument,
                              bool is_run) {
    if (!find_place(chip, argument,
                    chip->is_high_capacity ? BLOCK : chip->block_length)) {
        return;
    }
    sdcard_chip_answer(chip);
    chip->is_run = is_run;
    begin_reading(chip, 1, sdcard_chip_between(chip, 60 * US, 400 * US));
    load_block(chip);
}

void sdcard_chip_stop_reading(struct sdcard_chip *chip) {
    // The two bits of data that still come, then the line at rest (SD 7.5.2).
    uint8_t stuff = 0xFF;
    if (chip->data_gap == 0 && chip->now_ns >= chip->data_ns &&
        chip->data_at < chip->data_length) {
        stuff = chip->data[chip->data_at] | 0x3F;
    }
    chip->transfer = NOTHING;
    sdcard_chip_answer(chip);
    chip->out[0] = stuff;
    chip->due = sdcard_chip_draw(chip) % 2 == 0 ? DUE_NOTHING : DUE_REST;
}

void sdcard_chip_begin_writing(struct sdcard_chip *chip, uint32_t argument,
                               bool is_run) {
    if (!chip->is_high_capacity && chip->block_length != BLOCK) {
        sdcard_chip_refuse(chip, R1_PARAMETER);  // WRITE_BL_PARTIAL is 0
        return;
    }
    if (!find_place(chip, argument, BLOCK)) {
        return;
    }
    sdcard_chip_answer(chip);
    chip->transfer = WRITING;
    chip->is_run = is_run;
    chip->is_failed = false;
    chip->data_at = 0;
    chip->has_seen_ready = true;
    chip->run_written = 0;
    chip->announced = is_run ? chip->announced : 0;
}

void sdcard_chip_end_run(struct sdcard_chip *chip) {
    const uint64_t left = chip->blocks - chip->at / BLOCK;
    chip->transfer = NOTHING;
    chip->due = DUE_STOP;
    if (chip->announced > chip->run_written) {
        const uint64_t count = chip->announced - chip->run_written;
        chip->wipe_from = chip->at / BLOCK;
        chip->wipe_count = sdcard_chip_between(chip, 0, count < left ? count : left);
    }
    chip->announced = 0;
}

// The data response to the block that stands in data, CRC included.
static uint8_t judge(struct sdcard_chip *chip) {
    const uint16_t crc = (uint16_t)(chip->data[BLOCK] << 8 | chip->data[BLOCK + 1]);
    const bool is_wrong =
        chip->checks_crc && crc != sdcard_chip_crc16(chip->data, BLOCK);
    if (is_wrong) {
        sdcard_chip_complain(chip, "SD card: a block with a wrong CRC");
    }
    if (is_wrong || sdcard_chip_find_fault(chip, SDCARD_CHIP_CRC) != NULL) {
        chip->bad_crc++;
        return CRC_REJECTED;
    }
    if (chip->at / BLOCK >= chip->blocks) {
        chip->errors_r2 |= R2_RANGE;
        return WRITE_REJECTED;
    }
    if (sdcard_chip_find_fault(chip, SDCARD_CHIP_ERROR) != NULL ||
        sdcard_chip_is_worn(chip, chip->at / BLOCK, SDCARD_CHIP_REFUSES)) {
        chip->errors_r2 |= R2_ERROR;
        return WRITE_REJECTED;
    }
    return ACCEPTED;
}

static void finish_block(struct sdcard_chip *chip) {
    chip->data_at = 0;
    chip->came++;
    if (chip->is_failed) {
        sdcard_chip_complain(chip, "SD card: a block after one that was rejected");
        return;
    }
    const uint8_t response = judge(chip);
    sdcard_chip_put_out(chip, OUT_RESPONSE,
                        response | (uint8_t)(sdcard_chip_draw(chip) & RESPONSE_FREE));
    chip->transfer = chip->is_run ? WRITING : NOTHING;
    chip->is_failed = response != ACCEPTED;
    if (!chip->is_failed) {
        sdcard_chip_put_pending(chip);
        chip->at += BLOCK;
        chip->written++;
        chip->run_written++;
        chip->due = chip->is_run ? DUE_BLOCK : DUE_SINGLE;
    }
}

void sdcard_chip_take_data(struct sdcard_chip *chip, uint8_t byte) {
    chip->data[chip->data_at++ - 1] = byte;
    if (chip->data_at == 1 + BLOCK + CRC_SIZE) {
        finish_block(chip);
    }
}

void sdcard_chip_take_token(struct sdcard_chip *chip, uint8_t byte, bool is_answering) {
    if (is_answering || sdcard_chip_is_busy(chip)) {
        sdcard_chip_complain(chip, "SD card: a token before it is ready");
        return;
    }
    if (chip->has_just_answered) {
        sdcard_chip_complain(chip, "SD card: a token with no byte before it (NWR)");
    }
    if (byte == (chip->is_run ? START_RUN : START_BLOCK)) {
        chip->data_at = 1;
    } else if (byte == STOP_RUN && chip->is_run) {
        if (chip->is_failed) {  // SD 7.3.3.1
            sdcard_chip_complain(chip,
                                 "SD card: a rejected run ended by a token, not CMD12");
        }
        sdcard_chip_end_run(chip);
        if (sdcard_chip_draw(chip) % 2 == 0) {  // NBR: 0 or 1
            sdcard_chip_put_out(chip, OUT_GAP, 0xFF);
        }
    } else {
        sdcard_chip_complain(chip, "SD card: no token of this write");
    }
}
