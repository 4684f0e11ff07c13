// SPDX-License-Identifier: MIT
// Two banks under one CRC each; see bank.h.
#include "core/storage/bank.h"

#include <stddef.h>
#include <string.h>

enum {
    MARK_XOR = 0xB2,                                     // no byte is its own mark
    LIST_SIZE = offsetof(struct bank_list, length) + 1,  // without gaps
};

struct header {
    uint8_t mark, sequence;
    uint16_t length;
    uint32_t digest;
};
_Static_assert(sizeof(struct header) == BANK_HEADER, "as it lies in memory");

// The mark that goes with a sequence number, so that neither can be spoilt alone.
static uint8_t mark_of(uint8_t sequence) {
    return sequence ^ MARK_XOR;
}

uint8_t bank_read(const struct bank *bank, enum bank_side side, uint8_t at) {
    return memory_read(bank->writer.memory, (uint16_t)(bank->content[side] + at));
}

bool bank_list_equals(const struct bank_list *a, const struct bank_list *b) {
    const uint8_t *of_a = (const uint8_t *)a;
    const uint8_t *of_b = (const uint8_t *)b;
    for (uint8_t left = LIST_SIZE; left > 0; --left) {
        if (*of_a++ != *of_b++) {
            return false;
        }
    }
    return true;
}

// True where content of that length fits a bank of that size, and its CRC is right.
static bool is_good(const IN_FLASH struct memory *memory, uint16_t content,
                    uint16_t size, const struct header *header) {
    uint32_t crc = 0;
    if (header->length > size - BANK_HEADER) {
        return false;
    }
    for (uint8_t at = 0; at < header->length; ++at) {
        crc32_add(&crc, memory_read(memory, content++));
    }
    return crc == header->digest;
}

bool bank_open(struct bank *bank, const IN_FLASH struct memory *memory, uint16_t first,
               uint16_t size) {
    memset(bank, 0, sizeof *bank);
    bank->writer.memory = memory;
    uint16_t content = (uint16_t)(first + BANK_HEADER);
    bank->content[BANK_CURRENT] = content;
    bool is_whole = true;
    bool has_one = false;
    for (uint8_t turn = 0; turn < 2; ++turn) {
        struct header header;
        memory_copy(memory, (uint16_t)(content - BANK_HEADER), &header, sizeof header);
        if (header.mark == mark_of(header.sequence)) {
            if (!is_good(memory, content, size, &header)) {
                is_whole = false;
            } else if (!has_one || (uint8_t)(header.sequence - bank->sequence) == 1) {
                // Written in turn: the newer is one ahead, modulo 256.
                has_one = true;
                bank->content[BANK_CURRENT] = content;
                bank->sequence = header.sequence;
                bank->list = (struct bank_list){header.digest, (uint8_t)header.length};
            }
        }
        content = (uint16_t)(content + size);
    }
    // Whichever of the two the other one is.
    bank->content[BANK_SPARE] =
        (uint16_t)(2 * (first + BANK_HEADER) + size - bank->content[BANK_CURRENT]);
    return is_whole;
}

enum memory_result bank_put(struct bank *bank, uint8_t at, uint8_t value) {
    return memory_put(&bank->writer, (uint16_t)(bank->content[BANK_SPARE] + at), value);
}

enum memory_result bank_blank(struct bank *bank) {
    const uint16_t place = (uint16_t)(bank->content[BANK_SPARE] - BANK_HEADER);
    uint8_t bytes[2];
    memory_copy(bank->writer.memory, place, bytes, sizeof bytes);
    const uint8_t mark = mark_of(bytes[1]);
    // What else it may hold is no mark, and so as good as blank.
    return bytes[0] == mark ? memory_put(&bank->writer, place, (uint8_t)~mark)
                            : MEMORY_OK;
}

enum memory_result bank_commit(struct bank *bank, const struct bank_list *list) {
    const uint8_t sequence = (uint8_t)(bank->sequence + 1);
    const struct header header = {mark_of(sequence), sequence, list->length,
                                  list->digest};
    uint8_t bytes[BANK_HEADER];
    memcpy(bytes, &header, sizeof bytes);
    const uint16_t spare = bank->content[BANK_SPARE];
    // The mark last.
    for (uint8_t i = BANK_HEADER; i-- > 0;) {
        const enum memory_result result =
            memory_put(&bank->writer, (uint16_t)(spare - BANK_HEADER + i), bytes[i]);
        if (result != MEMORY_OK) {
            return result;
        }
    }
    bank->content[BANK_SPARE] = bank->content[BANK_CURRENT];
    bank->content[BANK_CURRENT] = spare;
    bank->sequence = sequence;
    bank->list = *list;
    return MEMORY_OK;
}
