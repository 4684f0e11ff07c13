// SPDX-License-Identifier: MIT
// The checks of commands (CRC7) and of blocks (CRC16).
#include "chip.h"

uint8_t sdcard_chip_crc7(const uint8_t *bytes, unsigned count) {
    uint8_t crc = 0;
    for (unsigned i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint8_t)((crc << 1) ^ ((crc & 0x80) != 0 ? 0x09 << 1 : 0));
        }
    }
    return crc | 1;
}

uint16_t sdcard_chip_crc16(const uint8_t *bytes, unsigned count) {
    uint16_t crc = 0;
    for (unsigned i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ (bytes[i] << 8));
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000) != 0 ? 0x1021 : 0));
        }
    }
    return crc;
}
