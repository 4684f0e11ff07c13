// SPDX-License-Identifier: MIT
// The RN-41 of rn41.h: UART, command mode, link and host.
#include "rn41.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "uart.h"

#define NEVER UINT64_MAX
#define MS UINT64_C(1000000)
#define SECOND (1000 * MS)
#define AIR_NS (5 * MS / 2)
// BC4, "Reset": between 1.5 and 4.0 ms after RST# is low; more than 5 is recommended.
#define RESET_NS (4 * MS)
#define PULSE_MIN_NS (5 * MS)

enum {
    PACKET = 75,  // bytes in AIR_NS: 240 kbit/s
    BUFFER = 2048,
    RTS_HIGH = BUFFER * 3 / 4,
    RTS_LOW = BUFFER / 2,
    OUT = 65536,    // taken by the caller
    LINE = 64,      // of a command
    ANSWER = 1024,  // X, the longest
    TEXT_MAX = 20,  // name, PIN (UG, SN and SP)
    STATUS_MAX = 8,
    SERIAL_MAX = 15,
    TIMER_LOCAL = 253,
    TIMER_REMOTE = 254,
    TIMER_BOTH = 255,
    MODE_DTR = 4,
    MODE_PAIR = 6,
};

struct settings {
    char name[TEXT_MAX + 1], pin[TEXT_MAX + 1], service[TEXT_MAX + 1];
    char status[STATUS_MAX + 1];  // empty: none
    char character;
    unsigned rate, mode, authentication, timer;
};

struct ring {
    uint8_t *bytes;
    size_t room, head, count;
};

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

    // Configuration characters held back, and the last byte heard.
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

// UG, SU: the first two characters choose.
static const struct {
    const char *name;
    uint32_t baud;
} rates[] = {
    {"1200", 1200},   {"2400", 2400},   {"4800", 4800},   {"9600", 9600},
    {"19.2", 19200},  {"28.8", 28800},  {"38.4", 38400},  {"57.6", 57600},
    {"115K", 115200}, {"230K", 230400}, {"460K", 460800}, {"921K", 921600},
};
enum { RATES = sizeof rates / sizeof *rates, FACTORY_RATE = 8 };

static const char *const modes[] = {"Slav", "Mstr", "Trig", "Auto",
                                    "DTR ", "Any ", "Pair"};
enum { MODES = sizeof modes / sizeof *modes };

static void complain(struct rn41_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

// Rings

static bool put(struct ring *ring, uint8_t byte) {
    if (ring->count == ring->room) {
        return false;
    }
    ring->bytes[(ring->head + ring->count) % ring->room] = byte;
    ring->count++;
    return true;
}

static bool take(struct ring *ring, uint8_t *byte) {
    if (ring->count == 0) {
        return false;
    }
    *byte = ring->bytes[ring->head];
    ring->head = (ring->head + 1) % ring->room;
    ring->count--;
    return true;
}

// Faults

static bool is_within(const struct rn41_chip *chip, enum rn41_chip_fault_kind kind) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct rn41_chip_fault *fault = &chip->faults[i];
        if (fault->kind == kind && chip->now >= fault->from_ns &&
            (fault->for_ns == 0 || chip->now - fault->from_ns < fault->for_ns)) {
            return true;
        }
    }
    return false;
}

static uint64_t next_edge(const struct rn41_chip *chip) {
    uint64_t next = NEVER;
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct rn41_chip_fault *fault = &chip->faults[i];
        const uint64_t edges[2] = {fault->from_ns,
                                   fault->for_ns == 0 ? NEVER
                                                      : fault->from_ns + fault->for_ns};
        for (unsigned edge = 0; edge < 2; edge++) {
            if (edges[edge] > chip->now && edges[edge] < next) {
                next = edges[edge];
            }
        }
    }
    return next;
}

// Out of the UART

static uint64_t frame_ns(const struct rn41_chip *chip) {
    return (UART_BITS * SECOND + rates[chip->rate].baud / 2) / rates[chip->rate].baud;
}

