// SPDX-License-Identifier: MIT
// Writing to flash (RM, "Embedded Flash memory interface"): keys, programming that
// clears bits, erasing of sectors, the time of both, and what a power cut leaves of a
// write under way.
#include <string.h>

#include "f405/f405.h"

enum {
    ACR = 0x00,
    KEYR = 0x04,
    SR = 0x0C,
    CR = 0x10,
    OPTCR = 0x14,
    SR_EOP = 1 << 0,
    SR_OPERR = 1 << 1,
    SR_WRPERR = 1 << 4,
    SR_PGPERR = 1 << 6,
    SR_PGSERR = 1 << 7,
    SR_FLAGS = 0xF3,
    SR_ERRORS = 0xF2,
    SR_BSY = 1 << 16,
    CR_PG = 1 << 0,
    CR_SER = 1 << 1,
    CR_MER = 1 << 2,
    CR_STRT = 1 << 16,
    CR_EOPIE = 1 << 24,
    CR_ERRIE = 1 << 25,
    CR_LOCK = 1U << 31,
    PSIZE_8 = 0,
    PSIZE_16 = 1,
    PSIZE_32 = 2,
};
static const uint32_t keys[2] = {0x45670123, 0xCDEF89AB};

// DS, "Flash memory programming", typical, with the parallelism that 3.3 V allows.
#define PROGRAM_PS (16 * F405_PS_PER_US)
static const uint16_t erase_ms[3][3] = {
    // by PSIZE: 16, 64, 128 KB
    {400, 1200, 2000},
    {300, 700, 1300},
    {250, 550, 1000},
};

static void sector_span(unsigned number, uint32_t *from, uint32_t *size) {
    if (number < 4) {
        *from = number * 0x4000;
        *size = 0x4000;
    } else if (number == 4) {
        *from = 0x10000;
        *size = 0x10000;
    } else {
        *from = (number - 4) * 0x20000;
        *size = 0x20000;
    }
}

static void follow_line(struct f405 *m) {
    const struct f405_flash *flash = &m->flash_control;
    const bool errs = (flash->sr & SR_ERRORS) != 0;
    core_irq(m, EXCEPTION_IRQ + IRQ_FLASH,
             ((flash->sr & SR_EOP) && (flash->cr & CR_EOPIE)) ||
                 (errs && (flash->cr & CR_ERRIE)));
}

static void begin(struct f405 *m, bool is_erase, uint64_t length_ps) {
    struct f405_flash *flash = &m->flash_control;
    const uint64_t now = f405_when(m);
    flash->began = flash->busy_until > now ? flash->busy_until : now;
    flash->busy_until = flash->began + length_ps;
    flash->is_busy = true;
    flash->is_erase = is_erase;
    flash->writes++;
    f405_at(m, EVENT_FLASH, flash->busy_until);
    f405_attend(m);
    if (m->on_flash_write != NULL) {
        m->on_flash_write(m->context, flash->writes);
    }
}

static void put(struct f405 *m, uint32_t offset, uint32_t size, uint32_t value) {
    memcpy(m->flash + offset, &value, size);
}

static uint32_t get(const struct f405 *m, uint32_t offset, uint32_t size) {
    uint32_t value = 0;
    memcpy(&value, m->flash + offset, size);
    return value;
}

// Drops the code that libunicorn has translated from there, at both of flash's
// addresses.
static void forget_code(struct f405 *m, uint32_t from, uint32_t size) {
    (void)uc_ctl_remove_cache(m->uc, (uint64_t)from, (uint64_t)from + size);
    (void)uc_ctl_remove_cache(m->uc, (uint64_t)F405_FLASH + from,
                              (uint64_t)F405_FLASH + from + size);
}

// An erase leaves the old bits in place until it is done, as nothing can read them
// meanwhile.
void flash_event(struct f405 *m) {
    struct f405_flash *flash = &m->flash_control;
    if (flash->is_erase) {
        memset(m->flash + flash->from, 0xFF, flash->size);
        forget_code(m, flash->from, flash->size);
    }
    flash->is_busy = false;
    flash->sr |= (flash->cr & CR_EOPIE) != 0 ? SR_EOP : 0;
    follow_line(m);
}

// An access during a write waits on the bus until it is done.
static void wait_for_flash(struct f405 *m) {
    if (m->flash_control.is_busy) {
        f405_complain(m, "flash told to work while it is busy");
        flash_event(m);
    }
}

void flash_store(struct f405 *m, uint32_t address, unsigned size, uint32_t value) {
    struct f405_flash *flash = &m->flash_control;
    wait_for_flash(m);
    const uint32_t offset = address & (F405_FLASH_SIZE - 1);
    const uint32_t before = get(m, offset, size);
    uint32_t after = before;
    const unsigned parallel = (flash->cr >> 8) & 3;
    if ((flash->cr & CR_PG) == 0) {
        flash->sr |= SR_PGSERR;
        f405_complain(m, "a store to flash that is not open for programming");
    } else if ((flash->sr & SR_ERRORS) != 0) {
        f405_complain(m, "flash programmed with an error flag still set");
    } else if (size != 1U << parallel) {
        flash->sr |= SR_PGPERR;
        f405_complain(m, "a store to flash of another width than PSIZE");
    } else {
        after = before & value;
        if (after != value) {
            f405_complain(m, "flash programmed that is not erased");
        }
        flash->from = offset;
        flash->size = size;
        flash->before = before;
        flash->value = after;
        begin(m, false, PROGRAM_PS);
    }
    follow_line(m);
    // libunicorn continues and makes the store unchanged.
    if (flash->store_count < sizeof flash->stores / sizeof *flash->stores) {
        flash->stores[flash->store_count].offset = offset;
        flash->stores[flash->store_count].size = size;
        flash->stores[flash->store_count].value = after;
        flash->store_count++;
    }
    flash->has_stored = true;
}

