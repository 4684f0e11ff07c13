// SPDX-License-Identifier: MIT
// The modules that are inside the image; tools/micropython_build.py makes the table.
#ifndef PYBOARD_ROM_H
#define PYBOARD_ROM_H

#include <stdint.h>

// A file: its path, as in "probe/loop.mpy", and its bytes. The table ends with a NULL.
struct rom_file {
    const char *path;
    const uint8_t *bytes;
    uint32_t size;
};
extern const struct rom_file rom_files[];

#endif
