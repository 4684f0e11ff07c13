// SPDX-License-Identifier: MIT
// Flash sectors 10 and 11, 128 KB each, as the journal of the settings. A save of one
// number, as at each start, takes six records: a sector lasts for 4000 starts until it
// is carried over, and for 1300 saves within one run.
#include "flash.h"

#include "../board.h"
#include "clock.h"
#include "cpu.h"
#include "generic/journal.h"

enum {
    FIRST_SECTOR = 10,
    SECTOR_BYTES = 128 * 1024,
    KEY_1 = 0x45670123,
    // 100 us and 2 s by the data sheet ("Flash memory programming"), and as much again.
    PROGRAM_US_MAX = 200,
    ERASE_US_MAX = 4000000,
};
#define KEY_2 UINT32_C(0xCDEF89AB)
#define FIRST_ADDRESS UINT32_C(0x080C0000)

static struct journal journal;

static volatile uint32_t *address_of(uint8_t sector, uint32_t word) {
    return (volatile uint32_t *)(FIRST_ADDRESS + sector * SECTOR_BYTES) + word;
}

static bool is_done(uint32_t us_max) {
    const uint32_t begun_us = clock_us();
    while ((FLASH->sr & FLASH_SR_BSY) != 0) {
        if (clock_us() - begun_us > us_max) {
            return false;
        }
    }
    return true;
}

static void unlock(void) {
    if ((FLASH->cr & FLASH_CR_LOCK) != 0) {
        FLASH->keyr = KEY_1;
        FLASH->keyr = KEY_2;
    }
    FLASH->sr = FLASH_SR_ERRORS;  // of the past; ones clear
}

static uint32_t read_word(uint8_t sector, uint32_t word) {
    return *address_of(sector, word);
}

// "Flash programming sequences": 32 bits at once need 2.7 V. The processor waits,
// because its code lies in the flash that is busy. In the end it is locked again,
// whether this succeeded or not.
static void program_word(uint8_t sector, uint32_t word, uint32_t value) {
    if (!is_done(PROGRAM_US_MAX)) {
        return;
    }
    unlock();
    FLASH->cr = FLASH_CR_PSIZE_X32 | FLASH_CR_PG;
    *address_of(sector, word) = value;
    cpu_barrier();
    (void)is_done(PROGRAM_US_MAX);
    FLASH->cr = FLASH_CR_LOCK;
}

static void erase_sector(uint8_t sector) {
    if (!is_done(PROGRAM_US_MAX)) {
        return;
    }
    unlock();
    FLASH->cr = FLASH_CR_PSIZE_X32 | FLASH_CR_SER | FLASH_CR_SNB(FIRST_SECTOR + sector);
    FLASH->cr |= FLASH_CR_STRT;
    cpu_barrier();
    (void)is_done(ERASE_US_MAX);
    FLASH->cr = FLASH_CR_LOCK;
    // The data cache may still hold what was erased ("Flash erase sequences", note);
    // it may be cleared only while it is off.
    const uint32_t acr = FLASH->acr;
    FLASH->acr = acr & ~FLASH_ACR_DCEN;
    FLASH->acr = (acr & ~FLASH_ACR_DCEN) | FLASH_ACR_DCRST;
    FLASH->acr = acr & ~FLASH_ACR_DCEN;
    FLASH->acr = acr;
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
