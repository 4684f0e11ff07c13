// SPDX-License-Identifier: MIT
// Shared by the programs of both virtual boards: options, scheduled events, the run in
// real time or at full speed, and the summary.
#ifndef SIM_RUN_RUN_H
#define SIM_RUN_RUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "cable.h"
#include "faults.h"
#include "motion.h"
#include "profile.h"

enum {
    RUN_EVENTS_MAX = 16384,
    RUN_WAITING_MAX = 8,
    RUN_LIST_MAX = 4096,  // of --press, and of --send
    RUN_MORE_MAX = 16,
};
#define RUN_NEVER UINT64_MAX

// The options that all boards have, for their usage texts: "usage: nano" RUN_OPTIONS.
#define RUN_OPTIONS                                                                    \
    " --image FILE.elf [--motion FILE|-]"                                              \
    " [--pty LINK | --record FILE]\n"                                                  \
    "            [--fast] [--seconds N] [--summary FILE] [--eeprom FILE]"              \
    " [--seed N]\n"                                                                    \
    "            [--clock-ppm N] [--clock-drift PPM_S] [--batch-ms N]"                 \
    " [--burst-ms N]\n"                                                                \
    "            [--now FILE] [--reset-on-open]\n"                                     \
    "            [--faults FILE] [--press START_US:END_US]... [--send US:HEX]...\n"

// A board's report at the end of a run.
struct run_report {
    uint64_t resets;         // without the first
    uint64_t memory_writes;  // to what it keeps without power
    uint64_t uart_overruns;
    uint64_t bus_transactions;
    uint32_t stack, flash, ram;      // bytes
    const char *firmware_complaint;  // null: none
    const char *sensor_complaint;
    bool has_card;
    uint64_t card_blocks, card_bad_crc, card_busy_worst_us;
    const char *card_complaint;
    // Further numbers that only some boards have, by their names in the summary.
    struct run_number {
        const char *name;
        uint64_t value;
    } more[RUN_MORE_MAX];
    unsigned more_count;
    bool has_radio;
    const char *radio_complaint;
    const char *crash;  // why the firmware can't continue
    uint32_t pc, sp;
};

struct run;

// A virtual board. Its time is in ticks since power came. `self` is the pointer in
// struct run.
struct run_board {
    const char *name;  // of the program, at the start of its messages
    const char *usage;
    const char *version;
    uint64_t ticks_per_us;
    const struct fault_kinds *(*fault_kinds)(const void *self);
    const char *memory;  // the message where --eeprom has the wrong size
    // Options of this board alone that take a path or a word; ends with a null name.
    // May be null.
    const struct run_path {
        const char *name;
        const char **value;
    } * paths;
    // Handles options that start no run, such as a self-test: the exit code, or -1
    // where it is no such option. May be null.
    int (*command)(char **rest);
    // Null, or which options don't go together. May be null.
    const char *(*check)(const void *self);

    // Loads the image into flash and switches power on. 0, or the exit code after a
    // message.
    int (*power_up)(void *self, struct run *run);
    // Runs until a tick. False once the processor can't continue.
    bool (*run)(void *self, uint64_t until);
    uint64_t (*now)(const void *self);
    uint64_t (*nanoseconds)(uint64_t tick);
    // The tick at which the device clock started, or RUN_NEVER.
    uint64_t (*clock_start)(const void *self);
    uint64_t (*asleep)(const void *self);    // ticks
    size_t (*line_count)(const void *self);  // bytes still on their way to the board
    bool (*send)(void *self, uint64_t from, uint8_t byte);
    void (*press)(void *self, bool is_down);
    // Applies FAULT_RESET, FAULT_BROWN_OUT or another that struct fault_kinds allows.
    void (*suffer)(void *self, const struct fault *fault);
    // False where the sensor has as many faults at this time as it can.
    bool (*add_chip_fault)(void *self, const struct chip_fault *fault);
    void (*add_card_fault)(void *self, const struct card_fault *fault);  // may be null
    // The memory that survives power: leaves it as a power cut would now; its bytes.
    void (*cut_memory)(void *self);
    uint8_t *(*memory_bytes)(void *self, size_t *size);
    void (*pause)(void *self, uint64_t at);  // stop run() there at the latest
    void (*report)(void *self, struct run_report *report);
    bool (*finish)(void *self);  // writes the board's own files. May be null.

