// SPDX-License-Identifier: MIT
// Settings as tagged records; see settings.h.
#include "core/storage/settings.h"

#include <stddef.h>
#include <string.h>

#include "core/fusion/calibrate.h"
#include "core/math/in_flash.h"
#include "core/wire/frame.h"
#include "core/wire/messages.h"

enum {
    ID_SIZE = 8,
    IDENTITY_SIZE = ID_SIZE + 2,  // and its CRC-16
    IDENTITY_END = 2 * IDENTITY_SIZE,
    CRC_SEED = 0xFFFF,

    RECORDS_AT = offsetof(struct settings, boots),
    RECORDS_SIZE = offsetof(struct settings, streams) + 1 - RECORDS_AT,
};

enum phase { IDLE, IDENTITY, COMPARING, BLANKING, FILLING, COMMITTING };

void settings_defaults(struct settings *out) {
    static const IN_FLASH struct settings defaults = {
        .boots = {1, sizeof out->boot_count},
        .rates = {2, sizeof out->pose_rate_hz + sizeof out->raw_rate_hz},
        .pose_rate_hz = 100,
        .raw_rate_hz = 200,
#ifndef POSE_WITHOUT_OWN_FIELD
        .own = {4, sizeof out->own_field + sizeof out->own_calibration},
#endif
        .stream = {3, sizeof out->streams},
        .streams = STREAM_POSE,
    };
    *out = defaults;
}

static bool rate_is_valid(uint16_t rate_hz) {
    return rate_hz >= 1 && rate_hz <= SETTINGS_RATE_MAX_HZ;
}

static bool are_valid(const struct settings *settings) {
    return rate_is_valid(settings->pose_rate_hz) &&
           rate_is_valid(settings->raw_rate_hz) &&
           settings->streams <= (STREAM_POSE | STREAM_RAW);
}

// Where our record with that tag has its length, then its values; NULL: it is none of
// ours.
static uint8_t *find(struct settings *settings, uint8_t tag) {
    uint8_t *const records = (uint8_t *)settings + RECORDS_AT;
    for (uint8_t at = 0; at < RECORDS_SIZE;) {
        if (records[at] == tag) {
            return &records[at + 1];
        }
        at = (uint8_t)(at + 2 + records[at + 1]);
    }
    return NULL;
}

// The first firmware's settings: two slots from 0 on, each a version, the length of the
// values, a sequence number, these values and a CRC-16. The version was blanked before
// anything else of a slot was written, and written back last, so that it says enough.
struct first_values {
    uint8_t probe_id[ID_SIZE];
    uint16_t boot_count, rates_hz[2];
    uint8_t streams;
    struct {
        int32_t bias[3];
        int16_t matrix[3][3];
    } calibration[3];  // which nothing set
};
enum {
    FIRST_VERSION = 1,
    FIRST_HEADER = 3,
    FIRST_SLOT = FIRST_HEADER + sizeof(struct first_values) + 2,
    FIRST_BOOTS = FIRST_HEADER + offsetof(struct first_values, boot_count),
    FIRST_RATES = FIRST_HEADER + offsetof(struct first_values, rates_hz),
    FIRST_STREAMS = FIRST_HEADER + offsetof(struct first_values, streams),
};
_Static_assert(2 * FIRST_SLOT <= (int)MEMORY_IDENTITY, "nothing lies over it");
_Static_assert(offsetof(struct settings, raw_rate_hz) ==
                   offsetof(struct settings, pose_rate_hz) + 2,
               "the rates lie as in a slot");

// Takes over the newer slot, which is one ahead of the other, modulo 256.
static bool read_first_form(const IN_FLASH struct memory *memory,
                            struct settings *out) {
    bool has_one = false;
    uint8_t sequence = 0;
    for (uint8_t slot = 0; slot <= FIRST_SLOT; slot = (uint8_t)(slot + FIRST_SLOT)) {
        uint8_t first[FIRST_STREAMS + 1];
        memory_copy(memory, slot, first, sizeof first);
        if (first[0] == FIRST_VERSION && first[1] == sizeof(struct first_values) &&
            (!has_one || (uint8_t)(first[2] - sequence) == 1)) {
            has_one = true;
            sequence = first[2];
            memcpy(out->probe_id, &first[FIRST_HEADER], ID_SIZE);
            memcpy(&out->boot_count, &first[FIRST_BOOTS], 2);
            memcpy(&out->pose_rate_hz, &first[FIRST_RATES], 4);
            out->streams = first[FIRST_STREAMS];
        }
    }
    return has_one;
}

static void read_identity(const IN_FLASH struct memory *memory, uint8_t *id) {
    uint16_t place = MEMORY_IDENTITY;
    for (; place < MEMORY_IDENTITY + IDENTITY_END; place += IDENTITY_SIZE) {
        uint8_t bytes[IDENTITY_SIZE];
        memory_copy(memory, place, bytes, sizeof bytes);
        // A CRC over what it has given itself, first byte first, is 0.
        if (frame_crc(CRC_SEED, bytes, sizeof bytes) == 0) {
            memcpy(id, bytes, ID_SIZE);
        }
    }
}

