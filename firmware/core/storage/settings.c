// SPDX-License-Identifier: MIT
// Settings in two slots. A slot is: version, length, sequence, payload, CRC.
//
// The version is blanked before anything else of a slot is touched and written back
// last, so that between the two no mixture of old and changed bytes can be taken for
// good, whatever its CRC. The slot with the older sequence is the one written.
#include "core/storage/settings.h"

#include <string.h>

#include "core/wire/frame.h"
#include "core/wire/messages.h"

enum {
    AT_VERSION = 0,
    AT_LENGTH = 1,
    AT_SEQUENCE = 2,
    AT_PAYLOAD = SETTINGS_HEADER,
    AT_CRC = SETTINGS_SLOT - SETTINGS_CRC,

    BLANK = 0,  // a version that never is; an erased byte, 0xFF, is none either
    CRC_SEED = 0xFFFF,
    TRIES_MAX = 3,  // writes of one byte; EEPROM cells fail for good, not now and then

    POSE_RATE_HZ = 100,
    RAW_RATE_HZ = 200,
};

enum phase {
    IDLE,
    BLANKING,   // the version is to be blanked
    FILLING,    // all else is to be written
    COMMITTING  // the version is on its way
};

_Static_assert(SETTINGS_SLOT <= UINT8_MAX, "offsets in a slot are uint8_t");

static uint8_t read_byte(const struct settings_storage *storage, uint8_t slot,
                         uint8_t offset) {
    const uint16_t base = slot != 0 ? SETTINGS_SLOT : 0;
    return storage->read(storage->port, (uint16_t)(base + offset));
}

// CRC of a slot as it lies in memory, its version taken to be the good one.
static uint16_t crc_of(const struct settings_storage *storage, uint8_t slot) {
    uint8_t byte = SETTINGS_VERSION;
    uint16_t crc = frame_crc(CRC_SEED, &byte, 1);
    for (uint8_t offset = AT_LENGTH; offset < AT_CRC; ++offset) {
        byte = read_byte(storage, slot, offset);
        crc = frame_crc(crc, &byte, 1);
    }
    return crc;
}

static bool slot_is_good(const struct settings_storage *storage, uint8_t slot) {
    if (read_byte(storage, slot, AT_VERSION) != SETTINGS_VERSION ||
        read_byte(storage, slot, AT_LENGTH) != sizeof(struct settings)) {
        return false;
    }
    const uint16_t crc = crc_of(storage, slot);
    return read_byte(storage, slot, AT_CRC) == crc % 256 &&
           read_byte(storage, slot, AT_CRC + 1) == crc / 256;
}

void settings_defaults(struct settings *out) {
    memset(out, 0, sizeof *out);
    out->pose_rate_hz = POSE_RATE_HZ;
    out->raw_rate_hz = RAW_RATE_HZ;
    out->streams = STREAM_POSE;
    calibration_clear(&out->calibration);
}

static bool rate_is_valid(uint16_t rate_hz) {
    return rate_hz >= 1 && rate_hz <= SETTINGS_RATE_MAX_HZ;
}

bool settings_are_valid(const struct settings *settings) {
    return rate_is_valid(settings->pose_rate_hz) &&
           rate_is_valid(settings->raw_rate_hz) &&
           settings->streams <= (STREAM_POSE | STREAM_RAW) &&
           calibration_is_valid(&settings->calibration);
}

enum settings_result settings_load(const struct settings_storage *storage,
                                   struct settings *out,
                                   struct settings_writer *writer) {
    const uint8_t sequences[2] = {read_byte(storage, 0, AT_SEQUENCE),
                                  read_byte(storage, 1, AT_SEQUENCE)};
    // Saves go to the slots in turn, so that the newer is one ahead, modulo 256.
    uint8_t slot = (uint8_t)(sequences[1] - sequences[0]) == 1 ? 1 : 0;
    for (uint8_t tries = 0; tries < 2; ++tries) {
        if (slot_is_good(storage, slot)) {
            uint8_t *bytes = (uint8_t *)out;
            for (uint8_t i = 0; i < sizeof *out; ++i) {
                bytes[i] = read_byte(storage, slot, (uint8_t)(AT_PAYLOAD + i));
            }
            if (settings_are_valid(out)) {
                *writer = (struct settings_writer){
                    .slot = slot ^ 1, .sequence = (uint8_t)(sequences[slot] + 1)};
                return SETTINGS_OK;
            }
        }
        slot ^= 1;
    }
    settings_defaults(out);
    *writer = (struct settings_writer){0};
    return SETTINGS_NONE;
}

