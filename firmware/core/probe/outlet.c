// SPDX-License-Identifier: MIT
// Message to frame to one way out; see outlet.h.
#include "core/probe/outlet.h"

#include <string.h>

#include "core/drivers/ports_of.h"
#include "core/wire/frame.h"
#include "core/wire/messages.h"

// Of the buffer: behind the byte that framing adds.
enum { ID_AT = 1, SEQUENCE_AT = 1 + MESSAGE_SEQUENCE_AT };

void outlet_put(struct outlet *outlet, uint8_t *bytes, uint8_t length) {
    // Little endian, as messages.c asserts of all our processors.
    memcpy(bytes + SEQUENCE_AT, &outlet->sequence, sizeof outlet->sequence);
    ++outlet->sequence;
    const uint16_t seed =
        bytes[ID_AT] == MESSAGE_HELLO ? FRAME_HELLO_SEED : SCHEMA_SEED;
    if (!OUTLET_PUT(outlet)(bytes, frame_encode(seed, bytes, length))) {
        ++outlet->dropped;
    }
}
