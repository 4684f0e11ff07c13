// SPDX-License-Identifier: MIT
// The commands (SD table 7-3).
#include "chip.h"

#include <stddef.h>

#define OCR_READY (UINT32_C(1) << 31)
#define OCR_CCS (UINT32_C(1) << 30)      // in ACMD41's argument: HCS
#define OCR_VOLTAGES UINT32_C(0xFF8000)  // 2.7 to 3.6 V

static void go_idle(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    if (chip->pending_count > 0 || chip->wipe_count > 0) {
        sdcard_chip_break_off(chip);  // SD 7.2.4
    }
    sdcard_chip_forget_pending(chip);
    sdcard_chip_reset_interface(chip);
    sdcard_chip_answer(chip);
}

// SD 7.3.1.4.
static void send_if_cond(struct sdcard_chip *chip, uint32_t argument) {
    chip->has_seen_cmd8 = true;
    if (chip->config.is_version_1 || chip->mode != MODE_IDLE) {
        sdcard_chip_refuse(chip, R1_ILLEGAL);
        return;
    }
    if (argument >> 12 != 0) {
        sdcard_chip_complain(chip, "SD card: reserved bits of CMD8 set");
    }
    const bool is_27_36 = ((argument >> 8) & 15) == 1;
    chip->is_version_2_host = is_27_36;
    sdcard_chip_answer_word(chip,
                            (is_27_36 ? UINT32_C(1) << 8 : 0) | (argument & 0xFF));
}

static void send_csd(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    sdcard_chip_answer(chip);
    sdcard_chip_send_register(chip, chip->csd, sizeof chip->csd,
                              sdcard_chip_between(chip, 0, NCX_MAX), 0);
}

static void send_cid(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    sdcard_chip_answer(chip);
    sdcard_chip_send_register(chip, chip->cid, sizeof chip->cid,
                              sdcard_chip_between(chip, 0, NCX_MAX), 0);
}

static void answer_status(struct sdcard_chip *chip) {
    sdcard_chip_answer_with(chip, &chip->errors_r2, 1);
    chip->errors_r2 = 0;
}

static void send_status(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    answer_status(chip);
}

static void set_block_length(struct sdcard_chip *chip, uint32_t argument) {
    if (argument == 0 || argument > BLOCK) {
        sdcard_chip_refuse(chip, R1_PARAMETER);
        return;
    }
    chip->block_length = argument;
    sdcard_chip_answer(chip);
}

static void read_single(struct sdcard_chip *chip, uint32_t argument) {
    sdcard_chip_begin_blocks(chip, argument, false);
}

static void read_run(struct sdcard_chip *chip, uint32_t argument) {
    sdcard_chip_begin_blocks(chip, argument, true);
}

static void write_single(struct sdcard_chip *chip, uint32_t argument) {
    sdcard_chip_begin_writing(chip, argument, false);
}

static void write_run(struct sdcard_chip *chip, uint32_t argument) {
    sdcard_chip_begin_writing(chip, argument, true);
}

// A block's number from an address as this card takes it; false: refused.
static bool find_erase(struct sdcard_chip *chip, uint32_t argument, uint64_t *block) {
    *block = chip->is_high_capacity ? argument : argument / BLOCK;
    if (*block < chip->blocks) {
        return true;
    }
    chip->erase_step = 0;
    sdcard_chip_refuse(chip, R1_PARAMETER);
    return false;
}

static void erase_start(struct sdcard_chip *chip, uint32_t argument) {
    if (find_erase(chip, argument, &chip->erase_first)) {
        chip->erase_step = 1;
        sdcard_chip_answer(chip);
    }
}

static bool is_erase_step(struct sdcard_chip *chip, unsigned step) {
    if (chip->erase_step == step) {
        return true;
    }
    chip->erase_step = 0;
    sdcard_chip_refuse(chip, R1_ERASE_SEQUENCE);
    return false;
}

static void erase_end(struct sdcard_chip *chip, uint32_t argument) {
    if (is_erase_step(chip, 1) && find_erase(chip, argument, &chip->erase_last)) {
        chip->erase_step = 2;
        sdcard_chip_answer(chip);
    }
}

static void erase(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    if (!is_erase_step(chip, 2)) {
        return;
    }
    chip->erase_step = 0;
    sdcard_chip_answer(chip);
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
    sdcard_chip_answer(chip);
}

static void read_ocr(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const bool is_ready = chip->mode == MODE_READY;
    sdcard_chip_answer_word(chip,
                            OCR_VOLTAGES | (is_ready ? OCR_READY : 0) |
                                (is_ready && chip->is_high_capacity ? OCR_CCS : 0));
}

static void set_crc(struct sdcard_chip *chip, uint32_t argument) {
    chip->checks_crc = (argument & 1) != 0;
    sdcard_chip_answer(chip);
}

static void not_modelled(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    sdcard_chip_complain(chip, "SD card: a command that is not modelled");
    sdcard_chip_refuse(chip, R1_ILLEGAL);
}

// SD 4.10.2: SD status. Class 4; an allocation unit of 512 KB or 4 MB.
static void send_sd_status(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const uint8_t status[64] = {
        [8] = 0x02, [9] = 0x02, [10] = chip->is_high_capacity ? 0x90 : 0x60};
    answer_status(chip);
    sdcard_chip_send_register(chip, status, sizeof status, 1,
                              sdcard_chip_between(chip, 10 * US, 100 * US));
}

