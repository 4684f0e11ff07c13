// SPDX-License-Identifier: MIT
// Settings, other than params, that a probe keeps without power: its id, and how it
// streams. The id is apart from the rest, written once and in two copies; the rest are
// tagged records in a pair of banks, of which those of another firmware are kept.
#ifndef SETTINGS_H
#define SETTINGS_H

#include "core/fusion/fuse.h"
#include "core/storage/bank.h"

// Behind the id the records as they lie in memory: each a tag, a length, its values.
struct settings {
    uint8_t probe_id[8];  // all zeros: none was made yet
    uint8_t boots[2];
    uint16_t boot_count;
    uint8_t rates[2];
    uint16_t pose_rate_hz;  // 1 to SETTINGS_RATE_MAX_HZ
    uint16_t raw_rate_hz;
#ifndef POSE_WITHOUT_OWN_FIELD
    uint8_t own[2];
    struct own_field own_field;  // which the filter found
    uint16_t own_calibration;    // lower half of the digest of the one it goes with
#endif
    uint8_t stream[2];
    uint8_t streams;  // flags stream of the protocol
};

enum { SETTINGS_RATE_MAX_HZ = 1000 };  // no sensor of ours is faster

enum settings_result {
    SETTINGS_OK = 0,
    SETTINGS_NONE = -1,  // none are in memory, or none that can be used
};

// How far the save in progress is. It holds no copy of what it writes.
struct settings_writer {
    struct bank bank;
    uint8_t phase;
    bool is_asked_again;    // while a save is being completed
    uint8_t at;             // in the identity, then in the content
    struct bank_list list;  // the content that is saved
};

// The settings of a probe that has never saved any.
void settings_defaults(struct settings *out);

// Reads the settings, those of the first firmware where there are no others, or returns
// the defaults and SETTINGS_NONE; the id by itself, wherever it is. It does not wait
// for the memory: call it at boot, before any save.
enum settings_result settings_load(const IN_FLASH struct memory *memory,
                                   struct settings *out,
                                   struct settings_writer *writer) MUST_CHECK;

// Requests a save, which writes only what differs. Ask again after each change while
// one is in progress.
void settings_save(struct settings_writer *writer);

// Starts to write at most one byte, for which the memory must be ready. Returns
// MEMORY_BUSY while a save is in progress, MEMORY_OK after it or where nothing is to be
// saved, and MEMORY_FAILED once if the memory does not store a byte; the save is then
// over.
enum memory_result settings_step(struct settings_writer *writer,
                                 struct settings *settings) MUST_CHECK;

#endif
