// SPDX-License-Identifier: MIT
// Any bytes at all in a memory that was worn, or written by other firmware.
#include "any.h"
#include "core/params/params.h"

static uint8_t read_any(void *port, uint16_t offset) {
    (void)port;
    (void)offset;
    return any_u8();
}

static const struct memory memory = {.read = read_any};

void read(void) {
    struct params params;
    uint8_t tag = 0;
    if (params_read(&memory, any_u16(), any_u8(), &params, &tag) == PARAMS_FINE) {
        any_long = params.digest;
    }
}
