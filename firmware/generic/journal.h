// SPDX-License-Identifier: MIT
// A thousand bytes that can be written one by one, kept in flash that can only be
// erased a sector at a time: records appended to one of two sectors. No registers.
//
// The first word of a sector is its header, with a generation; the newer generation
// counts. Behind it each word says that one byte has a value from then on. A power cut
// while a word is programmed leaves some of its bits at 1 that should be 0: each word
// holds the number of its zeros, and no such change keeps the two in step (J. M.
// Berger, 1961, "A note on error detection codes for asymmetric channels"). The same
// holds of an erasure cut short.
//
// A sector is erased only when the journal is opened, because the processor stands
// still meanwhile: then the bytes are carried over to the other one. Its header is
// written last, and until then the old one counts.
#ifndef JOURNAL_H
#define JOURNAL_H

#include <stdbool.h>
#include <stdint.h>

#include "core/storage/memory.h"

enum {
    JOURNAL_SECTORS = 2,
    JOURNAL_BYTES = 1024,
    JOURNAL_ERASED = 0xFF,  // a byte that was never written
};

_Static_assert((int)MEMORY_SIZE <= (int)JOURNAL_BYTES, "the memory must fit");

struct journal_flash {
    uint32_t words;  // in a sector
    uint32_t (*read)(uint8_t sector, uint32_t word);
    // An erased word reads as all ones, and can be programmed once. Nothing is promised
    // of how it ends: who asks reads it back.
    void (*program)(uint8_t sector, uint32_t word, uint32_t value);
    void (*erase)(uint8_t sector);
};

struct journal {
    const struct journal_flash *flash;
    uint8_t sector;
    uint16_t generation;
    uint32_t next;  // word to be programmed; flash->words where there is no room
    uint8_t bytes[JOURNAL_BYTES];
};

// Reads what is there. Erases and carries over where a quarter of the sector or less is
// free; erases, too, where no sector has a header and the first is not blank.
void journal_open(struct journal *journal, const struct journal_flash *flash);

// Appends one record. The byte keeps its old value where flash does not take it.
void journal_write(struct journal *journal, uint16_t offset, uint8_t value);

// Initialiser of a struct memory over a journal: a write is over when it returns.
#define JOURNAL_MEMORY(journal)                                                        \
    { journal_get, journal_set, journal_is_ready, (journal) }
uint8_t journal_get(void *journal, uint16_t offset);
void journal_set(void *journal, uint16_t offset, uint8_t value);
bool journal_is_ready(void *journal);

#endif
