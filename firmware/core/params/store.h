// SPDX-License-Identifier: MIT
// The params in memory, and their change as one transaction: records are staged in the
// spare bank, checked, and switched to at once, or not at all.
#ifndef PARAMS_STORE_H
#define PARAMS_STORE_H

#include "core/params/params.h"
#include "core/storage/bank.h"
#include "core/wire/messages.h"

enum {
    PARAMS_WORD = 4,                                 // bytes that are staged at a time
    PARAMS_PART = 28,                                // bytes that a message tells
    PARAMS_ROOM = MEMORY_PARAMS_BANK - BANK_HEADER,  // for all records
    PARAMS_GOES_ON = 256,  // added to their length: the filter may continue
};

struct params_store {
    struct bank bank;
    uint8_t phase;
    uint8_t result;      // enum result of the last change
    uint8_t tag, fault;  // of the record that was refused
    uint8_t at;          // of the next part to be checked, or of `staged`
    uint8_t told;        // of the part to be told
    bool goes_on;        // the filter, with the records that were asked for
    struct bank_list asked;
    union {
        uint32_t crc;                 // of what was checked
        uint8_t staged[PARAMS_WORD];  // on their way into memory
    };
};

enum params_step {
    PARAMS_IDLE,
    PARAMS_WORKS,
    PARAMS_TELLS,    // tell the part at `told` of the spare bank, then step on
    PARAMS_CHANGED,  // others are current now: load them
};

// Loads the params in force: those of the newer good bank, or none. Returns false where
// params were lost. `store->bank.list` has their length and digest. The memory must be
// ready.
bool params_store_open(struct params_store *store, const IN_FLASH struct memory *memory,
                       struct params *out);

// Takes four bytes of records for the spare bank, a multiple of four from the start.
// RESULT_BUSY: not yet; RESULT_FAILED: the memory does not store them.
enum result params_store_write(struct params_store *store, int32_t at, int32_t word);

// Asks for the staged records, with their length and digest in `value`, to be put in
// force; with PARAMS_GOES_ON added to the length the filter may continue. RESULT_BUSY
// until it is known: ask again. RESULT_OK where they are in force. RESULT_DAMAGED:
// their digest is another; RESULT_REFUSED: `value` has the tag of the record, and enum
// params_fault. Nothing has changed then.
enum result params_store_apply(struct params_store *store, int32_t value[2]);

// One part of what is to be done; the memory must be ready.
enum params_step params_store_step(struct params_store *store);

// Reads the params that are current. False where there is a record among them that
// cannot be used, which no change lets in: it was another firmware's.
bool params_store_load(struct params_store *store, struct params *out);

// Fills `out` with the bytes from `at` on of a bank with `length` bytes of records,
// zeros behind them.
void params_store_part(const struct params_store *store, enum bank_side side,
                       uint8_t length, uint8_t at, uint8_t out[PARAMS_PART]);

#endif