static void begin_sending(struct rn41_chip *chip) {
    if (chip->is_sending || chip->now < chip->next_at || chip->is_cts_high ||
        !chip->is_ready || is_within(chip, RN41_CHIP_DEAF) ||
        !take(&chip->to_uart, &chip->shift)) {
        return;
    }
    chip->is_sending = true;
    chip->sent_at = chip->now + frame_ns(chip);
}

static void send_text(struct rn41_chip *chip, const char *text) {
    for (; *text != '\0'; text++) {
        if (!put(&chip->to_uart, (uint8_t)*text)) {
            complain(chip, "more answers than its buffer takes");
        }
    }
    begin_sending(chip);
}

static void send_status(struct rn41_chip *chip, const char *text) {
    if (chip->used.status[0] != '\0') {
        send_text(chip, chip->used.status);
        send_text(chip, text);
        send_text(chip, "\r\n");
    }
}

// The link

static void follow_rts(struct rn41_chip *chip) {
    if (chip->to_air.count >= RTS_HIGH) {
        chip->is_full = true;
    } else if (chip->to_air.count <= RTS_LOW) {
        chip->is_full = false;
    }
}

static void break_link(struct rn41_chip *chip) {
    if (!chip->is_linked) {
        return;
    }
    chip->is_linked = false;
    chip->counters.lost_to_host += chip->to_air.count;
    chip->counters.lost_from_host += chip->from_host.count;
    chip->to_air.count = chip->from_host.count = 0;
    chip->air_at = chip->host_escape_at = NEVER;
    follow_rts(chip);
    send_status(chip, "DISCONNECT");
}

static void follow_link(struct rn41_chip *chip) {
    if (!chip->is_ready) {
        return;
    }
    const bool is_dropped = is_within(chip, RN41_CHIP_DROP);
    if (chip->is_linked && is_dropped) {
        break_link(chip);
        chip->link_from = chip->now;
    }
    const unsigned mode = chip->used.mode;
    const bool is_slave = mode == 0 || mode == MODE_DTR || mode == MODE_PAIR;
    if (!chip->is_linked && !is_dropped && !is_within(chip, RN41_CHIP_AWAY) &&
        is_slave && chip->now >= chip->link_from) {
        chip->is_linked = true;
        chip->counters.links++;
        send_status(chip, "CONNECT,0123456789AB,0");
    }
}

static void use_air(struct rn41_chip *chip) {
    if (chip->air_at == NEVER &&
        (chip->to_air.count > 0 || chip->from_host.count > 0)) {
        chip->air_at = chip->now + AIR_NS;
    }
}

static void exchange_packets(struct rn41_chip *chip) {
    uint8_t byte = 0;
    chip->air_at = NEVER;
    for (unsigned i = 0; i < PACKET && take(&chip->to_air, &byte); i++) {
        (void)put(&chip->host_out, byte);
        chip->counters.to_host++;
    }
    for (unsigned i = 0; i < PACKET; i++) {
        if (chip->to_uart.count == chip->to_uart.room ||
            !take(&chip->from_host, &byte)) {
            break;
        }
        if (chip->is_command) {
            chip->counters.lost_from_host++;
        } else {
            (void)put(&chip->to_uart, byte);
            chip->counters.from_host++;
        }
    }
    follow_rts(chip);
    begin_sending(chip);
    use_air(chip);
}

// Starts

static void factory_settings(struct rn41_chip *chip) {
    chip->stored = (struct settings){
        .pin = "1234",
        .service = "SPP",
        .character = '$',
        .rate = FACTORY_RATE,
        .authentication = 1,
        .timer = TIMER_BOTH,
    };
    (void)snprintf(chip->stored.name, sizeof chip->stored.name, "RNBT-%04X",
                   (unsigned)(chip->config.address & 0xFFFF));
}

// What is in its memory is gone.
static void stop(struct rn41_chip *chip) {
    struct rn41_chip_counters *counters = &chip->counters;
    chip->is_ready = chip->is_linked = chip->is_command = chip->is_sending = false;
    counters->lost_to_host += chip->to_air.count + chip->held;
    counters->lost_from_host += chip->from_host.count;
    chip->to_air.count = chip->from_host.count = chip->to_uart.count = 0;
    chip->waiting.count = 0;
    chip->held = chip->host_held = 0;
    chip->length = 0;
    chip->after = STAY;
    chip->boot_at = chip->air_at = chip->sent_at = NEVER;
    chip->answer_at = chip->escape_at = chip->host_escape_at = NEVER;
    follow_rts(chip);
}