void settings_save(struct settings_writer *writer) {
    if (writer->phase == IDLE) {
        writer->phase = BLANKING;
    }
    writer->tries = 0;
}

// Starts to write a byte that memory does not hold yet; gives up on one that never
// takes it. A byte that is written again counts its tries, any other starts over.
static enum settings_result write_byte(struct settings_writer *writer,
                                       const struct settings_storage *storage,
                                       uint8_t offset, uint8_t value) {
    if (offset != writer->offset) {
        writer->offset = offset;
        writer->tries = 0;
    }
    if (writer->tries == TRIES_MAX) {
        writer->phase = IDLE;
        return SETTINGS_FAILED;
    }
    ++writer->tries;
    const uint16_t base = writer->slot != 0 ? SETTINGS_SLOT : 0;
    storage->write(storage->port, (uint16_t)(base + offset), value);
    return SETTINGS_BUSY;
}

// What a byte of the slot between version and CRC should be.
static uint8_t wanted(const struct settings_writer *writer,
                      const struct settings *settings, uint8_t offset) {
    switch (offset) {
    case AT_LENGTH:
        return sizeof *settings;
    case AT_SEQUENCE:
        return writer->sequence;
    default:
        return ((const uint8_t *)settings)[offset - AT_PAYLOAD];
    }
}

// Writes the next byte that differs, looking once around from the one written last; OK
// where none does.
static enum settings_result fill(struct settings_writer *writer,
                                 const struct settings_storage *storage,
                                 const struct settings *settings) {
    uint8_t offset = writer->offset;
    for (uint8_t seen = AT_LENGTH; seen < AT_CRC; ++seen) {
        if (offset < AT_LENGTH || offset >= AT_CRC) {
            offset = AT_LENGTH;
        }
        const uint8_t value = wanted(writer, settings, offset);
        if (read_byte(storage, writer->slot, offset) != value) {
            return write_byte(writer, storage, offset, value);
        }
        ++offset;
    }
    // Memory equals the settings at this moment, so that theirs is its CRC.
    const uint8_t header[SETTINGS_HEADER] = {SETTINGS_VERSION, sizeof *settings,
                                             writer->sequence};
    const uint16_t crc = frame_crc(frame_crc(CRC_SEED, header, sizeof header),
                                   (const uint8_t *)settings, sizeof *settings);
    const uint8_t halves[SETTINGS_CRC] = {(uint8_t)(crc % 256), (uint8_t)(crc / 256)};
    for (uint8_t i = 0; i < SETTINGS_CRC; ++i) {
        offset = (uint8_t)(AT_CRC + i);
        if (read_byte(storage, writer->slot, offset) != halves[i]) {
            return write_byte(writer, storage, offset, halves[i]);
        }
    }
    return SETTINGS_OK;
}

enum settings_result settings_step(struct settings_writer *writer,
                                   const struct settings_storage *storage,
                                   const struct settings *settings) {
    if (writer->phase == IDLE) {
        return SETTINGS_OK;
    }
    if (!storage->is_ready(storage->port)) {
        return SETTINGS_BUSY;
    }
    const bool is_marked =
        read_byte(storage, writer->slot, AT_VERSION) == SETTINGS_VERSION;
    if (writer->phase == BLANKING) {
        if (is_marked) {
            return write_byte(writer, storage, AT_VERSION, BLANK);
        }
        writer->phase = FILLING;
        writer->offset = AT_VERSION;
        writer->tries = 0;
    }
    if (writer->phase == FILLING) {
        const enum settings_result result = fill(writer, storage, settings);
        if (result != SETTINGS_OK) {
            return result;
        }
        writer->phase = COMMITTING;
    }
    if (!is_marked) {
        return write_byte(writer, storage, AT_VERSION, SETTINGS_VERSION);
    }
    // This slot is good: the next save goes to the other one.
    writer->slot ^= 1;
    ++writer->sequence;
    bool is_current = true;
    const uint8_t saved = writer->slot ^ 1;
    for (uint8_t offset = AT_PAYLOAD; offset < AT_CRC && is_current; ++offset) {
        is_current =
            read_byte(storage, saved, offset) == wanted(writer, settings, offset);
    }
    // What changed after the CRC was taken goes into a save of its own.
    writer->phase = is_current ? IDLE : BLANKING;
    writer->tries = 0;
    return is_current ? SETTINGS_OK : SETTINGS_BUSY;
}
