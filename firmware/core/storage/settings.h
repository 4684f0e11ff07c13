// SPDX-License-Identifier: MIT
// What a probe remembers without power: two slots with a CRC, written in turn, so that
// a cut at any moment leaves one good.
#ifndef SETTINGS_H
#define SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/bus.h"
#include "core/fusion/calibrate.h"

enum { SETTINGS_VERSION = 1 };

struct settings {
    uint8_t probe_id[8];  // all zeros: not made yet
    uint16_t boot_count;
    uint16_t pose_rate_hz;  // 1 to SETTINGS_RATE_MAX_HZ
    uint16_t raw_rate_hz;
    uint8_t streams;  // flags stream of the protocol
    struct calibration calibration;
};

enum {
    SETTINGS_RATE_MAX_HZ = 1000,  // of any sensor in the house
    SETTINGS_HEADER = 3,          // version, length, sequence
    SETTINGS_CRC = 2,             // little endian, over header and payload
    SETTINGS_SLOT = SETTINGS_HEADER + (int)sizeof(struct settings) + SETTINGS_CRC,
};

// A board's memory. Both slots start at 0 and follow each other.
struct settings_storage {
    uint8_t (*read)(void *port, uint16_t offset);
    // Starts to write one byte and returns; only called when is_ready.
    void (*write)(void *port, uint16_t offset, uint8_t value);
    // False while a write goes on. Reads are only made when it is true.
    bool (*is_ready)(void *port);
    void *port;
};

enum settings_result {
    SETTINGS_OK = 0,
    SETTINGS_BUSY = 1,     // a save goes on; call settings_step again
    SETTINGS_NONE = -1,    // no good slot: defaults were taken
    SETTINGS_FAILED = -2,  // the memory does not keep what is written
};

// Where the next save goes and how far it is. It holds no copy: a save compares the
// slot with the settings themselves and ends only once they are equal.
struct settings_writer {
    uint8_t slot;      // the one that may be overwritten
    uint8_t sequence;  // of the next save
    uint8_t phase;
    uint8_t offset;  // in the slot, of the byte written last
    uint8_t tries;   // writes of that byte
};

// What a probe starts with that remembers nothing.
void settings_defaults(struct settings *out);

// True where every value lies in its range.
bool settings_are_valid(const struct settings *settings);

// Reads the newer good slot, or gives the defaults and SETTINGS_NONE, and points
// `writer` at the other slot. Waits for nothing: for use at boot, before any save.
enum settings_result settings_load(const struct settings_storage *storage,
                                   struct settings *out,
                                   struct settings_writer *writer) MUST_CHECK;

// Asks for the settings to be saved. While a save goes on it does not start a second
// one: the one in progress takes up what has changed.
void settings_save(struct settings_writer *writer);

// Starts the write of at most one byte of `settings` and returns: BUSY while a save
// goes on, then OK; OK too where there is nothing to save. The settings may change
// between two calls (a mixture of old and changed never becomes good), not during one.
enum settings_result settings_step(struct settings_writer *writer,
                                   const struct settings_storage *storage,
                                   const struct settings *settings) MUST_CHECK;

#endif