static void restart(struct rn41_chip *chip) {
    stop(chip);
    chip->counters.resets++;
    chip->is_restarted = true;
    chip->boot_at = chip->now + chip->config.boot_ns;
}

static void boot(struct rn41_chip *chip) {
    chip->boot_at = NEVER;
    chip->used = chip->stored;
    chip->rate = chip->used.rate;
    chip->is_ready = true;
    chip->has_echo = false;
    chip->up_at = chip->now;
    chip->heard_at = chip->host_heard_at = NEVER;
    chip->link_from = chip->now + chip->config.host_ns;
    if (chip->used.mode != 0 && chip->used.mode != MODE_DTR &&
        chip->used.mode != MODE_PAIR) {
        complain(chip, "a master mode, which is not modelled");
    }
    if (chip->is_restarted) {
        send_status(chip, "REBOOT");
    }
}

// Data mode

static bool lets_in(const struct rn41_chip *chip, unsigned without_timeout) {
    const unsigned timer = chip->used.timer;
    if (timer >= 1 && timer < TIMER_LOCAL) {
        return chip->now - chip->up_at < timer * SECOND;
    }
    return timer == without_timeout || timer == TIMER_BOTH;
}

static void pass_on(struct rn41_chip *chip, uint8_t byte) {
    if (!chip->is_linked || !put(&chip->to_air, byte)) {
        chip->counters.lost_to_host++;
        return;
    }
    follow_rts(chip);
    use_air(chip);
}

static void pass_held(struct rn41_chip *chip) {
    for (; chip->held > 0; chip->held--) {
        pass_on(chip, (uint8_t)chip->used.character);
    }
    chip->escape_at = NEVER;
}

static void hear_data(struct rn41_chip *chip, uint8_t byte) {
    const bool was_quiet =
        chip->heard_at == NEVER || chip->now - chip->heard_at >= SECOND;
    chip->heard_at = chip->now;
    const bool is_character = byte == (uint8_t)chip->used.character &&
                              (!chip->is_linked || lets_in(chip, TIMER_LOCAL));
    if (!is_character || chip->held == 3 || (chip->held == 0 && !was_quiet)) {
        pass_held(chip);
        pass_on(chip, byte);
        return;
    }
    if (chip->held == 0) {
        chip->held_at = chip->now;
    }
    chip->held++;
    chip->escape_at =
        chip->held == 3 ? chip->now + chip->config.command_ns : chip->held_at + SECOND;
}

static void end_escape(struct rn41_chip *chip) {
    if (chip->held < 3) {
        pass_held(chip);
        return;
    }
    chip->held = 0;
    chip->escape_at = NEVER;
    chip->is_command = true;
    chip->length = 0;
    send_text(chip, "CMD\r\n");
}

// Command mode

