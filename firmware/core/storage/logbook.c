// SPDX-License-Identifier: MIT
// Finds the prepared file, keeps frames in a ring, cuts blocks from it and has the card
// write them in short runs.
//
// Documents: FAT = Microsoft FAT32 File System Specification, version 1.03; the blocks
// are those of docs/card.md.
#include "core/storage/logbook.h"

#include <string.h>

// Microseconds.
#define LOOK_EVERY UINT32_C(1000000)    // for a card, and whether it is still there
#define FAILED_FOR UINT32_C(10000000)   // before a card that failed is looked at again
#define PARTIAL_AFTER UINT32_C(100000)  // a byte that waits for its block to fill
#define TOLD_SLOW_EVERY UINT32_C(1000000)

enum {
    // Of a run that is cut short any block may be missing and any be there: were there
    // more, some could lie beyond what the search for the end looks over.
    RUN_MAX = 8,
    BAD_MAX = 8,  // in a row, that do not end the recordings: worn, or such a run
    TRIES = 3,
    RESTARTS_MAX = 3,

    // A sector with a partition table or a volume: FAT, "Boot Sector and BPB".
    SIGNATURE_AT = 510,
    PARTITIONS_AT = 446,
    PARTITION_SIZE = 16,
    PARTITIONS = 4,
    TYPE_FAT32 = 0x0B,
    TYPE_FAT32_LBA = 0x0C,
    CLUSTER_BLOCKS_MAX = 128,
    FATS_MAX = 2,
    NOT_MIRRORED = 0x80,  // BPB_ExtFlags

    FIRST_CLUSTER = 2,
    FAT_ENTRIES = SDCARD_BLOCK / 4,
    // FAT, "FAT 32 Byte Directory Entry Structure": a folder has 65536 entries at most.
    ENTRY_SIZE = 32,
    ROOT_BLOCKS_MAX = 4096,
    NAME_LENGTH = 11,
    ATTRIBUTES_AT = 11,
    FOLDER_OR_VOLUME = 0x18,

    // Blocks of the file.
    HEAD_LENGTH = 24,  // what follows is zero
    HEAD_VERSION = 1,
    CRC_AT = 508,
    CONTENT_AT = 12,
    FLAG_FIRST = 1,
    FLAG_LAST = 2,

    SUM_PART = CRC_AT / 4,  // bytes of a checksum in one step: 12 us
};

_Static_assert(CONTENT_AT + LOGBOOK_CONTENT == CRC_AT, "a block is full");
_Static_assert(CRC_AT % SUM_PART == 0, "its checksum ends with a part");

#define END_OF_CHAIN UINT32_C(0x0FFFFFF8)
#define CLUSTER_MASK UINT32_C(0x0FFFFFFF)

enum phase {
    WAITING,  // for the time to look for a card
    IDENTIFY,
    PARTITION,
    VOLUME,
    ROOT,
    ROOT_CHAIN,
    FILE_CHAIN,
    HEAD,
    SEARCH,
    RESTING,  // nothing goes on
    CHECKING,
    OPENING,
    CUTTING,
    WRITING,
    STOPPING,
};

