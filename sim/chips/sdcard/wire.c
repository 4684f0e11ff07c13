// SPDX-License-Identifier: MIT
// The SPI protocol: a byte each way, CS, answers.
#include "chip.h"

enum {
    IDENTIFY_HZ = 400000,  // SD 4.2: fOD
    CLOCK_HZ = 25000000,   // SD 5.3.2: TRAN_SPEED 32h
    START_MASK = 0xC0,     // of a command: start bit 0, then 1 for "from the host"
    START_VALUE = 0x40,
};

static void begin_out(struct sdcard_chip *chip, enum out_kind kind) {
    chip->out_at = 0;
    chip->out_count = 0;
    chip->out_kind = kind;
}

static void push(struct sdcard_chip *chip, uint8_t byte) {
    chip->out[chip->out_count++] = byte;
}

void sdcard_chip_put_out(struct sdcard_chip *chip, enum out_kind kind, uint8_t byte) {
    begin_out(chip, kind);
    push(chip, byte);
}

void sdcard_chip_answer_with(struct sdcard_chip *chip, const uint8_t *more,
                             unsigned count) {
    begin_out(chip, OUT_ANSWER);
    for (uint64_t gap = sdcard_chip_between(chip, 1, NCR_MAX); gap > 0; gap--) {
        push(chip, 0xFF);
    }
    push(chip, chip->errors | (chip->mode == MODE_IDLE ? R1_IDLE : 0));
    chip->errors = 0;
    for (unsigned i = 0; i < count; i++) {
        push(chip, more[i]);
    }
}

void sdcard_chip_answer(struct sdcard_chip *chip) {
    sdcard_chip_answer_with(chip, NULL, 0);
}

void sdcard_chip_refuse(struct sdcard_chip *chip, uint8_t error) {
    chip->errors |= error;
    sdcard_chip_answer(chip);
}

void sdcard_chip_answer_word(struct sdcard_chip *chip, uint32_t word) {
    const uint8_t bytes[4] = {(uint8_t)(word >> 24), (uint8_t)(word >> 16),
                              (uint8_t)(word >> 8), (uint8_t)word};
    sdcard_chip_answer_with(chip, bytes, sizeof bytes);
}

void sdcard_chip_drop(struct sdcard_chip *chip) {
    chip->command_count = 0;
    chip->out_count = 0;
    if (chip->transfer == WRITING && chip->is_run) {
        if (chip->due != DUE_NOTHING) {
            sdcard_chip_begin_busy(chip);
        }
        sdcard_chip_end_run(chip);
        sdcard_chip_begin_busy(chip);
    }
    chip->transfer = NOTHING;
}

void sdcard_chip_reset_interface(struct sdcard_chip *chip) {
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

static void begin_command(struct sdcard_chip *chip, uint8_t byte, bool is_answering) {
    if (is_answering) {
        sdcard_chip_complain(chip,
                             "SD card: a command before the answer to the last one");
        chip->out_count = 0;
    } else if (chip->has_just_answered) {
        sdcard_chip_complain(chip, "SD card: a command with no byte before it (NRC)");
    }
    chip->command[0] = byte;
    chip->command_count = 1;
}

static void take_in(struct sdcard_chip *chip, uint8_t byte, bool is_answering) {
    if (chip->transfer == WRITING && chip->data_at > 0) {
        sdcard_chip_take_data(chip, byte);
    } else if (chip->command_count > 0) {
        chip->command[chip->command_count++] = byte;
        if (chip->command_count == COMMAND_SIZE) {
            sdcard_chip_finish_command(chip);
        }
    } else if ((byte & START_MASK) == START_VALUE) {
        begin_command(chip, byte, is_answering);
    } else if (byte != 0xFF) {
        if (chip->transfer == WRITING) {
            sdcard_chip_take_token(chip, byte, is_answering);
        } else {
            sdcard_chip_complain(chip, "SD card: MOSI low where nothing is sent");
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
    if (sdcard_chip_is_busy(chip)) {
        chip->is_low = true;
        // SD 7.5.3: low from one clock after selection on.
        return is_first && sdcard_chip_draw(chip) % 2 == 0 ? 0x80 : 0x00;
    }
    chip->has_seen_ready = true;
    if (chip->is_low) {
        chip->is_low = false;
        return (uint8_t)(0xFF >>
                         sdcard_chip_draw(chip) % 8);  // it ends within the byte
    }
    return chip->transfer == READING ? sdcard_chip_next_read(chip) : 0xFF;
}

static void check_clock(struct sdcard_chip *chip, uint32_t clock_hz) {
    // CMD0 is answered at the rate that it came with.
    if (chip->mode != MODE_READY && chip->out_count == 0 && clock_hz > IDENTIFY_HZ) {
        sdcard_chip_complain(chip, "SD card: a clock above 400 kHz before it is ready");
    } else if (clock_hz > CLOCK_HZ) {
        sdcard_chip_complain(chip, "SD card: a clock above 25 MHz");
    }
}

static bool is_dead(struct sdcard_chip *chip) {
    if (sdcard_chip_find_fault(chip, SDCARD_CHIP_DEAD) != NULL) {
        chip->is_deaf = true;
        chip->is_unexpected = chip->is_unexpected || chip->mode == MODE_SD;
        sdcard_chip_drop(chip);
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
        sdcard_chip_begin_busy(chip);
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
        sdcard_chip_complain(chip,
                             "SD card: deselected amid a command, answer or transfer");
    }
    sdcard_chip_drop(chip);
}

void sdcard_chip_host_reset(struct sdcard_chip *chip, uint64_t now_ns) {
    sdcard_chip_advance(chip, now_ns);
    if (chip->has_power) {
        sdcard_chip_drop(chip);
    }
}
