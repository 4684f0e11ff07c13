// SPDX-License-Identifier: MIT
// Words of the journal: value in bits 0 to 7, offset in 8 to 23, the number of zeros
// among those 24 in bits 24 to 31. A header has its generation for an offset.
#include "generic/journal.h"

#include <string.h>

enum {
    DATA_BITS = 24,
    HEADER = 0,            // its place
    HEADER_MARK = 0xA5,    // its value
    CARRY_AT_QUARTER = 3,  // of the words programmed
};

#define DATA_MASK UINT32_C(0x00FFFFFF)
#define BLANK UINT32_C(0xFFFFFFFF)

static uint32_t sealed(uint16_t offset, uint8_t value) {
    const uint32_t data = (uint32_t)offset << 8 | value;
    uint32_t zeros = DATA_BITS;
    for (uint32_t rest = data; rest != 0; rest &= rest - 1) {
        zeros--;
    }
    return zeros << DATA_BITS | data;
}

static bool is_sealed(uint32_t word) {
    return word == sealed((uint16_t)((word & DATA_MASK) >> 8), (uint8_t)word);
}

static uint16_t offset_of(uint32_t word) {
    return (uint16_t)((word & DATA_MASK) >> 8);
}

static bool program(const struct journal *journal, uint8_t sector, uint32_t place,
                    uint32_t word) {
    journal->flash->program(sector, place, word);
    return journal->flash->read(sector, place) == word;
}

static bool has_header(const struct journal_flash *flash, uint8_t sector,
                       uint16_t *generation) {
    const uint32_t word = flash->read(sector, HEADER);
    *generation = offset_of(word);
    return is_sealed(word) && (uint8_t)word == HEADER_MARK;
}

// Reads the records, and finds the word behind the last one that is not blank.
static void replay(struct journal *journal) {
    journal->next = HEADER + 1;
    for (uint32_t place = HEADER + 1; place < journal->flash->words; place++) {
        const uint32_t word = journal->flash->read(journal->sector, place);
        if (word == BLANK) {
            continue;
        }
        journal->next = place + 1;
        if (is_sealed(word) && offset_of(word) < JOURNAL_BYTES) {
            journal->bytes[offset_of(word)] = (uint8_t)word;
        }
    }
}

static bool is_blank(const struct journal_flash *flash, uint8_t sector) {
    for (uint32_t place = 0; place < flash->words; place++) {
        if (flash->read(sector, place) != BLANK) {
            return false;
        }
    }
    return true;
}

// To a blank sector. False where flash does not take it: the one before still counts.
static bool carry_to(struct journal *journal, uint8_t sector, uint16_t generation) {
    uint32_t place = HEADER + 1;
    for (uint16_t offset = 0; offset < JOURNAL_BYTES; offset++) {
        if (journal->bytes[offset] == JOURNAL_ERASED) {
            continue;
        }
        if (!program(journal, sector, place, sealed(offset, journal->bytes[offset]))) {
            return false;
        }
        place++;
    }
    if (!program(journal, sector, HEADER, sealed(generation, HEADER_MARK))) {
        return false;
    }
    journal->sector = sector;
    journal->generation = generation;
    journal->next = place;
    return true;
}

void journal_open(struct journal *journal, const struct journal_flash *flash) {
    journal->flash = flash;
    memset(journal->bytes, JOURNAL_ERASED, sizeof journal->bytes);
    uint16_t generations[JOURNAL_SECTORS];
    const bool has[JOURNAL_SECTORS] = {has_header(flash, 0, &generations[0]),
                                       has_header(flash, 1, &generations[1])};
    if (!has[0] && !has[1]) {
        if (!is_blank(flash, 0)) {
            flash->erase(0);
        }
        if (!carry_to(journal, 0, 1)) {
            journal->next = flash->words;
        }
        return;
    }
    // The newer is one ahead, modulo 2^16.
    const bool is_second =
        has[1] && (!has[0] || (uint16_t)(generations[1] - generations[0]) == 1);
    journal->sector = is_second ? 1 : 0;
    journal->generation = generations[journal->sector];
    replay(journal);
    if (journal->next > flash->words / 4 * CARRY_AT_QUARTER) {
        const uint8_t other = journal->sector ^ 1;
        // Blank or not: its erasure may have been cut short just before its end.
        flash->erase(other);
        (void)carry_to(journal, other, (uint16_t)(journal->generation + 1));
    }
}

void journal_write(struct journal *journal, uint16_t offset, uint8_t value) {
    if (journal->next >= journal->flash->words || offset >= JOURNAL_BYTES) {
        return;
    }
    const uint32_t place = journal->next++;
    if (program(journal, journal->sector, place, sealed(offset, value))) {
        journal->bytes[offset] = value;
    }
}

uint8_t journal_get(void *journal, uint16_t offset) {
    return ((const struct journal *)journal)->bytes[offset];
}

void journal_set(void *journal, uint16_t offset, uint8_t value) {
    journal_write(journal, offset, value);
}

bool journal_is_ready(void *journal) {
    (void)journal;
    return true;
}
