// SPDX-License-Identifier: MIT
// CRC-32, a bit at a time: it is rarely needed.
#include "core/storage/crc32.h"

#include <stdbool.h>

void crc32_add(uint32_t *crc, uint8_t byte) {
    uint32_t inverse = ~*crc ^ byte;
    for (uint8_t bit = 0; bit < 8; ++bit) {
        const bool is_odd = ((uint8_t)inverse & 1) != 0;
        inverse >>= 1;
        if (is_odd) {
            inverse ^= UINT32_C(0xEDB88320);
        }
    }
    *crc = ~inverse;
}