// A line of the answer.
static void say(struct rn41_chip *chip, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

static void say(struct rn41_chip *chip, const char *format, ...) {
    const size_t at = strlen(chip->answer);
    va_list list;
    va_start(list, format);
    // NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): va_start is a line above
    (void)vsnprintf(chip->answer + at, ANSWER - at, format, list);
    va_end(list);
    const size_t end = strlen(chip->answer);
    (void)snprintf(chip->answer + end, ANSWER - end, "\r\n");
}

static const char *or_null(const char *text) {
    return text[0] == '\0' ? "NULL" : text;
}

static void say_basic(struct rn41_chip *chip) {
    const struct settings *stored = &chip->stored;
    say(chip, "***Settings***");
    say(chip, "BTA=%012" PRIX64, chip->config.address);
    say(chip, "BTName=%s", stored->name);
    say(chip, "Baudrt(SW4)=%s", rates[stored->rate].name);
    say(chip, "Mode  =%s", modes[stored->mode]);
    say(chip, "Authen=%u", stored->authentication);
    say(chip, "PinCod=%s", stored->pin);
    say(chip, "Bonded=0");
    say(chip, "Rem=NONE SET");
}

static void say_extended(struct rn41_chip *chip) {
    const struct settings *stored = &chip->stored;
    say(chip, "***ADVANCED Settings***");
    say(chip, "SrvName= %s", stored->service);
    say(chip, "SrvClass=0000");
    say(chip, "DevClass=1F00");
    say(chip, "InqWindw=0100");
    say(chip, "PagWindw=0100");
    say(chip, "CfgTimer=%u", stored->timer);
    say(chip, "StatuStr=%s", or_null(stored->status));
    say(chip, "HidFlags=200");
    say(chip, "DTRtimer=8");
    say(chip, "KeySwapr=0");
}

static void say_other(struct rn41_chip *chip) {
    say(chip, "***OTHER Settings***");
    say(chip, "Profile= SPP");
    say(chip, "CfgChar= %c", chip->stored.character);
    say(chip, "SniffEna=0");
    say(chip, "LowPower=0");
    say(chip, "TX Power=0");
    say(chip, "IOPorts= 0");
    say(chip, "IOValues=0");
    say(chip, "Sleeptmr=0");
    say(chip, "DebugMod=0");
    say(chip, "RoleSwch=0");
}

static void say_version(struct rn41_chip *chip) {
    say(chip, "Ver 6.15 04/26/2013");
    say(chip, "(c) Roving Networks");
}

static void do_get(struct rn41_chip *chip, char which) {
    const struct settings *stored = &chip->stored;
    switch (which) {
    case '$':
        say(chip, "%c", stored->character);
        break;
    case 'A':
        say(chip, "%u", stored->authentication);
        break;
    case 'B':
        say(chip, "%012" PRIX64, chip->config.address);
        break;
    case 'F':
        say(chip, "%s", chip->is_linked ? "0123456789AB" : "000000000000");
        break;
    case 'K':
        say(chip, "%d,0,0", chip->is_linked ? 1 : 0);
        break;
    case 'M':
        say(chip, "%s", modes[stored->mode]);
        break;
    case '-':
    case 'N':
        say(chip, "%s", stored->name);
        break;
    case 'O':
        say(chip, "%s", or_null(stored->status));
        break;
    case 'P':
        say(chip, "%s", stored->pin);
        break;
    case 'R':
        say(chip, "NONE SET");
        break;
    case 'S':
        say(chip, "%s", stored->service);
        break;
    case 'T':
        say(chip, "%u", stored->timer);
        break;
    case 'U':
        say(chip, "%s", rates[stored->rate].name);
        break;
    default:
        complain(chip, "a get command that is not modelled");
        say(chip, "?");
        break;
    }
}

static bool set_text(char *to, size_t longest, const char *text) {
    const size_t length = strlen(text);
    if (length == 0 || length > longest) {
        return false;
    }
    memcpy(to, text, length + 1);
    return true;
}

static bool set_number(unsigned *to, unsigned greatest, const char *text) {
    unsigned value = 0;
    const size_t length = strlen(text);
    for (size_t i = 0; i < length; i++) {
        if (text[i] < '0' || text[i] > '9' || i == 3) {
            return false;
        }
        value = 10 * value + (unsigned)(text[i] - '0');
    }
    if (length == 0 || value > greatest) {
        return false;
    }
    *to = value;
    return true;
}

static bool set_rate(unsigned *to, const char *text) {
    for (unsigned i = 0; i < RATES; i++) {
        if (strncmp(text, rates[i].name, 2) == 0) {
            *to = i;
            return true;
        }
    }
    return false;
}

static bool set_serialized(struct rn41_chip *chip, const char *text) {
    if (strlen(text) == 0 || strlen(text) > SERIAL_MAX) {
        return false;
    }
    (void)snprintf(chip->stored.name, sizeof chip->stored.name, "%.*s-%04X", SERIAL_MAX,
                   text, (unsigned)(chip->config.address & 0xFFFF));
    return true;
}

static bool set_status(struct settings *stored, const char *text) {
    if (strcmp(text, "Z") == 0 || strcmp(text, " ") == 0) {
        stored->status[0] = '\0';
        return true;
    }
    return set_text(stored->status, STATUS_MAX, text);
}

// 1 where it is taken, 0 where its value is wrong, -1 where there is no such setting.
static int set(struct rn41_chip *chip, char which, const char *text) {
    struct settings *stored = &chip->stored;
    unsigned value = 0;
    switch (which) {
    case '$':
        if (strlen(text) != 1) {
            return 0;
        }
        stored->character = text[0];
        return 1;
    case '-':
        return set_serialized(chip, text);
    case 'A':  // 3 is none (UG, SA)
        if (!set_number(&value, 4, text) || value == 3) {
            return 0;
        }
        stored->authentication = value;
        return 1;
    case 'F':
        if (strcmp(text, "1") != 0) {
            return 0;
        }
        factory_settings(chip);
        return 1;
    case 'M':
        return set_number(&stored->mode, MODES - 1, text);
    case 'N':
        return set_text(stored->name, TEXT_MAX, text);
    case 'O':
        return set_status(stored, text);
    case 'P':
        return set_text(stored->pin, TEXT_MAX, text);
    case 'S':
        return set_text(stored->service, TEXT_MAX, text);
    case 'T':
        return set_number(&stored->timer, TIMER_BOTH, text);
    case 'U':
        return set_rate(&stored->rate, text);
    default:
        complain(chip, "a setting that is not modelled");
        return -1;
    }
}

static void do_set(struct rn41_chip *chip, const char *line) {
    if (line[1] == '\0' || line[2] != ',') {
        say(chip, "ERR");
        return;
    }
    const int result = set(chip, (char)toupper((unsigned char)line[1]), line + 3);
    if (result == 1) {
        chip->counters.writes++;
    }
    say(chip, "%s", result == 1 ? "AOK" : result == 0 ? "ERR" : "?");
}

// U,<rate>,<parity>: until the next start (UG, "Change & action commands").
static void do_change(struct rn41_chip *chip, const char *line) {
    const char *parity = line[1] == ',' ? strchr(line + 2, ',') : NULL;
    if (parity == NULL || !set_rate(&chip->next_rate, line + 2)) {
        say(chip, "ERR");
        return;
    }
    if (toupper((unsigned char)parity[1]) != 'N' || parity[2] != '\0') {
        complain(chip, "parity, which is not modelled");
    }
    say(chip, "AOK");
    chip->after = CHANGE_RATE;
}

static void do_action(struct rn41_chip *chip, const char *line) {
    if (strcmp(line, "---") == 0) {
        say(chip, "END");
        chip->after = LEAVE;
    } else if (strcmp(line, "+") == 0) {
        chip->has_echo = !chip->has_echo;
        say(chip, "ECHO %s", chip->has_echo ? "ON" : "OFF");
    } else if (strcasecmp(line, "R,1") == 0) {
        say(chip, "Reboot!");
        chip->after = REBOOT;
    } else if (strcasecmp(line, "K,") == 0) {
        say(chip, "KILL");
        break_link(chip);
        chip->link_from = chip->now + chip->config.host_ns;
    } else if (line[0] != '\0' &&
               strchr("CFHIJLMOPQTWZ&", toupper((unsigned char)line[0]))) {
        complain(chip, "a command that is not modelled");
        say(chip, "?");
    } else {
        say(chip, "?");
    }
}

static void obey(struct rn41_chip *chip) {
    const char *line = chip->line;
    const uint64_t writes = chip->counters.writes;
    const char first = (char)toupper((unsigned char)line[0]);
    const bool is_single = line[0] != '\0' && line[1] == '\0';
    chip->counters.commands++;
    chip->answer[0] = '\0';
    if (is_single && (first == 'D' || first == 'E' || first == 'O')) {
        if (first == 'D') {
            say_basic(chip);
        } else if (first == 'E') {
            say_extended(chip);
        } else {
            say_other(chip);
        }
    } else if (is_single && first == 'X') {
        say_version(chip);
        say_basic(chip);
        say_extended(chip);
        say_other(chip);
    } else if (is_single && first == 'V') {
        say_version(chip);
    } else if (first == 'G' && strlen(line) == 2) {
        do_get(chip, (char)toupper((unsigned char)line[1]));
    } else if (first == 'S') {
        do_set(chip, line);
    } else if (first == 'U') {
        do_change(chip, line);
    } else {
        do_action(chip, line);
    }
    chip->answer_at = chip->now + (chip->counters.writes != writes ? 30 * MS : 5 * MS);
}

static void hear_command(struct rn41_chip *chip, uint8_t byte) {
    if (chip->answer_at != NEVER || chip->after != STAY) {
        if (!put(&chip->waiting, byte)) {
            complain(chip, "commands faster than it answers");
        }
        return;
    }
    if (byte == '\n' && chip->length == 0) {
        return;
    }
    if (chip->has_echo) {
        const char echo[2] = {(char)byte, '\0'};
        send_text(chip, echo);
    }
    if (byte == '\r') {
        chip->line[chip->length < LINE ? chip->length : LINE] = '\0';
        chip->length = 0;
        obey(chip);
    } else {
        if (chip->length < LINE) {
            chip->line[chip->length] = (char)byte;
            chip->length++;
        }
    }
}

static void leave(struct rn41_chip *chip) {
    uint8_t byte = 0;
    chip->is_command = false;
    chip->heard_at = chip->now;
    while (take(&chip->waiting, &byte)) {
        hear_data(chip, byte);
    }
}

// Once the answer is out.
static void finish_answer(struct rn41_chip *chip) {
    const enum after after = chip->after;
    if (after == STAY || chip->answer_at != NEVER || chip->is_sending ||
        chip->to_uart.count > 0) {
        return;
    }
    chip->after = STAY;
    if (after == REBOOT) {
        restart(chip);
        return;
    }
    if (after == CHANGE_RATE) {
        chip->rate = chip->next_rate;
    }
    leave(chip);
}

static void give_answer(struct rn41_chip *chip) {
    uint8_t byte = 0;
    chip->answer_at = NEVER;
    send_text(chip, chip->answer);
    while (chip->after == STAY && chip->answer_at == NEVER &&
           take(&chip->waiting, &byte)) {
        hear_command(chip, byte);
    }
}

// Time

uint64_t rn41_chip_next_event(const struct rn41_chip *chip) {
    const uint64_t moments[] = {
        chip->boot_at, chip->escape_at, chip->host_escape_at, chip->answer_at,
        chip->sent_at, chip->air_at,    next_edge(chip),
    };
    uint64_t next = NEVER;
    for (size_t i = 0; i < sizeof moments / sizeof *moments; i++) {
        next = moments[i] < next ? moments[i] : next;
    }
    if (chip->is_ready && !chip->is_linked && chip->link_from > chip->now &&
        chip->link_from < next) {
        next = chip->link_from;
    }
    if (chip->to_uart.count > 0 && chip->next_at > chip->now && chip->next_at < next) {
        next = chip->next_at;
    }
    const uint64_t reset_at = chip->low_from + RESET_NS;
    if (chip->is_reset_low && reset_at > chip->now && reset_at < next) {
        next = reset_at;
    }
    return next;
}

static void end_frame(struct rn41_chip *chip) {
    chip->sent_at = NEVER;
    chip->is_sending = false;
    chip->out_baud = rates[chip->rate].baud;
    (void)put(&chip->uart_out, chip->shift);
    // CTS is looked at before each byte, so the other side has its say first.
    chip->next_at = chip->now + 1;
    if (chip->is_linked) {
        use_air(chip);
    }
    finish_answer(chip);
}

static void do_resets(struct rn41_chip *chip) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (chip->faults[i].kind == RN41_CHIP_RESET && !chip->is_done[i] &&
            chip->now >= chip->faults[i].from_ns) {
            chip->is_done[i] = true;
            if (!chip->is_reset_low) {
                restart(chip);
            }
        }
    }
}

