// SPDX-License-Identifier: MIT
// The flash interface: programming and erasing, with the time they take.
#ifndef SIM_F405_PERIPHERALS_FLASH_H
#define SIM_F405_PERIPHERALS_FLASH_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_flash {
    uint32_t acr, sr, cr, optcr;
    unsigned keys;  // of the unlock sequence, so far
    bool is_key_wrong;
    bool is_busy, is_erase;
    uint32_t from, size;  // of what is under way: offset, bytes
    uint32_t value, before;
    uint64_t began, busy_until;
    uint64_t writes;
    // Stores that libunicorn is about to make, and what shall stand there instead.
    struct {
        uint32_t offset, size, value;
    } stores[16];
    unsigned store_count;
    bool has_stored;  // since libunicorn last looked up what it may write
};

void flash_reset(struct f405 *m, unsigned unit);
void flash_event(struct f405 *m);
// The core stores to an address of flash; then, once libunicorn has made the store,
// memory gets what programming really left there.
void flash_store(struct f405 *m, uint32_t address, unsigned size, uint32_t value);
void flash_settle(struct f405 *m);
uint32_t flash_read(struct f405 *m, unsigned unit, uint32_t at);
void flash_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
