// SPDX-License-Identifier: MIT
// CSD and CID.
#include "chip.h"

#include <string.h>

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
    chip->csd[15] = sdcard_chip_crc7(chip->csd, 15);
}

bool sdcard_chip_fill_csd_1(struct sdcard_chip *chip) {
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

bool sdcard_chip_fill_csd_2(struct sdcard_chip *chip) {
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

void sdcard_chip_fill_cid(struct sdcard_chip *chip) {
    memcpy(chip->cid, "\x7EIPCARD1\x10", 9);                  // MID, OID, PNM, PRV 1.0
    put_bits(chip->cid, 24, 32, sdcard_chip_draw(chip) | 1);  // PSN
    put_bits(chip->cid, 8, 12, 24 << 4 | 1);                  // MDT: January 2024
    chip->cid[15] = sdcard_chip_crc7(chip->cid, 15);
}
