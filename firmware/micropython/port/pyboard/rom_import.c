// SPDX-License-Identifier: MIT
// Where `import` finds its files: in the image; see rom.h.
#include "rom.h"

#include <string.h>

#include "py/builtin.h"
#include "py/lexer.h"
#include "py/mperrno.h"
#include "py/reader.h"
#include "py/runtime.h"

static const struct rom_file *find(const char *path) {
    for (const struct rom_file *file = rom_files; file->path != NULL; file++) {
        if (strcmp(file->path, path) == 0) {
            return file;
        }
    }
    return NULL;
}

static bool is_folder(const char *path) {
    const size_t length = strlen(path);
    for (const struct rom_file *file = rom_files; file->path != NULL; file++) {
        if (strncmp(file->path, path, length) == 0 && file->path[length] == '/') {
            return true;
        }
    }
    return false;
}

mp_import_stat_t mp_import_stat(const char *path) {
    if (find(path) != NULL) {
        return MP_IMPORT_STAT_FILE;
    }
    return is_folder(path) ? MP_IMPORT_STAT_DIR : MP_IMPORT_STAT_NO_EXIST;
}

void mp_reader_new_file(mp_reader_t *reader, qstr path) {
    const struct rom_file *file = find(qstr_str(path));
    if (file == NULL) {
        mp_raise_OSError(MP_ENOENT);
    }
    mp_reader_new_mem(reader, file->bytes, file->size, MP_READER_IS_ROM);
}
