// SPDX-License-Identifier: MIT
// Finds the prepared file on a FAT32 card. Each function acts on the block that was
// read, and has the card read the next one. Private to the logbook.
#ifndef LOGBOOK_FILE_H
#define LOGBOOK_FILE_H

#include "core/storage/logbook.h"

void logbook_take_partitions(struct logbook *book);
// The block that was read is the partition table, with the volume of the file.
bool logbook_is_table(struct logbook *book);
void logbook_take_volume(struct logbook *book);
void logbook_take_root(struct logbook *book);
void logbook_take_root_link(struct logbook *book);
void logbook_take_file_chain(struct logbook *book);

#endif
