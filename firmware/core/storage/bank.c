// SPDX-License-Identifier: MIT
// Two banks under one CRC each; see bank.h.
#include "core/storage/bank.h"

#include <string.h>

enum {
    AT_MARK = 0,
    AT_SEQUENCE = 1,
    MARK_XOR = 0xB2,  // no byte is its own mark
};

// The mark that goes with a sequence number, so that neither can be spoilt alone.
static uint8_t mark_of(uint8_t sequence) {
    return sequence ^ MARK_XOR;
}

static uint16_t place_of(const struct bank *bank, uint8_t index, uint16_t at) {
    return (uint16_t)(bank->first + (index != 0 ? bank->size : 0) + at);
}

static uint8_t read_at(const struct bank *bank, uint8_t index, uint16_t at) {
    return memory_read(bank->writer.memory, place_of(bank, index, at));
}

uint8_t bank_read(const struct bank *bank, enum bank_side side, uint16_t at) {
    return read_at(bank, (uint8_t)(bank->current ^ side), (uint16_t)(at + BANK_HEADER));
}

struct header {
    uint8_t mark, sequence;
    uint16_t length;
    uint32_t digest;
};
_Static_assert(sizeof(struct header) == BANK_HEADER, "as it lies in memory");

static bool is_good(const struct bank *bank, uint8_t index,
                    const struct header *header) {
    if (header->length > bank->size - BANK_HEADER) {
        return false;
    }
    uint32_t crc = 0;
    for (uint16_t at = 0; at < header->length; ++at) {
        crc = crc32_add(crc, read_at(bank, index, (uint16_t)(at + BANK_HEADER)));
    }
    return crc == header->digest;
}

bool bank_open(struct bank *bank, const struct memory *memory, uint16_t first,
               uint16_t size) {
    memset(bank, 0, sizeof *bank);
    bank->writer.memory = memory;
    bank->first = first;
    bank->size = size;
    bool is_whole = true;
    bool has_one = false;
    for (uint8_t index = 0; index < 2; ++index) {
        uint8_t bytes[BANK_HEADER];
        struct header header;
        for (uint8_t i = 0; i < BANK_HEADER; ++i) {
            bytes[i] = read_at(bank, index, i);
        }
        memcpy(&header, bytes, sizeof header);
        if (header.mark != mark_of(header.sequence)) {
            continue;
        }
        if (!is_good(bank, index, &header)) {
            is_whole = false;
            continue;
        }
        // Written in turn: the newer is one ahead, modulo 256.
        if (!has_one || (uint8_t)(header.sequence - bank->sequence) == 1) {
            has_one = true;
            bank->current = index;
            bank->sequence = header.sequence;
            bank->length = header.length;
            bank->digest = header.digest;
        }
    }
    return is_whole;
}

static enum memory_result write_at(struct bank *bank, uint16_t at, uint8_t value) {
    return memory_put(&bank->writer, place_of(bank, bank->current ^ 1, at), value);
}

enum memory_result bank_blank(struct bank *bank) {
    const uint8_t spare = bank->current ^ 1;
    const uint8_t mark = mark_of(read_at(bank, spare, AT_SEQUENCE));
    // What else it may hold is no mark, and so as good as blank.
    return read_at(bank, spare, AT_MARK) == mark
               ? write_at(bank, AT_MARK, (uint8_t)~mark)
               : MEMORY_OK;
}

enum memory_result bank_put(struct bank *bank, uint16_t at, uint8_t value) {
    return write_at(bank, (uint16_t)(at + BANK_HEADER), value);
}

enum memory_result bank_commit(struct bank *bank, uint16_t length, uint32_t digest) {
    const uint8_t sequence = (uint8_t)(bank->sequence + 1);
    const struct header header = {mark_of(sequence), sequence, length, digest};
    uint8_t bytes[BANK_HEADER];
    memcpy(bytes, &header, sizeof bytes);
    // The mark last.
    for (uint8_t i = BANK_HEADER; i-- > 0;) {
        const enum memory_result result = write_at(bank, i, bytes[i]);
        if (result != MEMORY_OK) {
            return result;
        }
    }
    bank->current ^= 1;
    ++bank->sequence;
    bank->length = length;
    bank->digest = digest;
    return MEMORY_OK;
}