static void send_written(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const uint64_t count = chip->run_written;
    const uint8_t bytes[4] = {(uint8_t)(count >> 24), (uint8_t)(count >> 16),
                              (uint8_t)(count >> 8), (uint8_t)count};
    sdcard_chip_answer(chip);
    sdcard_chip_send_register(chip, bytes, sizeof bytes, 1,
                              sdcard_chip_between(chip, 10 * US, 100 * US));
}

static void announce(struct sdcard_chip *chip, uint32_t argument) {
    chip->announced = argument & 0x7FFFFF;
    sdcard_chip_answer(chip);
}

// SD 7.2.1. A card of high capacity that has met no CMD8, or no HCS, stays idle.
static void send_op_cond(struct sdcard_chip *chip, uint32_t argument) {
    if ((argument & ~OCR_CCS) != 0) {
        sdcard_chip_complain(chip, "SD card: reserved bits of ACMD41 set");
    }
    if (chip->mode == MODE_IDLE && !chip->is_initializing) {
        if (!chip->has_seen_cmd8) {
            sdcard_chip_complain(chip, "SD card: ACMD41 with no CMD8 before it");
        }
        chip->is_initializing = true;
        chip->can_initialize = !chip->is_high_capacity ||
                               (chip->is_version_2_host && (argument & OCR_CCS) != 0);
        chip->ready_ns = chip->now_ns + sdcard_chip_between(chip, 20 * MS, 300 * MS);
    }
    if (chip->is_initializing && chip->can_initialize &&
        chip->now_ns >= chip->ready_ns) {
        chip->is_initializing = false;
        chip->mode = MODE_READY;
    }
    sdcard_chip_answer(chip);
}

static void set_card_detect(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    sdcard_chip_answer(chip);
}

// SD 5.6: version 2.00 (1.10), security as each capacity has it, both bus widths.
static void send_scr(struct sdcard_chip *chip, uint32_t argument) {
    (void)argument;
    const uint8_t scr[8] = {chip->config.is_version_1 ? 0x01 : 0x02,
                            chip->is_high_capacity ? 0x35 : 0x25};
    sdcard_chip_answer(chip);
    sdcard_chip_send_register(chip, scr, sizeof scr, 1,
                              sdcard_chip_between(chip, 10 * US, 100 * US));
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
    return plain;  // SD 4.3.9.1: others are the plain command
}

static uint8_t command_index(const struct sdcard_chip *chip) {
    return chip->command[0] & 0x3F;
}

static bool is_crc_good(const struct sdcard_chip *chip) {
    return sdcard_chip_crc7(chip->command, COMMAND_SIZE - 1) ==
           chip->command[COMMAND_SIZE - 1];
}

// From SD mode into SPI mode. There is no answer before.
static void wake(struct sdcard_chip *chip) {
    if (chip->clocks < POWER_UP_CLOCKS) {
        sdcard_chip_complain(
            chip, "SD card: a command before 1 ms and 74 clocks with CS high");
    } else if (command_index(chip) != 0 || !is_crc_good(chip)) {
        sdcard_chip_complain(chip, "SD card: no valid CMD0 first");
    } else {
        chip->is_unexpected = false;
        sdcard_chip_reset_interface(chip);
        sdcard_chip_answer(chip);
    }
}

static void interrupt(struct sdcard_chip *chip, uint8_t index) {
    if (chip->transfer == READING && chip->is_run && index == 12) {
        sdcard_chip_stop_reading(chip);
        return;
    }
    if (chip->transfer == WRITING && chip->is_run && chip->is_failed && index == 12) {
        sdcard_chip_answer(chip);
        sdcard_chip_end_run(chip);
        return;
    }
    sdcard_chip_complain(chip, "SD card: a command amid a transfer");
    if (chip->transfer == WRITING && index == 0) {
        go_idle(chip, 0);
        return;
    }
    chip->transfer = chip->transfer == READING ? NOTHING : chip->transfer;
    sdcard_chip_refuse(chip, R1_ILLEGAL);
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
        sdcard_chip_complain(chip, "SD card: another command while ACMD41 is repeated");
    }
    if (entry == NULL) {
        sdcard_chip_refuse(chip, R1_ILLEGAL);
    } else if (chip->mode == MODE_IDLE && !entry->is_for_idle) {
        sdcard_chip_complain(chip,
                             "SD card: a command that must wait until it is ready");
        sdcard_chip_refuse(chip, R1_ILLEGAL);
    } else {
        entry->run(chip, argument);
    }
}

void sdcard_chip_finish_command(struct sdcard_chip *chip) {
    const uint8_t index = command_index(chip);
    const bool is_application = chip->is_application;
    chip->command_count = 0;
    if (chip->mode == MODE_SD) {
        wake(chip);
        return;
    }
    if (sdcard_chip_is_busy(chip)) {
        sdcard_chip_complain(chip, "SD card: a command while it is busy");
        if (index == 0) {
            go_idle(chip, 0);
        }
        return;
    }
    chip->is_application = false;
    if ((chip->checks_crc || index == 8) && !is_crc_good(chip)) {
        sdcard_chip_complain(chip, "SD card: a command with a wrong CRC");
        chip->bad_crc++;
        sdcard_chip_refuse(chip, R1_CRC);
    } else if (chip->transfer != NOTHING) {
        interrupt(chip, index);
    } else {
        dispatch(chip, index, is_application);
    }
}
