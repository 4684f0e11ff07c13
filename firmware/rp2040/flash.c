// SPDX-License-Identifier: MIT
// The last 64 KB of flash as the journal of the settings, half for each of its sectors:
// an image that is copied to the board leaves them alone. A word of the journal is
// programmed as a page of 256 bytes whose others are ones, which change nothing.
//
// All code and constants are in RAM: interrupts run while flash is busy, and samples
// are read and stamped as ever. Only the main loop waits, 0.4 to 3 ms for a word.
#include "flash.h"

#include <string.h>

#include "../board.h"
#include "generic/journal.h"
#include "hardware/flash.h"
#include "pico.h"

enum {
    SECTOR_BYTES = 32 * 1024,
    FIRST = PICO_FLASH_SIZE_BYTES - JOURNAL_SECTORS * SECTOR_BYTES,
    PAGE_WORDS = FLASH_PAGE_SIZE / sizeof(uint32_t),
};

_Static_assert(SECTOR_BYTES % FLASH_SECTOR_SIZE == 0, "it is erased by sectors");

static struct journal journal;

static uint32_t offset_of(uint8_t sector, uint32_t word) {
    return FIRST + (uint32_t)sector * SECTOR_BYTES + word * sizeof(uint32_t);
}

// Past the cache, which may still hold the previous contents.
static uint32_t read_word(uint8_t sector, uint32_t word) {
    return *(const volatile uint32_t *)(XIP_NOCACHE_NOALLOC_BASE +
                                        offset_of(sector, word));
}

static void program_word(uint8_t sector, uint32_t word, uint32_t value) {
    static uint32_t page[PAGE_WORDS];
    memset(page, 0xFF, sizeof page);
    page[word % PAGE_WORDS] = value;
    flash_range_program(offset_of(sector, word / PAGE_WORDS * PAGE_WORDS),
                        (const uint8_t *)page, sizeof page);
}

static void erase_sector(uint8_t sector) {
    flash_range_erase(offset_of(sector, 0), SECTOR_BYTES);
}

void flash_init(void) {
    static const struct journal_flash flash = {
        .words = SECTOR_BYTES / sizeof(uint32_t),
        .read = read_word,
        .program = program_word,
        .erase = erase_sector,
    };
    journal_open(&journal, &flash);
}

const IN_FLASH struct memory board_memory = JOURNAL_MEMORY(&journal);
