// SPDX-License-Identifier: MIT
// The independent watchdog.
#ifndef SIM_F405_PERIPHERALS_IWDG_H
#define SIM_F405_PERIPHERALS_IWDG_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_iwdg {
    uint32_t prescaler, reload;
    bool is_open, is_running;
    uint64_t changed_until;
};

void iwdg_reset(struct f405 *m, unsigned unit);
void iwdg_event(struct f405 *m);
uint32_t iwdg_read(struct f405 *m, unsigned unit, uint32_t at);
void iwdg_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
