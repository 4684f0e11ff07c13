// SPDX-License-Identifier: MIT
// A model of an SD card in SPI mode, byte by byte on the wire, written from the
// specification. The virtual boards and the driver's tests use it; it depends on no
// emulator and no driver.
//
// Document: SD = SD Specifications, Part 1, Physical Layer Simplified Specification,
// version 4.10. Cards of standard capacity (SDSC: addresses in bytes, CSD version 1)
// and of high capacity (SDHC: addresses in blocks of 512 bytes, CSD version 2).
//
// Time is an argument, in nanoseconds since power came, and never goes back. The
// content is a file, which may be sparse, read and written in place. Blocks that the
// card has acknowledged as written are in it; blocks that it has only accepted may not
// be yet.
//
// The model follows the document; open points are drawn at
// random from the seed:
// - gaps before an answer, a data token and busy, within their limits (SD 7.5.4); the
//   bits that may be anything in a data response, after CMD12, as busy ends, and the
//   first one after selection while busy
// - how long initialisation, reading and programming take: 20 to 300 ms; 60 to 400 us,
//   in a run of blocks 2 to 30 us; programming 0.3 to 2 ms, a block of a run that only
//   goes to the buffer 5 to 60 us, one in 200 of all 4 to 40 ms
// - after a loss of power: blocks are stored whose busy is over, or whose run was
//   stopped and is no longer busy. The last 16 blocks of a run that is under way may
//   have been programmed in any order, one of them torn. A torn block begins with new
//   data, followed by the old data, erased flash or noise, or it is all old.
// - which blocks that ACMD23 announced and that never came are erased
// A run that is interrupted (deselected, or the host is reset) is programmed as if it
// were stopped, except for the block that was under way.
//
// These break the document's rules and are reported (sdcard_chip_complaint): a clock
// above 400 kHz before the card is ready, or above 25 MHz after that; less than 1 ms or
// 74 clocks before CMD0; no pause of a byte where one is required (NRC, NWR);
// deselecting within a transfer; a command while the card is busy or another command is
// under way; whatever is not modelled.
//
// Not modelled: the SD bus, voltages, password, write protection, CMD6, CMD27 and
// CMD56; damage to blocks that were there before. Reading a torn block fails on some
// cards; here it returns what is there.
#ifndef SIM_CHIPS_SDCARD_H
#define SIM_CHIPS_SDCARD_H

#include <stdbool.h>
#include <stdint.h>

enum { SDCARD_CHIP_BLOCK = 512, SDCARD_CHIP_BUFFER = 16 };  // bytes; blocks

enum sdcard_chip_kind { SDCARD_CHIP_BY_SIZE, SDCARD_CHIP_SDSC, SDCARD_CHIP_SDHC };

struct sdcard_chip_config {
    const char *image;           // a file of a multiple of 512 bytes
    enum sdcard_chip_kind kind;  // by size: SDSC up to 2 GB
    bool is_version_1;           // an SDSC of version 1.x: without CMD8
    uint64_t seed;
    // Called when programming of an accepted block begins, with its number among all
    // blocks that came, from 1. May be null.
    void (*on_block)(void *context, uint64_t number);
    void *context;
};

enum sdcard_chip_fault_kind {
    SDCARD_CHIP_PULLED,  // out of its socket; then in again, which is power-up
    SDCARD_CHIP_SLOW,    // each busy that begins lasts `ms`
    SDCARD_CHIP_CRC,     // data response: CRC error
    SDCARD_CHIP_ERROR,   // data response: write error
    SDCARD_CHIP_WORN,    // of `blocks` from `block` on: `value` is the kind
    SDCARD_CHIP_DEAD,    // answers nothing, takes nothing
};

enum sdcard_chip_wear {
    SDCARD_CHIP_REFUSES,     // data response: write error
    SDCARD_CHIP_KEEPS,       // accepts, but keeps the old contents
    SDCARD_CHIP_UNREADABLE,  // reading ends in an error token
};

// Active for a span of time, or, where count is not 0, for so many of the data blocks
// that come, from number `first` (the first one ever is 1); WORN for a span alone.
// Where count is not 0, the span of PULLED and DEAD begins after_ns into the
// programming of block `first`.
struct sdcard_chip_fault {
    enum sdcard_chip_fault_kind kind;
    uint64_t from_ns;
    uint64_t for_ns;  // 0: for ever
    uint64_t first;
    uint64_t count;
    uint64_t after_ns;
    uint64_t block;
    uint64_t blocks;
    uint32_t ms;
    enum sdcard_chip_wear wear;
};

enum { SDCARD_CHIP_FAULTS_MAX = 32 };

struct sdcard_chip;

// A card whose power comes at time 0. Null with *problem saying what is wrong.
struct sdcard_chip *sdcard_chip_new(const struct sdcard_chip_config *config,
                                    const char **problem);
// Closes the file as it stands; see sdcard_chip_finish().
void sdcard_chip_free(struct sdcard_chip *chip);

// False where there is no room for another fault.
bool sdcard_chip_add_fault(struct sdcard_chip *chip,
                           const struct sdcard_chip_fault *fault);
void sdcard_chip_clear_faults(struct sdcard_chip *chip);

// Lets time pass; every other function with a time does so first.
void sdcard_chip_advance(struct sdcard_chip *chip, uint64_t now_ns);
// The wire, from the host's side: CS, and a byte each way that has just gone over at
// that rate. An absent card leaves MISO to its pull-up.
void sdcard_chip_select(struct sdcard_chip *chip, uint64_t now_ns, bool is_selected);
uint8_t sdcard_chip_exchange(struct sdcard_chip *chip, uint64_t now_ns,
                             uint32_t clock_hz, uint8_t byte);
// The host is reset, amid whatever: no complaint of that.
void sdcard_chip_host_reset(struct sdcard_chip *chip, uint64_t now_ns);

// Power fails and is back at once; fails permanently; or stays until everything is
// programmed.
void sdcard_chip_power_cycle(struct sdcard_chip *chip, uint64_t now_ns);
void sdcard_chip_cut(struct sdcard_chip *chip, uint64_t now_ns);
void sdcard_chip_finish(struct sdcard_chip *chip, uint64_t now_ns);

// Its counters: its size in blocks, blocks accepted, CRCs found wrong, the longest
// busy; whether it is busy; and the first thing the host did against the document
// (null: nothing).
uint64_t sdcard_chip_blocks(const struct sdcard_chip *chip);
uint64_t sdcard_chip_written(const struct sdcard_chip *chip);
uint64_t sdcard_chip_bad_crc(const struct sdcard_chip *chip);
uint64_t sdcard_chip_busy_worst_ns(const struct sdcard_chip *chip);
bool sdcard_chip_is_busy(const struct sdcard_chip *chip);
const char *sdcard_chip_complaint(const struct sdcard_chip *chip);

#endif