void flash_settle(struct f405 *m) {
    struct f405_flash *flash = &m->flash_control;
    for (unsigned i = 0; i < flash->store_count; i++) {
        put(m, flash->stores[i].offset, flash->stores[i].size, flash->stores[i].value);
    }
    flash->store_count = 0;
}

// Each bit of a write changes at a moment of its own.
static uint32_t mix(struct f405 *m, uint32_t before, uint32_t after,
                    unsigned permille) {
    uint32_t mask = 0;
    for (unsigned bit = 0; bit < 32; bit++) {
        mask |= f405_random(m) % 1000 < permille ? UINT32_C(1) << bit : 0;
    }
    return (before & ~mask) | (after & mask);
}

void f405_cut_flash(struct f405 *m) {
    struct f405_flash *flash = &m->flash_control;
    flash_settle(m);
    if (!flash->is_busy) {
        return;
    }
    const uint64_t now = f405_now(m);
    const uint64_t gone = now > flash->began ? now - flash->began : 0;
    const uint64_t length = flash->busy_until - flash->began;
    const unsigned permille = (unsigned)(gone >= length ? 1000 : gone * 1000 / length);
    if (flash->is_erase) {
        for (uint32_t i = 0; i < flash->size; i += 4) {
            put(m, flash->from + i, 4,
                mix(m, get(m, flash->from + i, 4), UINT32_MAX, permille));
        }
    } else {
        put(m, flash->from, flash->size, mix(m, flash->before, flash->value, permille));
    }
    flash->is_busy = false;
    forget_code(m, flash->from, flash->size);
}

static void write_key(struct f405 *m, uint32_t value) {
    struct f405_flash *flash = &m->flash_control;
    if (flash->is_key_wrong || flash->keys == 2 || value != keys[flash->keys]) {
        // RM, "Unlocking the Flash control register"; the bus error after a wrong key
        // is not modelled.
        flash->is_key_wrong = true;
        f405_complain(m, "a wrong key for flash: locked until the next reset");
        return;
    }
    flash->keys++;
    if (flash->keys == 2) {
        flash->cr &= ~(uint32_t)CR_LOCK;
    }
}

static void erase(struct f405 *m) {
    struct f405_flash *flash = &m->flash_control;
    wait_for_flash(m);
    const unsigned sector = (flash->cr >> 3) & 15;
    const unsigned parallel = (flash->cr >> 8) & 3;
    if ((flash->cr & (CR_SER | CR_MER | CR_PG)) != CR_SER) {
        f405_not_modelled(m, "an erase that is not of one sector");
    } else if (sector > 11 || parallel > PSIZE_32) {
        flash->sr |= SR_OPERR;
        f405_complain(m, "an erase of no sector, or with 64 bits at once");
        follow_line(m);
    } else {
        sector_span(sector, &flash->from, &flash->size);
        const unsigned kind = sector < 4 ? 0 : sector == 4 ? 1 : 2;
        begin(m, true, erase_ms[parallel][kind] * 1000 * F405_PS_PER_US);
    }
}

static void write_control(struct f405 *m, uint32_t value) {
    struct f405_flash *flash = &m->flash_control;
    if ((flash->cr & CR_LOCK) != 0) {
        f405_complain(m, "FLASH_CR written while it is locked");
        return;
    }
    flash->cr = value & (CR_LOCK | CR_EOPIE | CR_ERRIE | 0x37F);
    if ((value & CR_LOCK) != 0) {
        flash->keys = 0;
    } else if ((value & CR_STRT) != 0) {
        erase(m);
    }
    follow_line(m);
}

uint32_t flash_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    const struct f405_flash *flash = &m->flash_control;
    switch (at) {
    case ACR:
        return flash->acr;
    case KEYR:
        return 0;
    case SR:
        return flash->sr | (flash->is_busy ? SR_BSY : 0);
    case CR:
        return flash->cr | (flash->is_busy && flash->is_erase ? CR_STRT : 0);
    case OPTCR:
        return 0x0FFFAAED;
    default:
        f405_end(m, "reads 0x%08x, which is not modelled,", 0x40023C00U + at);
        return 0;
    }
}

void flash_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_flash *flash = &m->flash_control;
    switch (at) {
    case ACR:
        flash->acr = value & 0x1F07;
        rcc_set_clocks(m);
        break;
    case KEYR:
        write_key(m, value);
        break;
    case SR:
        flash->sr &= ~(value & SR_FLAGS);
        follow_line(m);
        break;
    case CR:
        write_control(m, value);
        break;
    default:
        f405_end(m, "writes 0x%08x, which is not modelled,", 0x40023C00U + at);
        break;
    }
}

// A write under way is lost with a reset (RM, "Erase and program operations").
void flash_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    struct f405_flash *flash = &m->flash_control;
    f405_cut_flash(m);
    const uint64_t writes = flash->writes;
    *flash = (struct f405_flash){.cr = CR_LOCK, .writes = writes};
}
