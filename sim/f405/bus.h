// SPDX-License-Identifier: MIT
// The address space of the STM32F405 as its bus masters see it: memory and the
// registers of peripherals.
#ifndef SIM_F405_BUS_H
#define SIM_F405_BUS_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

// Where the core's accesses arrive that no memory answers; outside of these windows it
// gets a bus fault.
struct bus_window {
    uint32_t base, size;
};
enum { BUS_WINDOWS = 8 };
extern const struct bus_window bus_windows[BUS_WINDOWS];

// The emulator's address of `size` bytes of RAM, CCM or flash. Null: of other memory.
uint8_t *f405_memory(struct f405 *m, uint32_t address, uint32_t size);
bool f405_is_flash(uint32_t address);
// Whether the RCC clocks the peripheral with that bit of that bus.
bool f405_is_clocked(const struct f405 *m, unsigned bus, unsigned bit);
// An access of 1, 2 or 4 bytes as the core does it; false where nothing answers.
bool f405_bus_read(struct f405 *m, uint32_t address, unsigned size, uint32_t *value);
bool f405_bus_write(struct f405 *m, uint32_t address, unsigned size, uint32_t value);
// Lets DMA serve the peripherals that ask for it.
void f405_pump(struct f405 *m);
// Resets each peripheral that has a reset of its own.
void bus_reset(struct f405 *m);

#endif