static uint16_t get_u16(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static uint32_t get_u32(const uint8_t *bytes) {
    return get_u16(bytes) | (uint32_t)get_u16(bytes + 2) << 16;
}

static void put_u32(uint8_t *bytes, uint32_t value) {
    for (uint8_t i = 0; i < 4; i++, value >>= 8) {
        bytes[i] = (uint8_t)value;
    }
}

// IEEE 802.3, reflected, four bits at a time.
static uint32_t crc32(uint32_t crc, const uint8_t *bytes, uint16_t length) {
    static const uint32_t table[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
        0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
        0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    for (; length > 0; length--, bytes++) {
        crc = table[(crc ^ *bytes) & 0x0F] ^ crc >> 4;
        crc = table[(crc ^ *bytes >> 4) & 0x0F] ^ crc >> 4;
    }
    return crc;
}

static void begin_sum(struct logbook *book) {
    book->is_summing = true;
    book->place = 0;
    book->crc = UINT32_MAX;
}

// Takes a part, or ends the sum: it is then in `crc`.
static bool sum_is_complete(struct logbook *book) {
    if (book->place == CRC_AT) {
        book->crc = ~book->crc;
        book->is_summing = false;
        return true;
    }
    book->crc = crc32(book->crc, sdcard_block(&book->card) + book->place, SUM_PART);
    book->place = (uint16_t)(book->place + SUM_PART);
    return false;
}

static bool sum_fits(struct logbook *book) {
    return book->crc == get_u32(sdcard_block(&book->card) + CRC_AT);
}

// A step makes three at most: what nobody has taken since is out of date.
static void tell(struct logbook *book, enum event event, enum cause cause,
                 uint32_t detail) {
    if (book->changes_count == LOGBOOK_CHANGES) {
        book->changes_count--;
        memmove(book->changes, book->changes + 1,
                (LOGBOOK_CHANGES - 1) * sizeof *book->changes);
    }
    book->changes[book->changes_count] = (struct logbook_change){
        .event = (uint8_t)event, .cause = (uint8_t)cause, .detail = (int32_t)detail};
    book->changes_count++;
}

bool logbook_take_change(struct logbook *book, struct logbook_change *out) {
    if (book->changes_count == 0) {
        return false;
    }
    *out = book->changes[0];
    book->changes_count--;
    memmove(book->changes, book->changes + 1,
            book->changes_count * sizeof *book->changes);
    return true;
}

static enum cause cause_of(enum sdcard_result failure) {
    switch (failure) {
    case SDCARD_ABSENT:
        return CAUSE_ABSENT;
    case SDCARD_TIMEOUT:
        return CAUSE_TIMEOUT;
    case SDCARD_FAILED:
        return CAUSE_WORN;
    default:
        return CAUSE_REJECTED;
    }
}

static void wait(struct logbook *book, enum phase phase, uint32_t wait_us) {
    book->phase = (uint8_t)phase;
    book->since_us = book->now_us;
    book->wait_us = wait_us;
}

static void rest(struct logbook *book) {
    wait(book, RESTING, LOOK_EVERY);
}

static void read(struct logbook *book, enum phase phase, uint32_t block) {
    book->phase = (uint8_t)phase;
    sdcard_read(&book->card, block);
}

static void identify(struct logbook *book) {
    book->phase = IDENTIFY;
    sdcard_identify(&book->card);
}

static void end_recording(struct logbook *book, enum cause cause) {
    if (book->is_recording) {
        tell(book, EVENT_LOG_ENDED, cause, book->recording);
    }
    book->is_recording = false;
    book->is_closing = false;
    book->used = 0;
    book->cut = 0;
}

// The card can't be used as it is; told once.
static void refuse(struct logbook *book, enum card state, enum cause cause) {
    end_recording(book, cause);
    book->state = (uint8_t)state;
    if (book->told_cause != cause) {
        book->told_cause = (uint8_t)cause;
        tell(book, state == CARD_FULL ? EVENT_CARD_FULL : EVENT_CARD_FAULT, cause,
             book->next);
    }
    if (state == CARD_ABSENT) {
        book->next = 0;
        book->file_blocks = 0;
        wait(book, WAITING, LOOK_EVERY);
    } else if (state == CARD_FAILED) {
        wait(book, WAITING, FAILED_FOR);
    } else {
        rest(book);
    }
}

static void refuse_unprepared(struct logbook *book) {
    book->next = 0;
    book->file_blocks = 0;
    refuse(book, CARD_UNPREPARED, CAUSE_UNPREPARED);
}

static void fail(struct logbook *book, enum sdcard_result failure) {
    refuse(book, failure == SDCARD_ABSENT ? CARD_ABSENT : CARD_FAILED,
           cause_of(failure));
}

// A card that is in trouble amid a recording is identified once more, and the recording
// goes on from what it has confirmed.
static void restart(struct logbook *book, enum sdcard_result failure) {
    book->restarts++;
    if (book->restarts > RESTARTS_MAX) {
        refuse(book, CARD_FAILED, cause_of(failure));
        return;
    }
    tell(book, EVENT_CARD_FAULT, cause_of(failure), book->next);
    identify(book);
}

static bool has_signature(const uint8_t *block) {
    return block[SIGNATURE_AT] == 0x55 && block[SIGNATURE_AT + 1] == 0xAA;
}

static void take_partitions(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    const uint8_t *entry = block + PARTITIONS_AT;
    for (uint8_t i = 0; i < PARTITIONS && has_signature(block); i++) {
        const uint8_t type = entry[4];
        book->volume = get_u32(entry + 8);
        book->volume_blocks = get_u32(entry + 12);
        if (type == TYPE_FAT32 || type == TYPE_FAT32_LBA) {
            if (book->volume > 0 && book->volume < book->card.blocks &&
                book->volume_blocks <= book->card.blocks - book->volume) {
                read(book, VOLUME, book->volume);
                return;
            }
            break;
        }
        entry += PARTITION_SIZE;
    }
    refuse_unprepared(book);
}

static bool is_cluster(const struct logbook *book, uint32_t number) {
    return number >= FIRST_CLUSTER && number < book->clusters_end;
}

// The clusters lie in the volume: the sum fits.
static uint32_t block_of(const struct logbook *book, uint32_t cluster) {
    return book->data + (cluster - FIRST_CLUSTER) * book->cluster_blocks;
}

// FAT, "Boot Sector and BPB Structure". False where it makes no sense.
static bool take_volume(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    const uint8_t cluster_blocks = block[13];
    const uint16_t reserved = get_u16(block + 14);
    const uint8_t fats = block[16];
    const uint32_t blocks = get_u32(block + 32);
    const uint32_t fat_blocks = get_u32(block + 36);
    const uint32_t root = get_u32(block + 44);
    const bool is_fat32 = has_signature(block) && get_u16(block + 11) == SDCARD_BLOCK &&
                          get_u16(block + 17) == 0 && get_u16(block + 19) == 0 &&
                          get_u16(block + 22) == 0 && get_u16(block + 42) == 0 &&
                          (block[40] & NOT_MIRRORED) == 0;
    if (!is_fat32 || cluster_blocks == 0 || cluster_blocks > CLUSTER_BLOCKS_MAX ||
        (cluster_blocks & (cluster_blocks - 1)) != 0 || fats == 0 || fats > FATS_MAX ||
        reserved == 0 || blocks > book->volume_blocks || reserved >= blocks ||
        fat_blocks > (blocks - reserved) / fats) {
        return false;
    }
    const uint32_t before = reserved + fats * fat_blocks;  // <= blocks
    const uint32_t clusters = (blocks - before) / cluster_blocks;
    // One entry a cluster, and two; no cluster has a number that ends a chain.
    if (clusters >= CLUSTER_MASK - FAT_ENTRIES ||
        (clusters + FIRST_CLUSTER + FAT_ENTRIES - 1) / FAT_ENTRIES > fat_blocks) {
        return false;
    }
    book->cluster_blocks = cluster_blocks;
    book->fat = book->volume + reserved;
    book->data = book->volume + before;
    book->clusters_end = clusters + FIRST_CLUSTER;
    book->cluster = root;
    book->block_in_cluster = 0;
    book->left = ROOT_BLOCKS_MAX;
    return is_cluster(book, root);
}

static void read_root(struct logbook *book) {
    if (book->left == 0) {  // a chain that ends in itself
        refuse_unprepared(book);
        return;
    }
    book->left--;
    read(book, ROOT, block_of(book, book->cluster) + book->block_in_cluster);
}

static void read_chain(struct logbook *book, enum phase phase) {
    read(book, phase, book->fat + book->cluster / FAT_ENTRIES);
}

// The entry in the block of the FAT that was read.
static uint32_t link_of(struct logbook *book, uint32_t cluster) {
    const uint8_t *entry = sdcard_block(&book->card) + cluster % FAT_ENTRIES * 4;
    return get_u32(entry) & CLUSTER_MASK;
}

static void take_root_link(struct logbook *book) {
    book->cluster = link_of(book, book->cluster);
    book->block_in_cluster = 0;
    if (is_cluster(book, book->cluster)) {
        read_root(book);
    } else {
        refuse_unprepared(book);
    }
}

static void take_file(struct logbook *book, const uint8_t *entry) {
    const uint32_t first = get_u16(entry + 26) | (uint32_t)get_u16(entry + 20) << 16;
    const uint32_t size = get_u32(entry + 28);
    const uint32_t blocks = size / SDCARD_BLOCK;
    if (size % SDCARD_BLOCK != 0 || blocks < 2 || !is_cluster(book, first)) {
        refuse_unprepared(book);
        return;
    }
    const uint32_t clusters = (blocks - 1) / book->cluster_blocks + 1;
    if (clusters > book->clusters_end - first) {
        refuse_unprepared(book);
        return;
    }
    book->file = block_of(book, first);
    book->file_blocks = blocks;
    book->cluster = first;
    book->left = clusters;
    read_chain(book, FILE_CHAIN);
}

static void take_root(struct logbook *book) {
    const uint8_t *entry = sdcard_block(&book->card);
    for (uint8_t i = 0; i < SDCARD_BLOCK / ENTRY_SIZE; i++, entry += ENTRY_SIZE) {
        if (entry[0] == 0) {  // none behind it
            refuse_unprepared(book);
            return;
        }
        if (memcmp(entry, "PROBE   LOG", NAME_LENGTH) == 0 &&
            (entry[ATTRIBUTES_AT] & FOLDER_OR_VOLUME) == 0) {
            take_file(book, entry);
            return;
        }
    }
    book->block_in_cluster++;
    if (book->block_in_cluster < book->cluster_blocks) {
        read_root(book);
    } else {
        read_chain(book, ROOT_CHAIN);
    }
}

// Each cluster's link must point at the next one, and the last must end the chain: what
// is written goes nowhere but into the file.
static void take_file_chain(struct logbook *book) {
    do {
        const uint32_t link = link_of(book, book->cluster);
        book->left--;
        book->cluster++;
        if (book->left == 0 ? link < END_OF_CHAIN : link != book->cluster) {
            refuse_unprepared(book);
            return;
        }
        if (book->left == 0) {
            read(book, HEAD, book->file);
            return;
        }
    } while (book->cluster % FAT_ENTRIES != 0);
    read_chain(book, FILE_CHAIN);
}

static bool is_head(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    for (uint16_t i = HEAD_LENGTH; i < CRC_AT; i++) {
        if (block[i] != 0) {
            return false;
        }
    }
    return sum_fits(book) && memcmp(block, "IMUPROBE", 8) == 0 &&
           get_u16(block + 8) == HEAD_VERSION && get_u16(block + 10) == SDCARD_BLOCK &&
           get_u32(block + 12) != 0 && get_u32(block + 16) == book->file &&
           get_u32(block + 20) == book->file_blocks;
}

// Ready for a recording, or full.
static void settle(struct logbook *book) {
    if (book->next >= book->file_blocks) {
        refuse(book, CARD_FULL, CAUSE_FULL);
        return;
    }
    book->told_cause = CAUSE_NONE;
    book->state = CARD_READY;
    rest(book);
}

// Looks at the middle, and at the blocks behind it for as long as none is good.
static void search(struct logbook *book) {
    if (book->high - book->low > 1) {
        book->probe = book->low + (book->high - book->low) / 2;
        book->probes_end = book->high - book->probe > BAD_MAX + 1
                               ? book->probe + BAD_MAX + 1
                               : book->high;
        read(book, SEARCH, book->file + book->probe);
        return;
    }
    book->next = book->high;
    settle(book);
    if (book->state == CARD_READY) {
        tell(book, EVENT_CARD_READY, CAUSE_NONE, book->next);
    }
}

static void take_probe(struct logbook *book, bool is_good) {
    if (is_good) {
        book->low = book->probe;
        book->recording = get_u16(sdcard_block(&book->card) + 8);
        search(book);
        return;
    }
    book->probe++;
    if (book->probe < book->probes_end) {
        read(book, SEARCH, book->file + book->probe);
        return;
    }
    book->high = book->low + (book->high - book->low) / 2;
    search(book);
}

static bool is_good_block(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    return sum_fits(book) && get_u32(block) == book->card_id &&
           get_u32(block + 4) == book->probe;
}

static void take_head(struct logbook *book) {
    const uint32_t card_id = get_u32(sdcard_block(&book->card) + 12);
    const bool is_ours = is_head(book);
    if (book->is_recording) {
        if (is_ours && card_id == book->card_id) {
            rest(book);
            return;
        }
        end_recording(book, CAUSE_ABSENT);  // another card is there in its place
        book->state = CARD_STARTING;
        read(book, PARTITION, 0);
        return;
    }
    if (!is_ours) {
        refuse_unprepared(book);
        return;
    }
    book->card_id = card_id;
    book->recording = 0;
    book->low = 0;
    book->high = book->file_blocks;
    search(book);
}

static void take_identity(struct logbook *book, enum sdcard_result result) {
    if (result != SDCARD_OK && result != SDCARD_ABSENT && book->is_recording) {
        restart(book, result);
    } else if (result != SDCARD_OK) {
        fail(book, result);
    } else if (book->card.is_read_only) {
        refuse(book, CARD_FAILED, CAUSE_REJECTED);
    } else if (book->is_recording) {
        read(book, HEAD, book->file);
    } else {
        book->state = CARD_STARTING;
        read(book, PARTITION, 0);
    }
}

// Whole frames alone, so that the last block of the file ends with one: the ring holds
// more than fits.
static uint16_t whole_frames(const struct logbook *book, uint16_t length) {
    uint32_t at = book->tail + book->cut + length;
    for (; length > 0; length--) {
        at--;
        if (book->ring[at % book->size] == 0) {
            break;
        }
    }
    return length;
}

static void cut_block(struct logbook *book) {
    uint8_t *block = sdcard_block(&book->card);
    const uint32_t number = book->next + book->run;
    const uint32_t left = book->used - book->cut;
    const bool ends_file = number == book->file_blocks - 1;
    uint16_t length = left < LOGBOOK_CONTENT ? (uint16_t)left : LOGBOOK_CONTENT;
    if (ends_file) {
        length = whole_frames(book, length);
    }
    book->is_drained = left == length;
    book->is_last = ends_file || (book->is_closing && book->is_drained);
    book->cut_length = length;
    book->cut_us = book->now_us;

    put_u32(block, book->card_id);
    put_u32(block + 4, number);
    block[8] = (uint8_t)book->recording;
    block[9] = (uint8_t)(book->recording >> 8);
    block[10] = (uint8_t)((book->is_first && book->run == 0 ? FLAG_FIRST : 0) |
                          (book->is_last ? FLAG_LAST : 0));
    block[11] = 0;
    // tail < size and cut <= used <= size.
    const uint32_t sum = book->tail + book->cut;
    const uint32_t from = sum < book->size ? sum : sum - book->size;
    const uint32_t to_end = book->size - from;
    const uint16_t piece = length < to_end ? length : (uint16_t)to_end;
    uint8_t *content = block + CONTENT_AT;
    memcpy(content, book->ring + from, piece);
    memcpy(content + piece, book->ring, (uint16_t)(length - piece));
    memset(content + length, 0, (uint16_t)(LOGBOOK_CONTENT - length));
    book->phase = CUTTING;
    begin_sum(book);
}

// What the card has confirmed leaves the ring.
static void confirm_run(struct logbook *book) {
    const uint32_t tail = book->tail + book->cut;
    book->tail = tail < book->size ? tail : tail - book->size;
    book->used -= book->cut;
    book->cut = 0;
    book->next += book->run;
    book->is_first = false;
    book->tries = 0;
    book->left_out = 0;
    book->restarts = 0;
    if (book->singles > 0) {
        book->singles--;
    }
    if (book->is_drained) {
        book->oldest_us = book->cut_us;
    }
    rest(book);
    if (book->is_last) {
        const bool is_closed = book->is_closing && book->is_drained;
        end_recording(book, is_closed ? (enum cause)book->end_cause : CAUSE_FULL);
        settle(book);
    }
}

// A block that is left out ends nothing, unless too many are.
static void leave_out(struct logbook *book) {
    tell(book, EVENT_CARD_FAULT, CAUSE_WORN, book->next);
    book->left_out++;
    book->next++;
    if (book->left_out > BAD_MAX) {
        refuse(book, CARD_FAILED, CAUSE_WORN);
    } else if (book->next >= book->file_blocks) {
        settle(book);
    }
}

// Tries what was in the run once more, block by block, to find which one it is.
static void survive_run(struct logbook *book, enum sdcard_result failure) {
    book->cut = 0;
    if (failure != SDCARD_FAILED && failure != SDCARD_GARBLED) {
        restart(book, failure);
        return;
    }
    rest(book);
    if (book->singles == 0) {
        book->singles = RUN_MAX;
        book->tries = 0;
        return;
    }
    book->tries++;
    if (book->tries < TRIES) {
        return;
    }
    book->tries = 0;
    if (failure == SDCARD_FAILED) {
        leave_out(book);
    } else {
        restart(book, failure);
    }
}

static void note_busy(struct logbook *book) {
    const uint32_t busy_us = book->card.busy_us;
    if (busy_us > book->busy_worst_us) {
        book->busy_worst_us = busy_us;
    }
    const bool is_told =
        book->has_told_slow && book->now_us - book->told_slow_us < TOLD_SLOW_EVERY;
    if (busy_us >= SDCARD_SLOW_US && !is_told) {
        book->has_told_slow = true;
        book->told_slow_us = book->now_us;
        tell(book, EVENT_CARD_FAULT, CAUSE_LATE, book->next);
    }
}

static void take_written(struct logbook *book) {
    note_busy(book);
    book->cut += book->cut_length;
    book->run++;
    const uint8_t limit = book->singles > 0 ? 1 : RUN_MAX;
    if (book->is_drained || book->is_last || book->run == limit) {
        book->phase = STOPPING;
        sdcard_close(&book->card);
    } else {
        cut_block(book);
    }
}

// A run that has not taken all is followed by another: what it left is older.
static bool is_run_due(const struct logbook *book) {
    return book->is_recording &&
           (book->is_closing ||
            (book->used > 0 && book->now_us - book->oldest_us >= PARTIAL_AFTER));
}

static void leave_rest(struct logbook *book) {
    if (is_run_due(book)) {
        book->phase = OPENING;
        book->run = 0;
        book->cut = 0;
        sdcard_open(&book->card, book->file + book->next);
    } else if (book->now_us - book->since_us >= book->wait_us) {
        book->phase = CHECKING;
        sdcard_check(&book->card);
    }
}

// Where failures are no business of a run's.
static void act_on_failure(struct logbook *book, enum sdcard_result failure) {
    switch ((enum phase)book->phase) {
    case SEARCH:
        if (failure == SDCARD_FAILED) {  // what a cut tore may be unreadable
            take_probe(book, false);
            return;
        }
        break;
    case CHECKING:
        if (!book->is_recording) {
            identify(book);
            return;
        }
        break;
    case OPENING:
    case WRITING:
    case STOPPING:
        survive_run(book, failure);
        return;
    default:
        break;
    }
    if (book->is_recording) {
        restart(book, failure);
    } else {
        fail(book, failure);
    }
}

static void act(struct logbook *book) {
    switch ((enum phase)book->phase) {
    case WAITING:
        if (book->now_us - book->since_us >= book->wait_us) {
            identify(book);
        }
        break;
    case PARTITION:
        take_partitions(book);
        break;
    case VOLUME:
        if (take_volume(book)) {
            read_root(book);
        } else {
            refuse_unprepared(book);
        }
        break;
    case ROOT:
        take_root(book);
        break;
    case ROOT_CHAIN:
        take_root_link(book);
        break;
    case FILE_CHAIN:
        take_file_chain(book);
        break;
    case HEAD:
    case SEARCH:
        begin_sum(book);
        break;
    case RESTING:
        leave_rest(book);
        break;
    case CHECKING:
        rest(book);
        break;
    case OPENING:
        cut_block(book);
        break;
    case WRITING:
        take_written(book);
        break;
    default:  // STOPPING
        note_busy(book);
        confirm_run(book);
        break;
    }
}

static void act_on_sum(struct logbook *book) {
    switch ((enum phase)book->phase) {
    case HEAD:
        take_head(book);
        break;
    case SEARCH:
        take_probe(book, is_good_block(book));
        break;
    default:  // CUTTING
        put_u32(sdcard_block(&book->card) + CRC_AT, book->crc);
        book->phase = WRITING;
        sdcard_write(&book->card);
        break;
    }
}

// NOLINTNEXTLINE(readability-non-const-parameter): logbook_put() writes into the ring
void logbook_init(struct logbook *book, const struct spi_device *spi, uint8_t *ring,
                  uint32_t size) {
    *book = (struct logbook){.ring = ring, .size = size, .state = CARD_STARTING};
    sdcard_init(&book->card, spi);
}

bool logbook_step(struct logbook *book, uint32_t now_us) {
    book->now_us = now_us;
    if (book->is_summing) {
        if (sum_is_complete(book)) {
            act_on_sum(book);
        }
        return true;
    }
    const enum sdcard_result result = sdcard_step(&book->card, now_us);
    if (result > 0) {
        return result == SDCARD_GOES_ON;
    }
    if (book->phase == IDENTIFY) {
        take_identity(book, result);
    } else if (result < 0) {
        act_on_failure(book, result);
    } else {
        act(book);
    }
    return !sdcard_is_idle(&book->card);
}

bool logbook_open(struct logbook *book) {
    if (book->state != CARD_READY || book->is_recording) {
        return false;
    }
    book->recording =
        book->recording == UINT16_MAX ? 1 : (uint16_t)(book->recording + 1);
    book->state = CARD_LOGGING;
    book->is_recording = true;
    book->is_first = true;
    book->tail = 0;
    book->used = 0;
    book->singles = 0;
    book->tries = 0;
    book->left_out = 0;
    book->restarts = 0;
    tell(book, EVENT_LOG_STARTED, CAUSE_NONE, book->recording);
    return true;
}

void logbook_close(struct logbook *book, enum cause cause) {
    if (book->is_recording && !book->is_closing) {
        book->is_closing = true;
        book->end_cause = (uint8_t)cause;
    }
}

bool logbook_put(struct logbook *book, const uint8_t *frame, uint8_t length) {
    if (!book->is_recording || book->is_closing || length > book->size - book->used) {
        return false;
    }
    if (book->used == 0) {
        book->oldest_us = book->now_us;
    }
    const uint32_t sum = book->tail + book->used;  // tail < size, used <= size
    const uint32_t head = sum < book->size ? sum : sum - book->size;
    const uint32_t to_end = book->size - head;
    const uint8_t piece = length < to_end ? length : (uint8_t)to_end;
    memcpy(book->ring + head, frame, piece);
    memcpy(book->ring, frame + piece, (uint8_t)(length - piece));
    book->used += length;
    return true;
}

bool logbook_is_idle(const struct logbook *book) {
    return !book->is_recording && sdcard_is_idle(&book->card);
}

void logbook_describe(const struct logbook *book, struct message_equipment *out) {
    const uint32_t busy_ms = book->busy_worst_us / 1000;
    out->card = book->state;
    out->card_block = book->next;
    out->card_blocks = book->file_blocks;
    out->card_faults = book->card.faults;
    out->card_busy = busy_ms > UINT16_MAX ? UINT16_MAX : (uint16_t)busy_ms;
    out->recording = book->recording;
}