static void step(struct rn41_chip *chip) {
    if (chip->is_reset_low && chip->now == chip->low_from + RESET_NS) {
        stop(chip);
    }
    do_resets(chip);
    if (chip->boot_at <= chip->now) {
        boot(chip);
    }
    if (chip->escape_at <= chip->now) {
        end_escape(chip);
    }
    if (chip->host_escape_at <= chip->now) {
        chip->host_escape_at = NEVER;
        if (chip->is_linked && lets_in(chip, TIMER_REMOTE)) {
            complain(chip, "the host can take it into command mode");
        }
    }
    if (chip->answer_at <= chip->now) {
        give_answer(chip);
    }
    if (chip->sent_at <= chip->now) {
        end_frame(chip);
    }
    if (chip->air_at <= chip->now) {
        exchange_packets(chip);
    }
    follow_link(chip);
    begin_sending(chip);
}

void rn41_chip_advance(struct rn41_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = rn41_chip_next_event(chip);
        if (next > now_ns) {
            break;
        }
        chip->now = next > chip->now ? next : chip->now;
        step(chip);
    }
    chip->now = now_ns > chip->now ? now_ns : chip->now;
}

// The wires

void rn41_chip_receive(struct rn41_chip *chip, uint64_t now_ns, uint8_t byte,
                       uint32_t baud) {
    rn41_chip_advance(chip, now_ns);
    if (!chip->is_ready || is_within(chip, RN41_CHIP_DEAF)) {
        chip->counters.lost_to_host++;
        return;
    }
    const uint32_t own = rates[chip->rate].baud;
    bool has_stop = true;
    const uint8_t got = uart_sample(byte, baud, own, &has_stop);
    if (got != byte) {
        // A frame that begins within one that it believes to be receiving is no start.
        const uint64_t length = UART_BITS * SECOND / baud;
        const uint64_t start = now_ns > length ? now_ns - length : 0;
        if (start < chip->rx_busy) {
            return;
        }
        chip->rx_busy = start + (2 * UART_BITS - 1) * SECOND / (2 * (uint64_t)own);
    }
    if (chip->is_command) {
        hear_command(chip, got);
    } else {
        hear_data(chip, got);
    }
}

