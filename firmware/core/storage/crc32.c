// SPDX-License-Identifier: MIT
// CRC-32, a bit at a time: it is rarely needed.
#include "core/storage/crc32.h"

#include <stdbool.h>

uint32_t crc32_add(uint32_t crc, uint8_t byte) {
    crc = ~crc ^ byte;
    for (uint8_t bit = 0; bit < 8; ++bit) {
        const bool is_odd = (crc & 1) != 0;
        crc >>= 1;
        if (is_odd) {
            crc ^= UINT32_C(0xEDB88320);
        }
    }
    return ~crc;
}
