// SPDX-License-Identifier: MIT
// A board's memory that survives without power, byte by byte, and who has which bytes.
#ifndef MEMORY_H
#define MEMORY_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/bus.h"

// At 0: the settings of the first firmware, in an older form. They are read where
// there are no others, and left as they are, so that such firmware finds them again.
enum {
    MEMORY_IDENTITY = 256,
    MEMORY_SETTINGS = 288,  // two banks
    MEMORY_SETTINGS_BANK = 48,
    MEMORY_PARAMS = 384,  // two banks
    MEMORY_PARAMS_BANK = 256,
    MEMORY_SIZE = 1024,
};
_Static_assert(MEMORY_SETTINGS + 2 * MEMORY_SETTINGS_BANK <= (int)MEMORY_PARAMS,
               "the banks of the settings reach into those of the params");
_Static_assert(MEMORY_PARAMS + 2 * MEMORY_PARAMS_BANK <= (int)MEMORY_SIZE,
               "the banks of the params reach beyond the memory");

struct memory {
    uint8_t (*read)(void *port, uint16_t offset);
    // Starts to write one byte and returns. Called only when is_ready() is true.
    void (*write)(void *port, uint16_t offset, uint8_t value);
    // False while a byte is being written. read() is called only when it is true.
    bool (*is_ready)(void *port);
    void *port;
};

enum memory_result {
    MEMORY_OK = 0,
    MEMORY_BUSY = 1,     // there is more to write; call again
    MEMORY_FAILED = -1,  // the memory does not store what is written
};

// Writes bytes one after the other, and gives up on one that memory never takes.
struct memory_writer {
    const IN_FLASH struct memory *memory;
    uint16_t last;  // offset of the byte written last
    uint8_t tries;  // writes of that byte
};

// Starts to write a byte where memory does not hold it yet, and returns MEMORY_BUSY;
// MEMORY_OK when it does, MEMORY_FAILED after three failed writes. The memory must be
// ready.
enum memory_result memory_put(struct memory_writer *writer, uint16_t offset,
                              uint8_t value) MUST_CHECK;

uint8_t memory_read(const IN_FLASH struct memory *memory, uint16_t offset);
void memory_copy(const IN_FLASH struct memory *memory, uint16_t offset, void *out,
                 uint8_t length);

#endif
