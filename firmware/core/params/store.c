// SPDX-License-Identifier: MIT
// The params in memory; see store.h.
#include "core/params/store.h"

#include <string.h>

enum phase { IDLE, CHECKING, BLANKING, COMMITTING };

// A side of the store's banks as a source of records.
struct side {
    const struct bank *bank;
    enum bank_side side;
};

static uint8_t read_side(const void *context, uint16_t at) {
    const struct side *side = context;
    return bank_read(side->bank, side->side, at);
}

static enum params_fault read_params(const struct params_store *store,
                                     enum bank_side side, uint16_t length,
                                     struct params *out, uint8_t *tag) {
    const struct side context = {&store->bank, side};
    const struct params_source source = {read_side, &context, length};
    return params_read(&source, out, tag);
}

bool params_store_open(struct params_store *store, const struct memory *memory,
                       struct params *out) {
    uint8_t tag;
    memset(store, 0, sizeof *store);
    bool is_whole = bank_open(&store->bank, memory, MEMORY_PARAMS, MEMORY_PARAMS_BANK);
    if (read_params(store, BANK_CURRENT, store->bank.length, out, &tag) !=
        PARAMS_FINE) {
        params_clear(out);
        store->bank.length = 0;
        store->bank.digest = 0;
        is_whole = false;
    }
    return is_whole;
}

enum result params_store_write(struct params_store *store, int32_t at, int32_t word) {
    if (at < 0 || at > PARAMS_ROOM - PARAMS_WORD || at % PARAMS_WORD != 0) {
        return RESULT_BAD_ARGUMENT;
    }
    if (store->is_staging || store->phase != IDLE) {
        return RESULT_BUSY;
    }
    if (store->result == RESULT_FAILED) {
        store->result = RESULT_OK;
        return RESULT_FAILED;
    }
    store->is_staging = true;
    store->result = RESULT_OK;
    store->at = (uint16_t)at;
    memcpy(store->staged, &word, sizeof store->staged);
    return RESULT_OK;
}

enum result params_store_apply(struct params_store *store, int32_t length,
                               int32_t digest, int32_t refusal[2]) {
    if (length < 0 || length > PARAMS_ROOM) {
        return RESULT_BAD_ARGUMENT;
    }
    if (store->is_staging || store->phase != IDLE) {
        return RESULT_BUSY;
    }
    const bool is_same = length == store->length && (uint32_t)digest == store->digest;
    if (is_same && store->result != RESULT_OK) {
        const enum result result = (enum result)store->result;
        if (result == RESULT_REFUSED) {
            refusal[0] = store->tag;
            refusal[1] = store->fault;
        }
        store->result = RESULT_OK;
        return result;
    }
    if (length == store->bank.length && (uint32_t)digest == store->bank.digest) {
        return RESULT_OK;
    }
    store->phase = CHECKING;
    store->at = 0;
    store->crc = 0;
    store->length = (uint16_t)length;
    store->digest = (uint32_t)digest;
    return RESULT_BUSY;
}

static void end(struct params_store *store, enum result result) {
    store->phase = IDLE;
    store->is_staging = false;
    store->result = (uint8_t)result;
}

// Writes the next byte of what is staged.
static void stage(struct params_store *store) {
    enum memory_result result = bank_blank(&store->bank);
    for (uint8_t i = 0; i < PARAMS_WORD && result == MEMORY_OK; ++i) {
        result = bank_put(&store->bank, (uint16_t)(store->at + i), store->staged[i]);
    }
    if (result != MEMORY_BUSY) {
        end(store, result == MEMORY_OK ? RESULT_OK : RESULT_FAILED);
    }
}

// Adds the part that is to be told to the digest; behind the last one, sees whether the
// records can be used.
static void check(struct params_store *store) {
    store->told = store->at;
    for (uint8_t i = 0; i < PARAMS_PART && store->at < store->length; ++i) {
        store->crc =
            crc32_add(store->crc, bank_read(&store->bank, BANK_SPARE, store->at));
        ++store->at;
    }
    if (store->at < store->length) {
        return;
    }
    struct params unused;
    if (store->crc != store->digest) {
        end(store, RESULT_DAMAGED);
        return;
    }
    store->fault =
        (uint8_t)read_params(store, BANK_SPARE, store->length, &unused, &store->tag);
    if (store->fault != PARAMS_FINE) {
        end(store, RESULT_REFUSED);
        return;
    }
    store->phase = BLANKING;
}

enum params_step params_store_step(struct params_store *store, struct params *params) {
    if (store->is_staging) {
        stage(store);
        return PARAMS_WORKS;
    }
    enum memory_result result = MEMORY_OK;
    switch (store->phase) {
    case CHECKING:
        check(store);
        return PARAMS_TELLS;
    case BLANKING:
        result = bank_blank(&store->bank);
        if (result == MEMORY_OK) {
            store->phase = COMMITTING;
            result = MEMORY_BUSY;
        }
        break;
    case COMMITTING:
        result = bank_commit(&store->bank, store->length, store->digest);
        break;
    default:
        return PARAMS_IDLE;
    }
    if (result == MEMORY_BUSY) {
        return PARAMS_WORKS;
    }
    end(store, result == MEMORY_OK ? RESULT_OK : RESULT_FAILED);
    // What was checked can be read again.
    return result == MEMORY_OK && read_params(store, BANK_CURRENT, store->bank.length,
                                              params, &store->tag) == PARAMS_FINE
               ? PARAMS_CHANGED
               : PARAMS_WORKS;
}

void params_store_part(const struct params_store *store, enum bank_side side,
                       uint16_t length, uint16_t at, uint8_t out[PARAMS_PART]) {
    for (uint8_t i = 0; i < PARAMS_PART; ++i) {
        out[i] = at < length ? bank_read(&store->bank, side, at) : 0;
        ++at;
    }
}
