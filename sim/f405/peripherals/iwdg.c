// SPDX-License-Identifier: MIT
// The independent watchdog, on its own oscillator (RM, "Independent watchdog"). Nothing
// but a reset stops it.
#include "f405/f405.h"

enum {
    KR = 0x00,
    PR = 0x04,
    RLR = 0x08,
    SR = 0x0C,
    KEY_OPEN = 0x5555,
    KEY_RELOAD = 0xAAAA,
    KEY_START = 0xCCCC,
    UPDATE_CYCLES = 5,  // of the oscillator, until a new value holds
    LSION = 1 << 0,
    LSIRDY = 1 << 1,
};

static void reload(struct f405 *m) {
    const struct f405_iwdg *iwdg = &m->iwdg;
    const uint64_t ticks = (uint64_t)(iwdg->reload + 1) * (4U << iwdg->prescaler);
    f405_at(m, EVENT_IWDG, f405_when(m) + f405_ps(ticks, F405_LSI_HZ));
}

void iwdg_event(struct f405 *m) {
    f405_reset(m, F405_RESET_WATCHDOG);
}

uint32_t iwdg_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    const struct f405_iwdg *iwdg = &m->iwdg;
    switch (at) {
    case PR:
        return iwdg->prescaler;
    case RLR:
        return iwdg->reload;
    case SR:
        return f405_when(m) < iwdg->changed_until ? 3 : 0;
    default:
        return 0;
    }
}

static void write_key(struct f405 *m, uint32_t value) {
    struct f405_iwdg *iwdg = &m->iwdg;
    iwdg->is_open = value == KEY_OPEN;
    if (value == KEY_START) {
        iwdg->is_running = true;
        m->rcc.csr |= LSION | LSIRDY;
        reload(m);
    } else if (value == KEY_RELOAD && iwdg->is_running) {
        reload(m);
    }
}

void iwdg_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_iwdg *iwdg = &m->iwdg;
    if (at == KR) {
        write_key(m, value & 0xFFFF);
        return;
    }
    if (!iwdg->is_open) {
        f405_complain(m, "the watchdog written without its key");
        return;
    }
    if (at == PR) {
        iwdg->prescaler = (value & 7) > 6 ? 6 : value & 7;
    } else if (at == RLR) {
        iwdg->reload = value & 0xFFF;
    }
    iwdg->changed_until = f405_when(m) + f405_ps(UPDATE_CYCLES, F405_LSI_HZ);
}

void iwdg_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    m->iwdg = (struct f405_iwdg){.reload = 0xFFF};
    f405_never(m, EVENT_IWDG);
}
