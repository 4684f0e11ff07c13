// SPDX-License-Identifier: MIT
// The bytes on their way to a board's UART, in order, each with the time before which
// it does not start. Times are the machine's own.
#ifndef SIM_RUN_LINE_H
#define SIM_RUN_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Zero is an empty line.
struct line {
    uint8_t *bytes;
    uint64_t *from;
    size_t head, count, room;
};

// False where memory is out.
bool line_put(struct line *line, uint64_t from, uint8_t byte);
// For a line that is not empty: the time at which its first byte may start; removes
// that byte.
uint64_t line_next(const struct line *line);
uint8_t line_take(struct line *line);
// Leaves it empty.
void line_free(struct line *line);

#endif