void rn41_chip_set_cts(struct rn41_chip *chip, uint64_t now_ns, bool is_high) {
    rn41_chip_advance(chip, now_ns);
    chip->is_cts_high = is_high;
    begin_sending(chip);
}

bool rn41_chip_take(struct rn41_chip *chip, uint8_t *byte, uint32_t *baud) {
    *baud = chip->out_baud;
    return take(&chip->uart_out, byte);
}

bool rn41_chip_is_sending(const struct rn41_chip *chip) {
    return chip->is_sending;
}

void rn41_chip_set_reset(struct rn41_chip *chip, uint64_t now_ns, bool is_low) {
    rn41_chip_advance(chip, now_ns);
    if (is_low == chip->is_reset_low) {
        return;
    }
    chip->is_reset_low = is_low;
    if (is_low) {
        chip->low_from = now_ns;
        return;
    }
    if (now_ns - chip->low_from < PULSE_MIN_NS) {
        complain(chip, "a reset pulse of less than 5 ms");
    }
    if (now_ns - chip->low_from >= RESET_NS) {
        restart(chip);
    }
}

int rn41_chip_rts(const struct rn41_chip *chip) {
    return !chip->is_ready ? -1 : chip->is_full ? 1 : 0;
}

int rn41_chip_pio2(const struct rn41_chip *chip) {
    return !chip->is_ready ? -1 : chip->is_linked ? 1 : 0;
}

