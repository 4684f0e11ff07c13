// SPDX-License-Identifier: MIT
// Reads an image's symbols by libelf; see symbols.h.
#include "symbols.h"

#include <fcntl.h>
#include <gelf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// Functions first, so that a label inside one doesn't take its name.
static int by_address(const void *left, const void *right) {
    const struct symbol *a = left;
    const struct symbol *b = right;
    if (a->start != b->start) {
        return a->start < b->start ? -1 : 1;
    }
    if (a->is_function != b->is_function) {
        return a->is_function ? -1 : 1;
    }
    return strcmp(a->name, b->name);
}

// Not what the assembler makes: a $ marks code and data of an ARM, and a numbered label
// inside a function has a control character in its name (GNU as, "Local Labels").
static bool is_of_source(const char *name) {
    return name[0] != '\0' && name[0] != '$' && strpbrk(name, "\001\002") == NULL;
}

struct symbol *symbols_read(const char *image, size_t *count) {
    struct symbol *symbols = NULL;
    *count = 0;
    const int file = open(image, O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return NULL;
    }
    (void)elf_version(EV_CURRENT);
    Elf *elf = elf_begin(file, ELF_C_READ, NULL);
    for (Elf_Scn *section = elf_nextscn(elf, NULL); section != NULL;
         section = elf_nextscn(elf, section)) {
        GElf_Shdr header;
        Elf_Data *data = elf_getdata(section, NULL);
        if (gelf_getshdr(section, &header) == NULL || header.sh_type != SHT_SYMTAB ||
            header.sh_entsize == 0 || data == NULL) {
            continue;
        }
        const size_t all = header.sh_size / header.sh_entsize;
        symbols = calloc(all + 1, sizeof *symbols);
        for (size_t i = 0; symbols != NULL && i < all; i++) {
            GElf_Sym symbol;
            GElf_Shdr home;
            if (gelf_getsym(data, (int)i, &symbol) == NULL ||
                gelf_getshdr(elf_getscn(elf, symbol.st_shndx), &home) == NULL ||
                (home.sh_flags & SHF_EXECINSTR) == 0 ||
                GELF_ST_TYPE(symbol.st_info) == STT_SECTION ||
                GELF_ST_TYPE(symbol.st_info) == STT_FILE) {
                continue;
            }
            const char *name = elf_strptr(elf, header.sh_link, symbol.st_name);
            if (name == NULL || !is_of_source(name)) {
                continue;
            }
            struct symbol *kept = &symbols[(*count)++];
            (void)snprintf(kept->name, sizeof kept->name, "%.*s", SYMBOL_NAME_SIZE - 1,
                           name);
            // Bit 0 of a function's value says that it is Thumb code.
            kept->start = (uint32_t)symbol.st_value & ~UINT32_C(1);
            kept->size = (uint32_t)symbol.st_size;
            kept->is_function = GELF_ST_TYPE(symbol.st_info) == STT_FUNC;
        }
        break;
    }
    (void)elf_end(elf);
    (void)close(file);
    if (symbols != NULL) {
        qsort(symbols, *count, sizeof *symbols, by_address);
    }
    return symbols;
}