    // For a profile: addresses of the image's code; starts reporting instructions to
    // the profile; time so far.
    uint32_t code_start, code_size;
    void (*watch)(void *self, struct profile *profile);
    struct profile_time (*profile_now)(const void *self);
};

enum run_event_kind {
    EVENT_PRESS,
    EVENT_RELEASE,
    EVENT_CHIP_FAULT,
    EVENT_FAULT,
    EVENT_POWER_CUT
};

struct run_event {
    uint64_t tick;
    enum run_event_kind kind;
    const struct fault *fault;
};

struct run_options {
    const char *image, *motion, *pty, *record, *summary, *memory, *faults;
    const char *profile;
    const char *now;  // the run's time is kept here; see run_main()
    bool is_fast;
    bool resets_on_open;        // the cable's opening resets the board, as an Arduino's
    double seconds;             // 0: no limit
    double clock_ppm, drift;    // how fast its clock is; growth of that, ppm a second
    double batch_ms, burst_ms;  // how its bytes are held back; see is_held()
    uint64_t seed;
    struct {
        uint64_t from_us, to_us;
    } presses[RUN_LIST_MAX];
    unsigned press_count;
    struct {
        uint64_t at_us;
        const char *hex;
    } sends[RUN_LIST_MAX];
    unsigned send_count;
};

struct run {
    const struct run_board *board;
    void *self;
    struct run_options options;
    struct motion motion;
    struct cable *cable;
    struct profile *profile;  // null: none is asked for
    FILE *record;
    struct faults faults;
    struct run_event events[RUN_EVENTS_MAX];  // the next one last
    unsigned event_count;
    int64_t power_ns;  // the host's time when power came; 0: not paced
    int64_t pace_ns;   // wall clock at which power would have come without delays
    _Atomic int64_t *now_ns;  // the file of --now. Null: the host has the wall clock
    uint8_t inbox[256];       // read from the cable at inbox_ns, the host's time
    size_t inbox_count;
    int64_t inbox_ns;
    bool is_scheduled;
    bool is_power_cut;
    bool is_over;
    bool is_misused;  // it ended because it can't do what its options say

    uint64_t bytes, frames, chunk;
    uint64_t data_ready;  // edges of the pin
    // The edge that a sample belongs to is the last one before the START of its burst.
    // From the burst's STOP on the sample waits for its work, in order.
    uint64_t burst_edge, last_edge, work_edge, worked_edge;
    uint64_t waiting[RUN_WAITING_MAX];
    unsigned waiting_count;
    uint64_t waiting_asleep;  // ticks slept when the last one came
    bool is_working;
    uint64_t mark_cycle, first_mark_tick, first_mark_asleep;
    uint64_t samples, late, cycles_sum, cycles_worst;
};

// Runs the board as its arguments say. Returns the exit code.
//
// With --now, the file holds the time that the run has come to, every 0.1 ms: ns
// as int64_t in this machine's byte order, from the wall clock's time when power came.
// A program that maps it and takes it for its clock sees a probe in real time, however
// often a busy machine makes the run stand still.
int run_main(struct run *run, const struct run_board *board, void *self,
             char **arguments);
// Fills the memory that survives power from the file of --eeprom, if given; for the
// board's power_up(). 0, or the exit code after a message.
int run_load_memory(struct run *run);
// Of a board's option --ready: wire (also where it is null) or none.
bool run_has_ready(const char *ready);
// What is wrong with it, or null.
const char *run_check_ready(const char *ready);
// Prints one line about a mistake in a file. Returns 2, the exit code.
int run_complain(const struct run *run, const char *path, const char *what);
// The same for an option, followed by the usage text.
int run_usage(const struct run *run, const char *what, const char *which);

// Adds a number to report->more.
void run_add_number(struct run_report *report, const char *name, uint64_t value);

// What the board tells while it runs, in the form of the machines' callbacks; the
// context is the struct run. A byte has left it; the data-ready pin has risen; on the
// sensor's bus is a START, or a transaction is complete; write number n to what
// survives power, or to a block of its card, has begun; it has been reset.
void run_on_byte(void *context, uint8_t byte);
void run_on_data_ready(void *context);
void run_on_bus(void *context, bool is_start);
void run_on_memory_write(void *context, uint64_t number);
void run_on_card_write(void *context, uint64_t number);
void run_on_reset(void *context);
// Work on a sample begins or is done, at that tick and that cycle of the processor.
void run_on_mark(void *context, uint64_t tick, uint64_t cycle, bool is_begin);

#endif
