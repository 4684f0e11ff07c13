// SPDX-License-Identifier: MIT
// Recordings on a card: finds the file that was prepared for them (docs/f405.md), finds
// where the last one ends, and writes frames behind it in blocks with a checksum each.
//
// For the board that joins it to the probe:
// - The struct, the ring and the frames' way to the card are in memory that the SPI's
//   DMA reaches. The ring holds what the card has not confirmed: 64 KB are 1.4 s of raw
//   and pose at 380 Hz (45 kB/s).
// - Call logbook_step() each turn of the main loop; it takes up to 20 us. Where it
//   returns true, turn again without sleeping. Otherwise the end of the SPI's exchange
//   wakes, or the tick, which must come every 10 ms.
// - A card is ready a second after it is found: the whole chain of its file is looked
//   at, so that nothing is ever written outside it.
// - Take all changes after each step and make events of them. CARD_READY is the one to
//   answer with logbook_open(), where messages are to be kept: at the start, when a
//   card comes back, when a probe begins to stream. The first thing put in must be a
//   hello.
// - LOG_ENDED reports that nothing more is stored, whatever ended it: stop putting. It
// comes
//   some milliseconds behind logbook_close(), a card's 250 ms at the worst, or a second
//   where it is at its end; then logbook_is_idle().
// - Once a second the first block of a run is read back before the run counts as kept,
//   and the one of a second ago, and the partition table, which a card that is smaller
//   than it says overwrites first.
// - A card that is pulled ends its recording. One that fails and comes back at once (a
//   second busy, a reset by itself) continues where it was.
#ifndef LOGBOOK_H
#define LOGBOOK_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/sdcard.h"
#include "core/wire/messages.h"

enum {
    LOGBOOK_CONTENT = 496,  // bytes of frames in a block
    LOGBOOK_CHANGES = 8,    // that wait to be taken
};

// Something that has happened to card or recording. `detail`: the block in the file; of
// LOG_STARTED and LOG_ENDED the recording.
struct logbook_change {
    uint8_t event;  // enum event: CARD_READY, CARD_FAULT, CARD_FULL, LOG_STARTED, ...
    uint8_t cause;  // enum cause
    int32_t detail;
};

struct logbook {
    struct sdcard card;
    uint8_t *ring;
    uint32_t size;
    uint32_t tail;  // of what the card has not confirmed, in the ring
    uint32_t used;
    uint32_t cut;        // bytes from the tail on that the run under way has taken
    uint32_t now_us;     // of the last step
    uint32_t since_us;   // a wait began
    uint32_t wait_us;    // and how long it lasts
    uint32_t oldest_us;  // no byte in the ring is older
    uint32_t cut_us;     // when the last block was cut

    // The volume and its file; blocks of the card.
    uint32_t volume;
    uint32_t volume_blocks;
    uint32_t fat;           // the first one
    uint32_t data;          // cluster 2
    uint32_t clusters_end;  // number behind the last cluster
    uint32_t cluster;       // that is looked at
    uint32_t left;          // blocks of the root, clusters of the file still to look at
    uint32_t file;
    uint32_t file_blocks;
    uint32_t card_id;
    uint8_t cluster_blocks;
    uint8_t block_in_cluster;

    // The search for the end: `low` is good, or 0; from `high` on nothing is.
    uint32_t low;
    uint32_t high;
    uint32_t probe;       // what is read
    uint32_t probes_end;  // behind the last to be read before that is believed to be it

    uint32_t next;  // block of the file to be written
    uint32_t crc;
    uint32_t proof;        // checksum of the block that the run under way began with
    uint32_t proved_us;    // when such a block was last read back
    uint32_t proved_next;  // that block, and its checksum; 0: none of the recording
    uint32_t proved_crc;
    uint32_t busy_worst_us;
    uint32_t told_slow_us;
    uint16_t place;  // bytes that the checksum has taken
    uint16_t cut_length;
    uint16_t recording;
    uint8_t phase;
    uint8_t state;       // enum card
    uint8_t told_cause;  // why the card can't be used, as told
    uint8_t end_cause;   // of the recording that is being closed
    uint8_t run;         // blocks of the run under way
    uint8_t singles;     // runs of one block to come, in search of a worn one
    uint8_t tries;       // of a block
    uint8_t left_out;    // blocks in a row
    uint8_t restarts;    // of the card, without a run between them
    bool is_summing;
    bool is_recording;
    bool is_closing;
    bool is_first;    // no block of the recording is on the card
    bool is_last;     // the block that was cut ends the recording
    bool is_drained;  // the block that was cut took all that there was
    bool has_told_slow;
    uint8_t changes_count;
    struct logbook_change changes[LOGBOOK_CHANGES];
};

// `size` is 2 KB at least. Looks for a card from the first step on.
void logbook_init(struct logbook *book, const struct spi_device *spi, uint8_t *ring,
                  uint32_t size);

// Moves everything on. True: call again at once, there is more to do.
bool logbook_step(struct logbook *book, uint32_t now_us);

// Begins a recording. False where the card is not ready for one.
bool logbook_open(struct logbook *book);
// Ends it: what was put in is written, and the last block says that it is the last.
// `cause` comes back in LOG_ENDED.
void logbook_close(struct logbook *book, enum cause cause);
// Keeps a frame, of which a zero is the last byte and the only one; whole, or not at
// all where there is no recording or no room.
bool logbook_put(struct logbook *book, const uint8_t *frame, uint8_t length);

// The oldest change that was not taken yet; false: there is none.
bool logbook_take_change(struct logbook *book, struct logbook_change *out);
// Nothing is being written, or will be without logbook_open(): power may go.
bool logbook_is_idle(const struct logbook *book);
// Fills in the fields of the card, and the recording.
void logbook_describe(const struct logbook *book, struct message_equipment *out);

#endif
