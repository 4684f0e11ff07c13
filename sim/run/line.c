// SPDX-License-Identifier: MIT
// See line.h. A ring that doubles when it is full.
#include "line.h"

#include <stdlib.h>

enum { FIRST_ROOM = 256 };

static bool make_room(struct line *line) {
    const size_t room = line->room == 0 ? FIRST_ROOM : 2 * line->room;
    uint8_t *bytes = malloc(room);
    uint64_t *from = malloc(room * sizeof *from);
    if (bytes == NULL || from == NULL) {
        free(bytes);
        free(from);
        return false;
    }
    for (size_t i = 0; i < line->count; i++) {
        const size_t at = (line->head + i) % line->room;
        bytes[i] = line->bytes[at];
        from[i] = line->from[at];
    }
    free(line->bytes);
    free(line->from);
    *line =
        (struct line){.bytes = bytes, .from = from, .count = line->count, .room = room};
    return true;
}

bool line_put(struct line *line, uint64_t from, uint8_t byte) {
    if (line->count == line->room && !make_room(line)) {
        return false;
    }
    const size_t at = (line->head + line->count) % line->room;
    line->bytes[at] = byte;
    line->from[at] = from;
    line->count++;
    return true;
}

uint64_t line_next(const struct line *line) {
    return line->from[line->head];
}

uint8_t line_take(struct line *line) {
    const uint8_t byte = line->bytes[line->head];
    line->head = (line->head + 1) % line->room;
    line->count--;
    return byte;
}

void line_free(struct line *line) {
    free(line->bytes);
    free(line->from);
    *line = (struct line){0};
}
