// SPDX-License-Identifier: MIT
// The answers of a card that is being identified: what it is, how large it is, and what
// it is asked next.
#include "core/drivers/sdcard_private.h"
#include "core/math/fixed.h"

enum {
    OCR_POWERED_UP = 0x80,  // first byte: 5.1
    OCR_CCS = 0x40,
    CSD_PROTECTED = 0x30,  // byte 14: PERM_ and TMP_WRITE_PROTECT, 5.3
};

// A card that a reset of ours left in the middle of a run takes what it is sent for
// data.
enum sdcard_result sdcard_reset_again(struct sdcard *card, uint32_t now_us) {
    return card->has_unjammed ? sdcard_again(card, SDCARD_ABSENT, now_us)
                              : sdcard_go_on(card, SDCARD_STAGE_UNJAM, now_us);
}

enum sdcard_result sdcard_judge_interface(struct sdcard *card, uint8_t r1,
                                          const uint8_t *rest, uint32_t now_us) {
    card->is_version_2 = (r1 & SDCARD_R1_ILLEGAL) == 0;
    if (card->is_version_2 &&
        (r1 != SDCARD_R1_IDLE || (rest[2] & 0x0F) != SDCARD_IF_COND / 256 ||
         rest[3] != SDCARD_IF_COND % 256)) {
        return sdcard_end(card, SDCARD_REFUSED, now_us);
    }
    return sdcard_go_on(card, SDCARD_STAGE_CRC_ON, now_us);
}

enum sdcard_result sdcard_judge_initialise(struct sdcard *card, uint8_t r1,
                                           uint32_t now_us) {
    if (r1 == SDCARD_R1_IDLE) {
        if (now_us - card->initialising_us > SDCARD_US_MAX) {
            return sdcard_end(card, SDCARD_TIMEOUT, now_us);
        }
        card->wait = SDCARD_WAIT_PAUSE;
        card->began_us = now_us;
        return SDCARD_WAITS;
    }
    return sdcard_go_on(
        card, card->is_version_2 ? SDCARD_STAGE_CAPACITY : SDCARD_STAGE_LENGTH, now_us);
}

enum sdcard_result sdcard_judge_capacity(struct sdcard *card, const uint8_t *ocr,
                                         uint32_t now_us) {
    if ((ocr[0] & OCR_POWERED_UP) == 0) {
        return sdcard_end(card, SDCARD_REFUSED, now_us);
    }
    card->has_high_capacity = (ocr[0] & OCR_CCS) != 0;
    return sdcard_go_on(
        card, card->has_high_capacity ? SDCARD_STAGE_DESCRIBE : SDCARD_STAGE_LENGTH,
        now_us);
}

// CSD, 5.3.2 and 5.3.3. Version 1: (C_SIZE + 1) * 2^(C_SIZE_MULT + 2) blocks of
// 2^READ_BL_LEN bytes, 2^12 * 2^9 * 2^2 of ours at most; version 2: C_SIZE + 1 times
// 512 KB, of which the last of 2 TB is left out.
enum sdcard_result sdcard_take_description(struct sdcard *card, uint32_t now_us) {
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
            return sdcard_end(card, SDCARD_REFUSED, now_us);
        }
        card->blocks =
            (uint32_t)fixed_scale_up((int32_t)size + 1, (uint8_t)(factor + length - 7));
    } else {
        return sdcard_end(card, SDCARD_REFUSED, now_us);
    }
    card->is_read_only = (csd[14] & CSD_PROTECTED) != 0;
    return sdcard_end(card, SDCARD_OK, now_us);
}
