// SPDX-License-Identifier: MIT
// Reads a bootloader's Intel HEX file into flash; see bootloader.h.
#include "bootloader.h"

#include <stdio.h>
#include <string.h>

enum {
    RECORD_MAX = 5 + 255,  // bytes: count, address, type, data, sum
    LINE_ROOM = 1 + 2 * RECORD_MAX + 3,
    TYPE_DATA = 0,
    TYPE_END = 1,
    TYPE_SEGMENT = 2,
    TYPE_START_SEGMENT = 3,
    TYPE_LINEAR = 4,
    TYPE_START_LINEAR = 5,
};

static int hex_digit(char digit) {
    const char *const digits = "0123456789abcdef";
    const char *at = digit == '\0' ? NULL : strchr(digits, digit | 0x20);
    return at == NULL ? -1 : (int)(at - digits);
}

// The bytes of a line, whose sum is 0. Their number, or 0 where it is no such line.
static unsigned read_record(const char *line, uint8_t bytes[RECORD_MAX]) {
    unsigned count = 0;
    uint8_t sum = 0;
    if (*line++ != ':') {
        return 0;
    }
    for (; count < RECORD_MAX && hex_digit(line[0]) >= 0; line += 2) {
        const int low = hex_digit(line[1]);
        if (low < 0) {
            return 0;
        }
        bytes[count] = (uint8_t)(hex_digit(line[0]) * 16 + low);
        sum = (uint8_t)(sum + bytes[count++]);
    }
    return count >= 5 && count == bytes[0] + 5U && sum == 0 ? count : 0;
}

static const char *read_file(struct machine *machine, FILE *file) {
    char line[LINE_ROOM];
    const struct machine_kind *kind = machine->kind;
    bool has_data = false;
    uint32_t base = 0;
    while (fgets(line, sizeof line, file) != NULL) {
        uint8_t bytes[RECORD_MAX] = {0};
        if (read_record(line, bytes) == 0) {
            break;
        }
        const uint32_t address = base + (((uint32_t)bytes[1] << 8) | bytes[2]);
        const uint32_t further = ((uint32_t)bytes[4] << 8) | bytes[5];
        switch (bytes[3]) {
        case TYPE_DATA:
            if (address < kind->boot_start || address + bytes[0] > kind->flash_size) {
                return "has bytes outside the bootloader's part of flash";
            }
            memcpy(machine->avr->flash + address, bytes + 4, bytes[0]);
            has_data = has_data || bytes[0] > 0;
            break;
        case TYPE_END:
            return has_data ? NULL : "has no bytes";
        case TYPE_SEGMENT:
            base = further << 4;
            break;
        case TYPE_LINEAR:
            base = further << 16;
            break;
        case TYPE_START_SEGMENT:
        case TYPE_START_LINEAR:
            break;  // where a debugger starts
        default:
            return "has records of no known type";
        }
    }
    return "is no Intel HEX file";
}

const char *bootloader_load(struct machine *machine, const char *path) {
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        return "can't be read";
    }
    const char *problem = read_file(machine, file);
    (void)fclose(file);
    if (problem == NULL) {
        machine->avr->codeend = machine->kind->flash_size - 1;
        machine_set_boot_start(machine, machine->kind->boot_start);
    }
    return problem;
}
