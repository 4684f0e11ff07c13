// SPDX-License-Identifier: MIT
// Two banks of memory with bytes under one CRC, written in turn: what is being written
// goes into the spare bank, and counts from one write to the next, or not at all,
// wherever the power is cut.
//
// A bank: a mark, which checks the sequence number behind it, the content's length and
// its CRC-32, little endian, then the content. The mark is blanked before anything else
// of a bank is touched and written back last.
#ifndef BANK_H
#define BANK_H

#include "core/storage/crc32.h"
#include "core/storage/memory.h"

enum { BANK_HEADER = 8 };  // bytes of a bank before its content, of up to 248

enum bank_side { BANK_CURRENT = 0, BANK_SPARE = 1 };

// A list of bytes: their CRC-32, and how many.
struct bank_list {
    uint32_t digest;
    uint8_t length;
};

struct bank {
    struct memory_writer writer;
    uint16_t content[2];    // offset in memory of each side's, by enum bank_side
    uint8_t sequence;       // of the current bank
    struct bank_list list;  // its content; none where neither is good
};

bool bank_list_equals(const struct bank_list *a, const struct bank_list *b);

// Finds the newer good bank. Returns false where a bank with a mark is not what its CRC
// says: what was in it is lost, and the other one counts, if it is good. The memory
// must be ready. `first`: offset of the first bank; `size`: of each.
bool bank_open(struct bank *bank, const IN_FLASH struct memory *memory, uint16_t first,
               uint16_t size);

// A byte of a side's content.
uint8_t bank_read(const struct bank *bank, enum bank_side side, uint8_t at);

// Each of these starts to write one byte at most, for which the memory must be ready,
// and returns MEMORY_BUSY; MEMORY_OK where nothing is left to be written, and
// MEMORY_FAILED if three writes of a byte failed.

// Blanks the mark of the spare bank, if it has one.
enum memory_result bank_blank(struct bank *bank) MUST_CHECK;
// A byte of the spare bank's content.
enum memory_result bank_put(struct bank *bank, uint8_t at, uint8_t value) MUST_CHECK;
// Makes the spare bank the current one. `list`: its content.
enum memory_result bank_commit(struct bank *bank,
                               const struct bank_list *list) MUST_CHECK;

#endif
