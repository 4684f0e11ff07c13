// SPDX-License-Identifier: MIT
// The params in memory; see store.h.
#include "core/params/store.h"

#include <string.h>

enum phase { IDLE, STAGING, CHECKING, BLANKING, COMMITTING };

static enum params_fault read_side(struct params_store *store, enum bank_side side,
                                   uint8_t length, struct params *out) {
    return params_read(store->bank.writer.memory, store->bank.content[side], length,
                       out, &store->tag);
}

bool params_store_open(struct params_store *store, const IN_FLASH struct memory *memory,
                       struct params *out) {
    memset(store, 0, sizeof *store);
    bool is_whole = bank_open(&store->bank, memory, MEMORY_PARAMS, MEMORY_PARAMS_BANK);
    if (!params_store_load(store, out)) {
        store->bank.list = (struct bank_list){0, 0};
        is_whole = false;
        (void)params_store_load(store, out);
    }
    return is_whole;
}

bool params_store_load(struct params_store *store, struct params *out) {
    return read_side(store, BANK_CURRENT, store->bank.list.length, out) == PARAMS_FINE;
}

enum result params_store_write(struct params_store *store, int32_t at, int32_t word) {
    // Negative numbers are too large here.
    if ((uint32_t)at > PARAMS_ROOM - PARAMS_WORD || at % PARAMS_WORD != 0) {
        return RESULT_BAD_ARGUMENT;
    }
    if (store->phase != IDLE) {
        return RESULT_BUSY;
    }
    const uint8_t result = store->result;
    store->result = RESULT_OK;
    if (result == RESULT_FAILED) {
        return RESULT_FAILED;
    }
    store->phase = STAGING;
    store->at = (uint8_t)at;
    memcpy(store->staged, &word, sizeof store->staged);
    return RESULT_OK;
}

enum result params_store_apply(struct params_store *store, int32_t value[2]) {
    const struct bank_list asked = {(uint32_t)value[1], (uint8_t)value[0]};
    if (((uint32_t)value[0] | PARAMS_GOES_ON) > (PARAMS_GOES_ON | PARAMS_ROOM)) {
        return RESULT_BAD_ARGUMENT;
    }
    if (store->phase != IDLE) {
        return RESULT_BUSY;
    }
    const uint8_t result = store->result;
    store->result = RESULT_OK;
    if (result != RESULT_OK && bank_list_equals(&asked, &store->asked)) {
        if (result == RESULT_REFUSED) {
            value[0] = store->tag;
            value[1] = store->fault;
        }
        return (enum result)result;
    }
    if (bank_list_equals(&asked, &store->bank.list)) {
        return RESULT_OK;
    }
    store->phase = CHECKING;
    store->at = 0;
    store->crc = 0;
    store->asked = asked;
    store->goes_on = value[0] >= PARAMS_GOES_ON;
    return RESULT_BUSY;
}

// Writes the next byte of what is staged.
static enum memory_result stage(struct params_store *store) {
    enum memory_result result = bank_blank(&store->bank);
    for (uint8_t i = 0; i < PARAMS_WORD && result == MEMORY_OK; ++i) {
        result = bank_put(&store->bank, (uint8_t)(store->at + i), store->staged[i]);
    }
    return result;
}

// Adds the part that is to be told to the digest; behind the last one, sees whether the
// records can be used.
static void check(struct params_store *store) {
    store->told = store->at;
    for (uint8_t i = 0; i < PARAMS_PART && store->at < store->asked.length; ++i) {
        crc32_add(&store->crc, bank_read(&store->bank, BANK_SPARE, store->at));
        ++store->at;
    }
    if (store->at < store->asked.length) {
        return;
    }
    struct params unused;
    store->phase = IDLE;
    if (store->crc != store->asked.digest) {
        store->result = RESULT_DAMAGED;
        return;
    }
    store->fault = (uint8_t)read_side(store, BANK_SPARE, store->asked.length, &unused);
    if (store->fault != PARAMS_FINE) {
        store->result = RESULT_REFUSED;
        return;
    }
    store->phase = BLANKING;
}

enum params_step params_store_step(struct params_store *store) {
    enum memory_result result;
    enum params_step done = PARAMS_WORKS;
    uint8_t next = IDLE;
    switch (store->phase) {
    case IDLE:
        return PARAMS_IDLE;
    case STAGING:
        result = stage(store);
        break;
    case CHECKING:
        check(store);
        return PARAMS_TELLS;
    case BLANKING:
        result = bank_blank(&store->bank);
        next = COMMITTING;
        break;
    default:
        result = bank_commit(&store->bank, &store->asked);
        done = PARAMS_CHANGED;
        break;
    }
    if (result == MEMORY_BUSY) {
        return PARAMS_WORKS;
    }
    store->phase = next;
    if (result == MEMORY_FAILED) {
        store->phase = IDLE;
        store->result = RESULT_FAILED;
        return PARAMS_WORKS;
    }
    return done;
}

void params_store_part(const struct params_store *store, enum bank_side side,
                       uint8_t length, uint8_t at, uint8_t out[PARAMS_PART]) {
    const uint8_t left = (uint8_t)(length - at);
    memset(out, 0, PARAMS_PART);
    memory_copy(store->bank.writer.memory, (uint16_t)(store->bank.content[side] + at),
                out, left < PARAMS_PART ? left : PARAMS_PART);
}
