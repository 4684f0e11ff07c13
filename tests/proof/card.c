// SPDX-License-Identifier: MIT
// Any block of a card at all: what the parser of FAT32 does with it. What it asks of
// the card, and that it refuses one, is nothing here.
#include "any.h"
#include "core/storage/logbook_file.h"
#include "core/storage/logbook_state.h"

static struct logbook book;

void logbook_read(struct logbook *of, enum logbook_phase phase, uint32_t number) {
    (void)of;
    (void)phase;
    any_long = number;
}

void logbook_refuse_unprepared(struct logbook *of) { (void)of; }

// Numbers from blocks before, whatever they were; but a cluster has blocks.
static void begin(void) {
    any_fill(sdcard_block(&book.card), SDCARD_BLOCK);
    book.card.blocks = any_u32();
    book.volume = any_u32();
    book.volume_blocks = any_u32();
    book.fat = any_u32();
    book.data = any_u32();
    book.clusters_end = any_u32();
    book.cluster = any_u32();
    book.left = any_u32();
    book.file = any_u32();
    book.file_blocks = any_u32();
    book.block_in_cluster = any_u8();
    book.cluster_blocks = (uint8_t)(any_u8() | 1);
}

void partitions(void) {
    begin();
    logbook_take_partitions(&book);
}

void volume(void) {
    begin();
    logbook_take_volume(&book);
}

void root(void) {
    begin();
    logbook_take_root(&book);
}

void root_link(void) {
    begin();
    logbook_take_root_link(&book);
}

void file_chain(void) {
    begin();
    logbook_take_file_chain(&book);
}
