// SPDX-License-Identifier: MIT
// Shared by the files of the RN-41's model. See ../rn41.h for the documents that UG,
// UM, DS and BC4 stand for.
#ifndef SIM_CHIPS_RN41_CHIP_H
#define SIM_CHIPS_RN41_CHIP_H

#include "../rn41.h"
#include "ring.h"

#define NEVER UINT64_MAX
#define MS UINT64_C(1000000)  // in nanoseconds
#define SECOND (1000 * MS)

enum {
    BUFFER = 2048,  // bytes to the air; to the UART
    LINE = 64,      // bytes of a command
    ANSWER = 1024,  // bytes of X, the longest
    TEXT_MAX = 20,  // name, PIN (UG, SN and SP)
    STATUS_MAX = 8,
    // Values of the configuration timer, and modes.
    TIMER_LOCAL = 253,
    TIMER_REMOTE = 254,
    TIMER_BOTH = 255,
    MODE_DTR = 4,
    MODE_PAIR = 6,
    RATES = 12,
    FACTORY_RATE = 8,
    MODES = 7,
};

// UG, SU: rates of the UART; the first two characters of a name choose.
struct rn41_rate {
    const char *name;
    uint32_t baud;
};
extern const struct rn41_rate rn41_chip_rates[RATES];
extern const char *const rn41_chip_modes[MODES];

struct settings {
    char name[TEXT_MAX + 1], pin[TEXT_MAX + 1], service[TEXT_MAX + 1];
    char status[STATUS_MAX + 1];  // empty: none
    char character;
    unsigned rate, mode, authentication, timer;
};

// What follows an answer that is out.
enum after { STAY, LEAVE, REBOOT, CHANGE_RATE };

struct rn41_chip {
    struct rn41_chip_config config;
    struct settings stored, used;
    uint64_t now;
    bool is_reset_low, is_cts_high;
    uint64_t low_from;

    uint64_t boot_at, up_at;  // ready then; since
    bool is_ready, is_restarted;
    unsigned rate;
    uint64_t rx_busy;  // with a frame of another rate

    bool is_linked, is_full;
    uint64_t link_from;
    uint64_t air_at;

    // Configuration characters held back, and the last byte received.
    unsigned held;
    uint64_t held_at, heard_at, escape_at;
    unsigned host_held;
    uint64_t host_heard_at, host_escape_at;

    bool is_command, has_echo;
    char line[LINE + 1];
    size_t length;
    char answer[ANSWER];
    uint64_t answer_at;
    enum after after;
    unsigned next_rate;

    bool is_sending;
    uint8_t shift;
    uint64_t sent_at, next_at;  // the next frame not before

    struct ring to_air, to_uart, from_host, waiting;  // waiting: for an answer's end
    struct ring uart_out, host_out;
    uint32_t out_baud;

    struct rn41_chip_fault faults[RN41_CHIP_FAULTS_MAX];
    bool is_done[RN41_CHIP_FAULTS_MAX];
    unsigned fault_count;
    struct rn41_chip_counters counters;
    const char *complaint;
};

// chip.c
// Keeps the first thing that was done against the documents.
void rn41_chip_complain(struct rn41_chip *chip, const char *what);
// Whether a fault of that kind is active.
bool rn41_chip_suffers(const struct rn41_chip *chip, enum rn41_chip_fault_kind kind);
// Restarts, boot_ns from now; its memory is lost.
void rn41_chip_restart(struct rn41_chip *chip);

// uart.c
// Sends the next byte that waits, where CTS and the faults allow it.
void rn41_chip_begin_sending(struct rn41_chip *chip);
void rn41_chip_end_frame(struct rn41_chip *chip);
void rn41_chip_send_text(struct rn41_chip *chip, const char *text);
// Sends a status string (UG, SO), where they are on.
void rn41_chip_send_status(struct rn41_chip *chip, const char *text);

// link.c
// RTS follows how full the buffer to the air is.
void rn41_chip_follow_rts(struct rn41_chip *chip);
// Connects or disconnects, as the time and the faults say.
void rn41_chip_follow_link(struct rn41_chip *chip);
void rn41_chip_break_link(struct rn41_chip *chip);
// Plans the next packet where there is something to send.
void rn41_chip_use_air(struct rn41_chip *chip);
void rn41_chip_exchange_packets(struct rn41_chip *chip);
// Whether the configuration timer lets a side into command mode: TIMER_LOCAL or
// TIMER_REMOTE.
bool rn41_chip_lets_in(const struct rn41_chip *chip, unsigned side);
// A byte on RX in data mode; the end of the silence that configuration characters need.
void rn41_chip_hear_data(struct rn41_chip *chip, uint8_t byte);
void rn41_chip_end_escape(struct rn41_chip *chip);

// command.c
// A byte on RX in command mode; the time of its answer; the answer's end.
void rn41_chip_hear_command(struct rn41_chip *chip, uint8_t byte);
void rn41_chip_give_answer(struct rn41_chip *chip);
void rn41_chip_finish_answer(struct rn41_chip *chip);

// settings.c
void rn41_chip_factory_settings(struct rn41_chip *chip);
// The number of a rate, of which the name begins so; false: there is none.
bool rn41_chip_set_rate(unsigned *to, const char *text);
// Stores a setting by its letter. 1 where it is taken, 0 where its value is wrong, -1
// where there is no such setting.
int rn41_chip_store(struct rn41_chip *chip, char which, const char *text);

#endif
