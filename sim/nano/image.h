// SPDX-License-Identifier: MIT
// An image for a Nano or a Mega, as the linker left it: an ELF file.
#ifndef SIM_NANO_IMAGE_H
#define SIM_NANO_IMAGE_H

#include <simavr/sim_elf.h>

#include "machine.h"

struct image {
    elf_firmware_t elf;
    uint32_t flash, ram;  // bytes: code and first values; variables
};

// The processor that it was linked for. Null where it is no such image.
const struct machine_kind *image_kind(const char *path);

// Flashes it, and its EEPROM where it has one. False where it is no such image.
bool image_load(struct image *image, const char *path, struct machine *machine);

// Data-space address of a variable. False where there is none of that name.
bool image_find(const struct image *image, const char *name, uint16_t *address);

#endif
