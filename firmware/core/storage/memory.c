// SPDX-License-Identifier: MIT
// Bytes of a board's memory; see memory.h.
#include "core/storage/memory.h"

#include "core/drivers/ports_of.h"

enum { TRIES_MAX = 3 };  // EEPROM cells fail permanently, not intermittently

uint8_t memory_read(const IN_FLASH struct memory *memory, uint16_t offset) {
    return MEMORY_PORT(memory)->read(MEMORY_PORT(memory)->port, offset);
}

void memory_copy(const IN_FLASH struct memory *memory, uint16_t offset, void *out,
                 uint8_t length) {
    uint8_t *to = out;
    for (; length > 0; --length) {
        *to++ = memory_read(memory, offset++);
    }
}

enum memory_result memory_put(struct memory_writer *writer, uint16_t offset,
                              uint8_t value) {
    const IN_FLASH struct memory *const memory = MEMORY_PORT(writer->memory);
    if (memory_read(memory, offset) == value) {
        return MEMORY_OK;
    }
    // A byte that is written again counts its tries, any other starts over.
    if (offset != writer->last) {
        writer->last = offset;
        writer->tries = 0;
    }
    if (writer->tries == TRIES_MAX) {
        writer->tries = 0;
        return MEMORY_FAILED;
    }
    ++writer->tries;
    memory->write(memory->port, offset, value);
    return MEMORY_BUSY;
}
