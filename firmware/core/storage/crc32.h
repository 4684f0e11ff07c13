// SPDX-License-Identifier: MIT
// The CRC-32 of zlib and Ethernet: polynomial 0x04C11DB7 reflected, start and final
// exclusive or with 0xFFFFFFFF.
#ifndef CRC32_H
#define CRC32_H

#include <stdint.h>

// The CRC of bytes that have `crc`, and one more. That of no bytes is 0.
void crc32_add(uint32_t *crc, uint8_t byte);

#endif
