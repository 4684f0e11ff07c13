// SPDX-License-Identifier: MIT
// What a probe remembers without power. There are two slots, each with a CRC, written
// in turn, so that a power cut at any moment leaves one of them good.
#ifndef SETTINGS_H
#define SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/bus.h"
#include "core/fusion/calibrate.h"

enum { SETTINGS_VERSION = 1 };

struct settings {
    uint8_t probe_id[8];  // all zeros: none was made yet
    uint16_t boot_count;
    uint16_t pose_rate_hz;  // 1 to SETTINGS_RATE_MAX_HZ
    uint16_t raw_rate_hz;
    uint8_t streams;  // flags stream of the protocol
    struct calibration calibration;
};

enum {
    SETTINGS_RATE_MAX_HZ = 1000,  // no sensor of ours is faster
    SETTINGS_HEADER = 3,          // version, length, sequence
    SETTINGS_CRC = 2,             // little endian, over header and payload
    SETTINGS_SLOT = SETTINGS_HEADER + (int)sizeof(struct settings) + SETTINGS_CRC,
};

// A board's memory. The slots follow each other from offset 0.
struct settings_storage {
    uint8_t (*read)(void *port, uint16_t offset);
    // Starts to write one byte and returns. Called only when is_ready() is true.
    void (*write)(void *port, uint16_t offset, uint8_t value);
    // False while a byte is being written. read() is called only when it is true.
    bool (*is_ready)(void *port);
    void *port;
};

enum settings_result {
    SETTINGS_OK = 0,
    SETTINGS_BUSY = 1,     // a save is in progress; call settings_step() again
    SETTINGS_NONE = -1,    // no good slot: these are the defaults
    SETTINGS_FAILED = -2,  // the memory does not keep what is written
};

// The slot of the next save, and how far the save in progress is. It holds no copy: a
// save compares the slot with the settings and ends only when they are equal.
struct settings_writer {
    uint8_t slot;      // the one that may be overwritten
    uint8_t sequence;  // of the next save
    uint8_t phase;
    uint8_t offset;  // in the slot, of the byte written last
    uint8_t tries;   // writes of that byte
};

// The settings of a probe that has never saved any.
void settings_defaults(struct settings *out);

// True if every value is within its range.
bool settings_are_valid(const struct settings *settings);

// Reads the newer good slot, or returns the defaults and SETTINGS_NONE. Points `writer`
// at the other slot. It does not wait for the memory: call it at boot, before any save.
enum settings_result settings_load(const struct settings_storage *storage,
                                   struct settings *out,
                                   struct settings_writer *writer) MUST_CHECK;

// Requests a save. If one is in progress, that one also writes what has changed since.
void settings_save(struct settings_writer *writer);

// Starts to write at most one byte of `settings`. Returns SETTINGS_BUSY while a save is
// in progress, and SETTINGS_OK after it or if nothing is to be saved. The settings may
// change between two calls: a slot with a mixture never gets a good CRC.
enum settings_result settings_step(struct settings_writer *writer,
                                   const struct settings_storage *storage,
                                   const struct settings *settings) MUST_CHECK;

#endif
