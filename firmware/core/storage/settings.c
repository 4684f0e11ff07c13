// SPDX-License-Identifier: MIT
// Settings as tagged records; see settings.h.
#include "core/storage/settings.h"

#include <stddef.h>
#include <string.h>

#include "core/fusion/calibrate.h"
#include "core/wire/frame.h"
#include "core/wire/messages.h"

enum {
    ID_SIZE = 8,
    IDENTITY_SIZE = ID_SIZE + 2,  // and its CRC-16
    IDENTITY_COPIES = 2,
    CRC_SEED = 0xFFFF,

    POSE_RATE_HZ = 100,
    RAW_RATE_HZ = 200,
};

enum phase { IDLE, IDENTITY, COMPARING, BLANKING, FILLING, COMMITTING };

// The records, in the order in which they are written: tag, length, then as they lie in
// struct settings from the boot count on.
enum { TAG_BOOTS = 1, TAG_RATES = 2, TAG_STREAMS = 3, TAGS = 3 };
enum {
    BOOTS_AT = offsetof(struct settings, boot_count),
    RATES_AT = offsetof(struct settings, pose_rate_hz),
    STREAMS_AT = offsetof(struct settings, streams),
    // With the tag and the length of each.
    CONTENT_SIZE = 2 * TAGS + STREAMS_AT + 1 - BOOTS_AT,
};

// Where a record lies in struct settings, and its bytes.
static uint8_t place_of(uint8_t tag) {
    return tag == TAG_BOOTS ? BOOTS_AT : tag == TAG_RATES ? RATES_AT : STREAMS_AT;
}

static uint8_t size_of(uint8_t tag) {
    return tag == TAG_BOOTS ? 2 : tag == TAG_RATES ? 4 : 1;
}

void settings_defaults(struct settings *out) {
    memset(out, 0, sizeof *out);
    out->pose_rate_hz = POSE_RATE_HZ;
    out->raw_rate_hz = RAW_RATE_HZ;
    out->streams = STREAM_POSE;
}

static bool rate_is_valid(uint16_t rate_hz) {
    return rate_hz >= 1 && rate_hz <= SETTINGS_RATE_MAX_HZ;
}

static bool are_valid(const struct settings *settings) {
    return rate_is_valid(settings->pose_rate_hz) &&
           rate_is_valid(settings->raw_rate_hz) &&
           settings->streams <= (STREAM_POSE | STREAM_RAW);
}

static void read_bytes(const struct memory *memory, uint16_t offset, void *out,
                       uint8_t length) {
    for (uint8_t i = 0; i < length; ++i) {
        ((uint8_t *)out)[i] = memory_read(memory, (uint16_t)(offset + i));
    }
}

// The first firmware's settings: two slots from 0 on, each a version, the length, a
// sequence number, the settings with a calibration that nothing set, a CRC-16.
struct first_form {
    struct settings settings;
    struct calibration calibration;
};
enum {
    FIRST_VERSION = 1,
    FIRST_HEADER = 3,
    FIRST_SIZE = sizeof(struct first_form),
    FIRST_SLOT = FIRST_HEADER + FIRST_SIZE + 2,
};
_Static_assert(2 * FIRST_SLOT <= (int)MEMORY_IDENTITY, "nothing lies over it");

static bool read_first_slot(const struct memory *memory, uint16_t base,
                            struct settings *out) {
    uint8_t header[FIRST_HEADER];
    read_bytes(memory, base, header, sizeof header);
    uint16_t crc = frame_crc(CRC_SEED, header, sizeof header);
    for (uint8_t at = FIRST_HEADER; at < FIRST_SLOT; ++at) {
        const uint8_t byte = memory_read(memory, (uint16_t)(base + at));
        // The CRC was written with its low byte first.
        if (at < FIRST_SLOT - 2) {
            crc = frame_crc(crc, &byte, 1);
        } else if (byte != (uint8_t)(at == FIRST_SLOT - 2 ? crc : crc >> 8)) {
            return false;
        }
    }
    read_bytes(memory, base + FIRST_HEADER, out, sizeof *out);
    return header[0] == FIRST_VERSION && header[1] == FIRST_SIZE && are_valid(out);
}

static bool read_first_form(const struct memory *memory, struct settings *out) {
    // The newer is one ahead of the other, modulo 256.
    const uint8_t ahead = (uint8_t)(memory_read(memory, FIRST_SLOT + FIRST_HEADER - 1) -
                                    memory_read(memory, FIRST_HEADER - 1));
    const uint16_t newer = ahead == 1 ? FIRST_SLOT : 0;
    return read_first_slot(memory, newer, out) ||
           read_first_slot(memory, FIRST_SLOT - newer, out);
}

static bool read_identity(const struct memory *memory, uint8_t *id) {
    for (uint8_t copy = 0; copy < IDENTITY_COPIES; ++copy) {
        uint8_t bytes[IDENTITY_SIZE];
        read_bytes(memory, (uint16_t)(MEMORY_IDENTITY + copy * IDENTITY_SIZE), bytes,
                   sizeof bytes);
        // A CRC over what it has given itself, first byte first, is 0.
        if (frame_crc(CRC_SEED, bytes, sizeof bytes) == 0) {
            memcpy(id, bytes, ID_SIZE);
            return true;
        }
    }
    return false;
}

