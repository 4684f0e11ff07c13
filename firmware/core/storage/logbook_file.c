// SPDX-License-Identifier: MIT
// From the card's first block to the prepared file: partition table, volume, root
// folder, and the whole chain of the file's clusters.
//
// Document: FAT = Microsoft FAT32 File System Specification, version 1.03.
#include "core/storage/logbook_file.h"

#include <stddef.h>
#include <string.h>

#include "core/storage/logbook_state.h"

enum {
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
};

#define END_OF_CHAIN UINT32_C(0x0FFFFFF8)
#define CLUSTER_MASK UINT32_C(0x0FFFFFFF)

static bool has_signature(const uint8_t *block) {
    return block[SIGNATURE_AT] == 0x55 && block[SIGNATURE_AT + 1] == 0xAA;
}

// The first entry of a FAT32, in the block that was read; null: there is none.
static const uint8_t *find_volume(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    const uint8_t *entry = block + PARTITIONS_AT;
    for (uint8_t i = 0; i < PARTITIONS && has_signature(block); i++) {
        if (entry[4] == TYPE_FAT32 || entry[4] == TYPE_FAT32_LBA) {
            return entry;
        }
        entry += PARTITION_SIZE;
    }
    return NULL;
}

void logbook_take_partitions(struct logbook *book) {
    const uint8_t *entry = find_volume(book);
    if (entry != NULL) {
        book->volume = logbook_u32(entry + 8);
        book->volume_blocks = logbook_u32(entry + 12);
        if (book->volume > 0 && book->volume < book->card.blocks &&
            book->volume_blocks <= book->card.blocks - book->volume) {
            logbook_read(book, LOGBOOK_VOLUME, book->volume);
            return;
        }
    }
    logbook_refuse_unprepared(book);
}

bool logbook_is_table(struct logbook *book) {
    const uint8_t *entry = find_volume(book);
    return entry != NULL && logbook_u32(entry + 8) == book->volume &&
           logbook_u32(entry + 12) == book->volume_blocks;
}

static bool is_cluster(const struct logbook *book, uint32_t number) {
    return number >= FIRST_CLUSTER && number < book->clusters_end;
}

// The clusters lie in the volume: the sum fits.
static uint32_t block_of(const struct logbook *book, uint32_t cluster) {
    return book->data + (cluster - FIRST_CLUSTER) * book->cluster_blocks;
}

// FAT, "Boot Sector and BPB Structure". False where the volume makes no sense.
static bool parse_volume(struct logbook *book) {
    const uint8_t *block = sdcard_block(&book->card);
    const uint8_t cluster_blocks = block[13];
    const uint16_t reserved = logbook_u16(block + 14);
    const uint8_t fats = block[16];
    const uint32_t blocks = logbook_u32(block + 32);
    const uint32_t fat_blocks = logbook_u32(block + 36);
    const uint32_t root = logbook_u32(block + 44);
    const bool is_fat32 =
        has_signature(block) && logbook_u16(block + 11) == SDCARD_BLOCK &&
        logbook_u16(block + 17) == 0 && logbook_u16(block + 19) == 0 &&
        logbook_u16(block + 22) == 0 && logbook_u16(block + 42) == 0 &&
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
        logbook_refuse_unprepared(book);
        return;
    }
    book->left--;
    logbook_read(book, LOGBOOK_ROOT,
                 block_of(book, book->cluster) + book->block_in_cluster);
}

void logbook_take_volume(struct logbook *book) {
    if (parse_volume(book)) {
        read_root(book);
    } else {
        logbook_refuse_unprepared(book);
    }
}

static void read_chain(struct logbook *book, enum logbook_phase phase) {
    logbook_read(book, phase, book->fat + book->cluster / FAT_ENTRIES);
}

// The entry in the block of the FAT that was read.
static uint32_t link_of(struct logbook *book, uint32_t cluster) {
    const uint8_t *entry = sdcard_block(&book->card) + cluster % FAT_ENTRIES * 4;
    return logbook_u32(entry) & CLUSTER_MASK;
}

void logbook_take_root_link(struct logbook *book) {
    book->cluster = link_of(book, book->cluster);
    book->block_in_cluster = 0;
    if (is_cluster(book, book->cluster)) {
        read_root(book);
    } else {
        logbook_refuse_unprepared(book);
    }
}

static void take_file(struct logbook *book, const uint8_t *entry) {
    const uint32_t first =
        logbook_u16(entry + 26) + logbook_u16(entry + 20) * UINT32_C(65536);
    const uint32_t size = logbook_u32(entry + 28);
    const uint32_t blocks = size / SDCARD_BLOCK;
    if (size % SDCARD_BLOCK != 0 || blocks < 2 || !is_cluster(book, first)) {
        logbook_refuse_unprepared(book);
        return;
    }
    const uint32_t clusters = (blocks - 1) / book->cluster_blocks + 1;
    if (clusters > book->clusters_end - first) {
        logbook_refuse_unprepared(book);
        return;
    }
    book->file = block_of(book, first);
    book->file_blocks = blocks;
    book->cluster = first;
    book->left = clusters;
    read_chain(book, LOGBOOK_FILE_CHAIN);
}

void logbook_take_root(struct logbook *book) {
    const uint8_t *entry = sdcard_block(&book->card);
    for (uint8_t i = 0; i < SDCARD_BLOCK / ENTRY_SIZE; i++, entry += ENTRY_SIZE) {
        if (entry[0] == 0) {  // none behind it
            logbook_refuse_unprepared(book);
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
        read_chain(book, LOGBOOK_ROOT_CHAIN);
    }
}

// Each cluster's link must point at the next one, and the last must end the chain: then
// nothing is written outside the file.
void logbook_take_file_chain(struct logbook *book) {
    do {
        const uint32_t link = link_of(book, book->cluster);
        book->left--;
        book->cluster++;
        if (book->left == 0 ? link < END_OF_CHAIN : link != book->cluster) {
            logbook_refuse_unprepared(book);
            return;
        }
        if (book->left == 0) {
            logbook_read(book, LOGBOOK_HEAD, book->file);
            return;
        }
    } while (book->cluster % FAT_ENTRIES != 0);
    read_chain(book, LOGBOOK_FILE_CHAIN);
}