// The host

size_t rn41_chip_host_room(const struct rn41_chip *chip) {
    return chip->is_linked ? chip->from_host.room - chip->from_host.count : 0;
}

void rn41_chip_host_write(struct rn41_chip *chip, uint64_t now_ns, uint8_t byte) {
    rn41_chip_advance(chip, now_ns);
    const bool was_quiet =
        chip->host_heard_at == NEVER || chip->now - chip->host_heard_at >= SECOND;
    if (!chip->is_linked || !put(&chip->from_host, byte)) {
        chip->counters.lost_from_host++;
        return;
    }
    chip->host_heard_at = chip->now;
    const bool is_character = byte == (uint8_t)chip->used.character;
    if (!is_character || (chip->host_held == 0 && !was_quiet)) {
        chip->host_held = 0;
    } else {
        chip->host_held++;
    }
    chip->host_escape_at = chip->host_held == 3 ? chip->now + SECOND : NEVER;
    use_air(chip);
}

bool rn41_chip_host_read(struct rn41_chip *chip, uint8_t *byte) {
    return take(&chip->host_out, byte);
}

// Life

struct rn41_chip_config rn41_chip_defaults(void) {
    return (struct rn41_chip_config){
        .address = UINT64_C(0x0006664F1A2C),  // 00-06-66 is Roving Networks
        .boot_ns = SECOND,
        .command_ns = 100 * MS,
        .host_ns = 2 * SECOND,
    };
}

