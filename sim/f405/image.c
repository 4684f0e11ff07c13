// SPDX-License-Identifier: MIT
// Reads an ELF file into flash, and finds from its sections where variables end and
// where the stack may be.
#include <elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "f405.h"

enum { FILE_MAX = 64 << 20 };

struct file {
    uint8_t *bytes;
    size_t size;
};

static bool read_file(struct file *out, const char *path) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return false;
    }
    bool good = fseek(file, 0, SEEK_END) == 0;
    const long size = good ? ftell(file) : -1;
    good = size > 0 && size <= FILE_MAX && fseek(file, 0, SEEK_SET) == 0;
    out->size = good ? (size_t)size : 0;
    out->bytes = good ? malloc(out->size) : NULL;
    good = out->bytes != NULL && fread(out->bytes, 1, out->size, file) == out->size;
    (void)fclose(file);
    return good;
}

// Copies entry i of a table out of the file. False where the file is too short.
static bool get(const struct file *file, uint64_t table, unsigned i, void *out,
                size_t size) {
    const uint64_t at = table + (uint64_t)i * size;
    if (at + size > file->size) {
        return false;
    }
    memcpy(out, file->bytes + at, size);
    return true;
}

static bool is_ours(const struct file *file, Elf32_Ehdr *header) {
    return get(file, 0, 0, header, sizeof *header) &&
           memcmp(header->e_ident, ELFMAG, SELFMAG) == 0 &&
           header->e_ident[EI_CLASS] == ELFCLASS32 &&
           header->e_ident[EI_DATA] == ELFDATA2LSB && header->e_machine == EM_ARM &&
           header->e_phentsize == sizeof(Elf32_Phdr) &&
           (header->e_shnum == 0 || header->e_shentsize == sizeof(Elf32_Shdr));
}

// Erases the sectors that the image touches, as a programmer does.
static void erase_sectors(struct f405 *m, uint32_t from, uint32_t size) {
    for (uint32_t at = 0; at < F405_FLASH_SIZE;) {
        const uint32_t sector = at < 0x10000   ? 0x4000
                                : at < 0x20000 ? 0x10000
                                               : 0x20000;
        if (at < from + size && from < at + sector) {
            memset(m->flash + at, 0xFF, sector);
        }
        at += sector;
    }
}

static bool each_segment(struct f405 *m, const struct file *file,
                         const Elf32_Ehdr *header, bool writes, uint32_t *sum) {
    *sum = 0;
    for (unsigned i = 0; i < header->e_phnum; i++) {
        Elf32_Phdr segment;
        if (!get(file, header->e_phoff, i, &segment, sizeof segment)) {
            return false;
        }
        if (segment.p_type != PT_LOAD || segment.p_filesz == 0) {
            continue;
        }
        const uint32_t from = segment.p_paddr - F405_FLASH;
        if (from > F405_FLASH_SIZE || segment.p_filesz > F405_FLASH_SIZE - from ||
            (uint64_t)segment.p_offset + segment.p_filesz > file->size) {
            return false;
        }
        if (writes) {
            memcpy(m->flash + from, file->bytes + segment.p_offset, segment.p_filesz);
        } else {
            erase_sectors(m, from, segment.p_filesz);
        }
        *sum += segment.p_filesz;
    }
    return *sum > 0;
}

static bool is_ram(uint32_t address) {
    return address - F405_RAM < F405_RAM_SIZE || address - F405_CCM < F405_CCM_SIZE;
}

// Variables are all that the linker has put into RAM. The stack lies below the address
// in the first vector, down to the nearest variable.
static void find_stack(struct f405 *m, const struct file *file,
                       const Elf32_Ehdr *header, uint32_t *ram) {
    uint32_t top = 0;
    memcpy(&top, m->flash, sizeof top);
    const bool is_ccm = top - 1 - F405_CCM < F405_CCM_SIZE;
    m->stack.top = top;
    m->stack.lowest = is_ccm ? F405_CCM : F405_RAM;
    *ram = 0;
    for (unsigned i = 0; i < header->e_shnum; i++) {
        Elf32_Shdr section;
        if (!get(file, header->e_shoff, i, &section, sizeof section)) {
            return;
        }
        const uint32_t from = section.sh_addr;
        const uint32_t end = from + section.sh_size;
        if ((section.sh_flags & SHF_ALLOC) == 0 || section.sh_size == 0 ||
            !is_ram(from)) {
            continue;
        }
        if (from < top && end >= top) {
            m->stack.lowest = from;  // a section that reserves the stack
            continue;
        }
        *ram += section.sh_size;
        if (end <= top && end > m->stack.lowest) {
            m->stack.lowest = (end + 3) & ~UINT32_C(3);
        }
    }
    if (!is_ram(top - 1) || m->stack.lowest >= top) {
        m->stack.lowest = m->stack.top = F405_RAM;
    }
}

bool f405_load(struct f405 *m, const char *path, uint32_t *flash, uint32_t *ram) {
    struct file file = {0};
    Elf32_Ehdr header;
    uint32_t sum = 0;
    const bool good = read_file(&file, path) && is_ours(&file, &header) &&
                      each_segment(m, &file, &header, false, &sum) &&
                      each_segment(m, &file, &header, true, flash);
    if (good) {
        find_stack(m, &file, &header, ram);
    }
    free(file.bytes);
    return good;
}