enum settings_result settings_load(const IN_FLASH struct memory *memory,
                                   struct settings *out,
                                   struct settings_writer *writer) {
    memset(writer, 0, sizeof *writer);
    (void)bank_open(&writer->bank, memory, MEMORY_SETTINGS, MEMORY_SETTINGS_BANK);
    settings_defaults(out);
    const uint16_t content = writer->bank.content[BANK_CURRENT];
    const uint8_t length = writer->bank.list.length;
    bool has_any = length > 0 || read_first_form(memory, out);
    for (uint8_t at = 0; at < length;) {
        uint8_t head[2];  // tag, length
        memory_copy(memory, (uint16_t)(content + at), head, sizeof head);
        uint8_t *ours = find(out, head[0]);
        if (ours != NULL && ours[0] == head[1]) {
            memory_copy(memory, (uint16_t)(content + at + 2), ours + 1, head[1]);
        }
        // A list that ends in a record ends the walk.
        at = head[1] < MEMORY_SETTINGS_BANK ? (uint8_t)(at + 2 + head[1]) : length;
    }
    if (!are_valid(out)) {
        settings_defaults(out);
        has_any = false;
    }
    read_identity(memory, out->probe_id);
    return has_any ? SETTINGS_OK : SETTINGS_NONE;
}

void settings_save(struct settings_writer *writer) {
    if (writer->phase == COMMITTING) {
        writer->is_asked_again = true;  // its content stands; another save follows
        return;
    }
    writer->phase = IDENTITY;
    writer->at = 0;
}

static enum memory_result write_identity(struct settings_writer *writer,
                                         const struct settings *settings) {
    uint8_t bytes[IDENTITY_SIZE];
    memcpy(bytes, settings->probe_id, ID_SIZE);
    const uint16_t crc = frame_crc(CRC_SEED, bytes, ID_SIZE);
    bytes[ID_SIZE] = (uint8_t)(crc >> 8);
    bytes[ID_SIZE + 1] = (uint8_t)crc;
    return memory_put(&writer->bank.writer, (uint16_t)(MEMORY_IDENTITY + writer->at),
                      bytes[writer->at % IDENTITY_SIZE]);
}

// Byte `at` of all that is to be saved: our records, then those of other firmware in
// the current bank, as far as there is room. `is_over` behind them.
__attribute__((noinline)) static uint8_t
wanted_byte(const struct settings_writer *writer, struct settings *settings, uint8_t at,
            bool *is_over) {
    if (at < RECORDS_SIZE) {
        return ((const uint8_t *)settings)[RECORDS_AT + at];
    }
    *is_over = at >= MEMORY_SETTINGS_BANK - BANK_HEADER;
    at = (uint8_t)(at - RECORDS_SIZE);
    const struct bank *bank = &writer->bank;
    for (uint8_t from = 0; from < bank->list.length;) {
        uint8_t head[2];  // tag, length
        memory_copy(bank->writer.memory, (uint16_t)(bank->content[BANK_CURRENT] + from),
                    head, sizeof head);
        if (head[1] >= MEMORY_SETTINGS_BANK) {
            break;
        }
        const uint8_t size = (uint8_t)(2 + head[1]);
        if (find(settings, head[0]) == NULL) {
            if (at < size) {
                return bank_read(bank, BANK_CURRENT, (uint8_t)(from + at));
            }
            at = (uint8_t)(at - size);
        }
        from = (uint8_t)(from + size);
    }
    *is_over = true;
    return 0;
}

// Measures what is to be saved. True where it is in memory already.
static bool is_saved(struct settings_writer *writer, struct settings *settings) {
    bool is_over = false;
    writer->list = (struct bank_list){0, 0};
    for (;;) {
        const uint8_t byte =
            wanted_byte(writer, settings, writer->list.length, &is_over);
        if (is_over) {
            return bank_list_equals(&writer->list, &writer->bank.list);
        }
        crc32_add(&writer->list.digest, byte);
        ++writer->list.length;
    }
}

enum memory_result settings_step(struct settings_writer *writer,
                                 struct settings *settings) {
    // What is in memory already takes no time.
    while (writer->phase != IDLE) {
        enum memory_result result = MEMORY_OK;
        uint8_t last = 0;  // value of `at` that ends the phase
        bool unused;
        switch (writer->phase) {
        case IDENTITY:
            result = write_identity(writer, settings);
            last = IDENTITY_END - 1;
            break;
        case COMPARING:
            if (is_saved(writer, settings)) {
                writer->phase = IDLE;
                return MEMORY_OK;
            }
            break;
        case BLANKING:
            result = bank_blank(&writer->bank);
            break;
        case FILLING:
            result = bank_put(&writer->bank, writer->at,
                              wanted_byte(writer, settings, writer->at, &unused));
            last = (uint8_t)(writer->list.length - 1);
            break;
        default:
            result = bank_commit(&writer->bank, &writer->list);
            break;
        }
        if (result != MEMORY_OK) {
            writer->phase = result == MEMORY_FAILED ? IDLE : writer->phase;
            return result;
        }
        if (writer->at != last) {
            ++writer->at;
            continue;
        }
        writer->at = 0;
        ++writer->phase;
        if (writer->phase > COMMITTING) {
            writer->phase = writer->is_asked_again ? IDENTITY : IDLE;
            writer->is_asked_again = false;
        }
    }
    return MEMORY_OK;
}
