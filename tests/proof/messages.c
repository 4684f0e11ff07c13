// SPDX-License-Identifier: MIT
// Any content at all: what each message's parser does with it.
#include "any.h"
#include "core/wire/messages.h"

static uint8_t content[255];

#define PARSER(name)                                                         \
    void name(void) {                                                        \
        struct message_header header;                                        \
        struct message_##name out;                                           \
        any_fill(content, sizeof content);                                   \
        const uint8_t length = any_u8();                                     \
        if (message_##name##_decode(content, length, &header, &out) == 0) {  \
            any_long = header.time_us;                                       \
        }                                                                    \
        (void)message_##name##_take(content, length, &out);                  \
    }

PARSER(hello)
PARSER(raw)
PARSER(pose)
PARSER(event)
PARSER(status)
PARSER(equipment)
PARSER(params)
PARSER(stroke)
PARSER(self_test)
PARSER(command)
PARSER(reply)
