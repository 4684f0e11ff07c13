// SPDX-License-Identifier: MIT
// The host's end of the probe's USB cable: a pseudo terminal with a symbolic link to
// it.
#ifndef SIM_RUN_CABLE_H
#define SIM_RUN_CABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// As much as a host's serial driver buffers for a slow reader.
enum { CABLE_HELD = 65536 };

struct cable {
    int master;
    int keeper;  // keeps the line's settings while nobody has it open; -1: none
    int watch;   // says who opens and closes it; -1: can't be known
    int listeners;
    bool was_opened;  // by the first listener, since cable_was_opened()
    char link[4096];
    char name[128];
    uint8_t held[CABLE_HELD];
    size_t held_head, held_count;
    uint64_t dropped;  // bytes that a listener was too slow for
    uint64_t unheard;  // bytes sent while nobody listened, as on a real wire
};

// Null, or what is wrong.
const char *cable_open(struct cable *cable, const char *link);
void cable_close(struct cable *cable);
// Whether a program has opened it since the last call.
bool cable_was_opened(struct cable *cable);
// Sends a byte. Where the reader is slow it waits if told so (false: a signal came),
// else it drops and counts the byte.
bool cable_put(struct cable *cable, uint8_t byte, bool waits);
// Passes on buffered bytes, as many as the reader takes.
void cable_flush(struct cable *cable);
// Reads bytes from the host. Returns how many, 0 for none.
size_t cable_get(struct cable *cable, uint8_t *bytes, size_t room);

#endif
