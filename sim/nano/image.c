// SPDX-License-Identifier: MIT
// Reads an image by libsimavr, once it looks like one; see image.h.
#include "image.h"

#include <elf.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

enum {
    // The compiler's kind of AVR, in the flags (binutils, include/elf/avr.h).
    KIND = 0x7F,
    AVR5 = 5,  // return addresses of two bytes
    AVR6 = 6,  // of three
};

// Checks the ELF's header before libsimavr uses it.
const struct machine_kind *image_kind(const char *path) {
    uint8_t header[sizeof(Elf32_Ehdr)] = {0};
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return NULL;
    }
    const bool is_whole = fread(header, 1, sizeof header, file) == sizeof header;
    (void)fclose(file);
    const uint8_t *at = header + offsetof(Elf32_Ehdr, e_machine);
    const unsigned machine = at[0] | ((unsigned)at[1] << 8);
    if (!is_whole || memcmp(header, ELFMAG, SELFMAG) != 0 || machine != EM_AVR) {
        return NULL;
    }
    switch (header[offsetof(Elf32_Ehdr, e_flags)] & KIND) {
    case AVR5:
        return &machine_atmega328p;
    case AVR6:
        return &machine_atmega2560;
    default:
        return NULL;
    }
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
    if (image_kind(path) != machine->kind || elf_read_firmware(path, elf) != 0 ||
        elf->flashsize == 0 ||
        elf->flashbase + elf->flashsize > machine->avr->flashend + 1) {
        return false;
    }
    machine_load(machine, elf->flash, elf->flashsize, elf->flashbase);
    const struct machine_kind *kind = machine->kind;
    uint16_t end = (uint16_t)(kind->sram_start + elf->datasize + elf->bsssize);
    (void)image_find(image, "_end", &end);
    machine->stack.heap_start = end;
    image->flash = elf->flashsize;
    image->ram = (uint32_t)end - kind->sram_start;
    if (elf->eeprom != NULL && elf->eesize <= kind->eeprom_size) {
        memcpy(machine->eeprom.bytes, elf->eeprom, elf->eesize);
    }
    return true;
}
