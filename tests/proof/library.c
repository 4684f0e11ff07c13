// SPDX-License-Identifier: MIT
// Any bytes at all, in any state of libimuprobe's reader.
#include "any.h"

#include <stdbool.h>
#include <string.h>

#include "core/wire/frame.h"
#include "core/wire/messages.h"
#include "protocol/library/reader.h"
#include "protocol/library/reader.c"

// What frame.c has decoded: frame.c's own proof says how long it is.
void content(void) {
    struct imuprobe_reader reader;
    struct imuprobe_message message;
    imuprobe_begin(&reader);
    any_fill(reader.bytes, sizeof reader.bytes);
    reader.next = any_u32();
    reader.suspect = any_u32();
    reader.lost = any_u32();
    reader.boot = any_u16();
    reader.has_hello = any_u8() & 1;
    if (take(&reader, any_up_to(FRAME_CONTENT_MAX), &message) == IMUPROBE_MESSAGE) {
        any_long = message.header.time_us;
    }
}

void command(void) {
    struct imuprobe_reader reader;
    uint8_t bytes[IMUPROBE_COMMAND_MAX];
    imuprobe_begin(&reader);
    reader.commands = any_u32();
    any_use(bytes, imuprobe_command(&reader, any_u8(), (int32_t)any_u32(),
                                    (int32_t)any_u32(), bytes));
}
