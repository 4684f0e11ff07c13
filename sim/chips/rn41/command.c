// SPDX-License-Identifier: MIT
// Command mode: lines, answers, the commands (UG).
#include "chip.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

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
    say(chip, "Baudrt(SW4)=%s", rn41_chip_rates[stored->rate].name);
    say(chip, "Mode  =%s", rn41_chip_modes[stored->mode]);
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
        say(chip, "%s", rn41_chip_modes[stored->mode]);
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
        say(chip, "%s", rn41_chip_rates[stored->rate].name);
        break;
    default:
        rn41_chip_complain(chip, "a get command that is not modelled");
        say(chip, "?");
        break;
    }
}

static void do_set(struct rn41_chip *chip, const char *line) {
    if (line[1] == '\0' || line[2] != ',') {
        say(chip, "ERR");
        return;
    }
    const int result =
        rn41_chip_store(chip, (char)toupper((unsigned char)line[1]), line + 3);
    if (result == 1) {
        chip->counters.writes++;
    }
    say(chip, "%s", result == 1 ? "AOK" : result == 0 ? "ERR" : "?");
}

// U,<rate>,<parity>: until the next start (UG, "Change & action commands").
static void do_change(struct rn41_chip *chip, const char *line) {
    const char *parity = line[1] == ',' ? strchr(line + 2, ',') : NULL;
    if (parity == NULL || !rn41_chip_set_rate(&chip->next_rate, line + 2)) {
        say(chip, "ERR");
        return;
    }
    if (toupper((unsigned char)parity[1]) != 'N' || parity[2] != '\0') {
        rn41_chip_complain(chip, "parity, which is not modelled");
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
        rn41_chip_break_link(chip);
        chip->link_from = chip->now + chip->config.host_ns;
    } else if (line[0] != '\0' &&
               strchr("CFHIJLMOPQTWZ&", toupper((unsigned char)line[0]))) {
        rn41_chip_complain(chip, "a command that is not modelled");
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

void rn41_chip_hear_command(struct rn41_chip *chip, uint8_t byte) {
    if (chip->answer_at != NEVER || chip->after != STAY) {
        if (!ring_put(&chip->waiting, byte)) {
            rn41_chip_complain(chip, "commands faster than it answers");
        }
        return;
    }
    if (byte == '\n' && chip->length == 0) {
        return;
    }
    if (chip->has_echo) {
        const char echo[2] = {(char)byte, '\0'};
        rn41_chip_send_text(chip, echo);
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
    while (ring_take(&chip->waiting, &byte)) {
        rn41_chip_hear_data(chip, byte);
    }
}

void rn41_chip_finish_answer(struct rn41_chip *chip) {
    const enum after after = chip->after;
    if (after == STAY || chip->answer_at != NEVER || chip->is_sending ||
        chip->to_uart.count > 0) {
        return;
    }
    chip->after = STAY;
    if (after == REBOOT) {
        rn41_chip_restart(chip);
        return;
    }
    if (after == CHANGE_RATE) {
        chip->rate = chip->next_rate;
    }
    leave(chip);
}

void rn41_chip_give_answer(struct rn41_chip *chip) {
    uint8_t byte = 0;
    chip->answer_at = NEVER;
    rn41_chip_send_text(chip, chip->answer);
    while (chip->after == STAY && chip->answer_at == NEVER &&
           ring_take(&chip->waiting, &byte)) {
        rn41_chip_hear_command(chip, byte);
    }
}
