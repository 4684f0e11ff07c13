// SPDX-License-Identifier: MIT
// Reads an image by libsimavr, once it looks like one; see image.h.
#include "image.h"

#include <elf.h>
#include <stdio.h>
#include <string.h>

// What the ELF's header says, before libsimavr believes it.
static bool is_avr_image(const char *path) {
    uint8_t header[20] = {0};
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return false;
    }
    const bool is_whole = fread(header, 1, sizeof header, file) == sizeof header;
    (void)fclose(file);
    const unsigned machine = header[18] | ((unsigned)header[19] << 8);
    return is_whole && memcmp(header, ELFMAG, SELFMAG) == 0 && machine == EM_AVR;
}

bool image_find(const struct image *image, const char *name, uint16_t *address) {
    for (uint32_t i = 0; i < image->elf.symbolcount; i++) {
        const avr_symbol_t *symbol = image->elf.symbol[i];
        if (strcmp(symbol->symbol, name) == 0) {
            *address = (uint16_t)(symbol->addr & 0xFFFF);
            return true;
        }
    }
    return false;
}

bool image_load(struct image *image, const char *path, struct machine *machine) {
    elf_firmware_t *elf = &image->elf;
    memset(image, 0, sizeof *image);
    if (!is_avr_image(path) || elf_read_firmware(path, elf) != 0 ||
        elf->flashsize == 0 ||
        elf->flashbase + elf->flashsize > machine->avr->flashend + 1) {
        return false;
    }
    machine_load(machine, elf->flash, elf->flashsize, (uint16_t)elf->flashbase);
    uint16_t end = (uint16_t)(MACHINE_SRAM_START + elf->datasize + elf->bsssize);
    (void)image_find(image, "_end", &end);
    machine->stack.heap_start = end;
    image->flash = elf->flashsize;
    image->ram = (uint32_t)end - MACHINE_SRAM_START;
    if (elf->eeprom != NULL && elf->eesize <= MACHINE_EEPROM_SIZE) {
        memcpy(machine->eeprom.bytes, elf->eeprom, elf->eesize);
    }
    return true;
}
