// SPDX-License-Identifier: MIT
// The symbols of code that an image has, from its ELF file.
#ifndef SIM_RUN_SYMBOLS_H
#define SIM_RUN_SYMBOLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SYMBOL_NAME_SIZE = 64 };  // longer names are cut

struct symbol {
    char name[SYMBOL_NAME_SIZE];
    uint32_t start, size;  // bytes
    bool is_function;
};

// Symbols of code in the order of their addresses, functions before labels; the
// caller's to free. Null where the image can't be read or has none.
struct symbol *symbols_read(const char *image, size_t *count);

#endif