static bool make(struct ring *ring, size_t room) {
    *ring = (struct ring){.bytes = malloc(room), .room = room};
    return ring->bytes != NULL;
}

struct rn41_chip *rn41_chip_new(const struct rn41_chip_config *config) {
    struct rn41_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    const bool has_all = make(&chip->to_air, BUFFER) && make(&chip->to_uart, BUFFER) &&
                         make(&chip->from_host, BUFFER) &&
                         make(&chip->waiting, 4 * LINE) && make(&chip->uart_out, OUT) &&
                         make(&chip->host_out, OUT);
    if (!has_all) {
        rn41_chip_free(chip);
        return NULL;
    }
    factory_settings(chip);
    stop(chip);
    chip->used = chip->stored;
    chip->rate = FACTORY_RATE;
    chip->boot_at = config->boot_ns;
    return chip;
}

void rn41_chip_free(struct rn41_chip *chip) {
    if (chip == NULL) {
        return;
    }
    enum { RINGS = 6 };
    struct ring *rings[RINGS] = {&chip->to_air,  &chip->to_uart,  &chip->from_host,
                                 &chip->waiting, &chip->uart_out, &chip->host_out};
    for (size_t i = 0; i < RINGS; i++) {
        free(rings[i]->bytes);
    }
    free(chip);
}

void rn41_chip_power_cycle(struct rn41_chip *chip, uint64_t now_ns) {
    rn41_chip_advance(chip, now_ns);
    restart(chip);
    chip->is_restarted = false;
}

bool rn41_chip_add_fault(struct rn41_chip *chip, const struct rn41_chip_fault *fault) {
    if (chip->fault_count == RN41_CHIP_FAULTS_MAX) {
        return false;
    }
    chip->faults[chip->fault_count++] = *fault;
    return true;
}

void rn41_chip_save(const struct rn41_chip *chip, char text[RN41_CHIP_TEXT]) {
    const struct settings *stored = &chip->stored;
    (void)snprintf(text, RN41_CHIP_TEXT,
                   "address=%012" PRIX64 "\nSN=%s\nSU=%.2s\nSM=%u\nSA=%u\nSP=%s\n"
                   "ST=%u\nSO=%s\nSS=%s\nS$=%c\n",
                   chip->config.address, stored->name, rates[stored->rate].name,
                   stored->mode, stored->authentication, stored->pin, stored->timer,
                   stored->status[0] == '\0' ? "Z" : stored->status, stored->service,
                   stored->character);
}

bool rn41_chip_load(struct rn41_chip *chip, const char *text) {
    while (*text != '\0') {
        const char *end = strchr(text, '\n');
        const size_t length = end == NULL ? strlen(text) : (size_t)(end - text);
        char line[LINE];
        if (length < 3 || length >= sizeof line) {
            return false;
        }
        memcpy(line, text, length);
        line[length] = '\0';
        text += length + (end == NULL ? 0 : 1);
        if (strncmp(line, "address=", 8) == 0) {
            char *rest = NULL;
            chip->config.address = strtoull(line + 8, &rest, 16);
            if (length != 20 || *rest != '\0') {
                return false;
            }
        } else if (line[0] != 'S' || line[2] != '=' || line[1] == 'F' ||
                   set(chip, line[1], line + 3) != 1) {
            return false;
        }
    }
    return true;
}

struct rn41_chip_counters rn41_chip_counters(const struct rn41_chip *chip) {
    return chip->counters;
}

const char *rn41_chip_complaint(const struct rn41_chip *chip) {
    return chip->complaint;
}
