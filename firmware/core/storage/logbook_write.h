// SPDX-License-Identifier: MIT
// Cuts blocks from the ring and has the card write them in short runs. Private to the
// logbook.
#ifndef LOGBOOK_WRITE_H
#define LOGBOOK_WRITE_H

#include "core/storage/logbook.h"

// Copies the next bytes of the ring to the card's block, and begins its checksum.
void logbook_cut_block(struct logbook *book);
// A block is with the card: cuts the next one, or ends the run.
void logbook_take_written(struct logbook *book);
// The card says that it has the run: reads its first block back if that is due.
void logbook_end_run(struct logbook *book);
// A block was read back; `is_good`: its checksum fits.
void logbook_take_proof(struct logbook *book, bool is_good);
// The run is on the card: what it took leaves the ring.
void logbook_confirm_run(struct logbook *book);
// The run failed: tries its content once more, block by block, to find which one it is.
void logbook_survive_run(struct logbook *book, enum sdcard_result failure);

#endif