enum settings_result settings_load(const struct memory *memory, struct settings *out,
                                   struct settings_writer *writer) {
    memset(writer, 0, sizeof *writer);
    (void)bank_open(&writer->bank, memory, MEMORY_SETTINGS, MEMORY_SETTINGS_BANK);
    const struct bank *bank = &writer->bank;
    settings_defaults(out);
    bool has_any = bank->length > 0;
    if (!has_any) {
        has_any = read_first_form(memory, out);
    }
    for (uint16_t at = 0; at + 2 <= bank->length;) {
        const uint8_t tag = bank_read(bank, BANK_CURRENT, at);
        const uint8_t length = bank_read(bank, BANK_CURRENT, (uint16_t)(at + 1));
        at = (uint16_t)(at + 2);
        if (tag >= 1 && tag <= TAGS && length == size_of(tag)) {
            for (uint8_t i = 0; i < length; ++i) {
                ((uint8_t *)out)[place_of(tag) + i] =
                    bank_read(bank, BANK_CURRENT, (uint16_t)(at + i));
            }
        }
        at = (uint16_t)(at + length);
    }
    if (!has_any || !are_valid(out)) {
        const uint16_t boots = out->boot_count;
        settings_defaults(out);
        out->boot_count = has_any ? boots : 0;
        has_any = false;
    }
    (void)read_identity(memory, out->probe_id);
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

// A byte of the records that are ours.
static uint8_t own_byte(const struct settings *settings, uint8_t at) {
    for (uint8_t tag = 1;; ++tag) {
        const uint8_t size = size_of(tag);
        if (at < 2) {
            return at == 0 ? tag : size;
        }
        if (at < 2 + size || tag == TAGS) {
            return ((const uint8_t *)settings)[place_of(tag) + at - 2];
        }
        at = (uint8_t)(at - 2 - size);
    }
}

// Byte `at` of the current bank's records of other firmware; `is_over` behind them and
// where there is no room for more.
static uint8_t foreign_byte(const struct bank *bank, uint8_t at, bool *is_over) {
    const uint8_t room = MEMORY_SETTINGS_BANK - BANK_HEADER - CONTENT_SIZE;
    for (uint16_t from = 0; from + 2 <= bank->length;) {
        const uint8_t tag = bank_read(bank, BANK_CURRENT, from);
        const uint8_t size =
            (uint8_t)(2 + bank_read(bank, BANK_CURRENT, (uint16_t)(from + 1)));
        if (at < room && (tag < 1 || tag > TAGS)) {
            if (at < size) {
                return bank_read(bank, BANK_CURRENT, (uint16_t)(from + at));
            }
            at = (uint8_t)(at - size);
        }
        from = (uint16_t)(from + size);
    }
    *is_over = true;
    return 0;
}

// Byte `at` of all that is to be saved; `is_over` behind it.
static uint8_t wanted_byte(const struct settings_writer *writer,
                           const struct settings *settings, uint8_t at, bool *is_over) {
    return at < CONTENT_SIZE
               ? own_byte(settings, at)
               : foreign_byte(&writer->bank, (uint8_t)(at - CONTENT_SIZE), is_over);
}

// Measures what is to be saved. True where it is in memory already.
static bool is_saved(struct settings_writer *writer, const struct settings *settings) {
    bool is_over = false;
    writer->crc = 0;
    for (writer->length = 0;; ++writer->length) {
        const uint8_t byte = wanted_byte(writer, settings, writer->length, &is_over);
        if (is_over) {
            break;
        }
        writer->crc = crc32_add(writer->crc, byte);
    }
    return writer->length == writer->bank.length && writer->crc == writer->bank.digest;
}

// One byte, or one phase, of a save.
static enum memory_result advance(struct settings_writer *writer,
                                  const struct settings *settings) {
    bool is_over = true;
    enum memory_result result = MEMORY_OK;
    switch (writer->phase) {
    case IDENTITY:
        result = write_identity(writer, settings);
        is_over = writer->at == IDENTITY_COPIES * IDENTITY_SIZE - 1;
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
                          wanted_byte(writer, settings, writer->at, &is_over));
        is_over = writer->at == writer->length - 1;
        break;
    default:
        result = bank_commit(&writer->bank, writer->length, writer->crc);
        break;
    }
    if (result != MEMORY_OK) {
        return result;
    }
    if (!is_over) {
        ++writer->at;
        return result;
    }
    writer->at = 0;
    ++writer->phase;
    if (writer->phase > COMMITTING) {
        writer->phase = writer->is_asked_again ? IDENTITY : IDLE;
        writer->is_asked_again = false;
    }
    return result;
}

enum memory_result settings_step(struct settings_writer *writer,
                                 const struct settings *settings) {
    // What is in memory already takes no time.
    while (writer->phase != IDLE) {
        const enum memory_result result = advance(writer, settings);
        if (result == MEMORY_FAILED) {
            writer->phase = IDLE;
        }
        if (result != MEMORY_OK) {
            return result;
        }
    }
    return MEMORY_OK;
}
