// SPDX-License-Identifier: MIT
// Settings: from the factory, changed by commands, kept in a file.
#include "chip.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SERIAL_MAX = 15 };  // bytes (UG, S-)

const struct rn41_rate rn41_chip_rates[RATES] = {
    {"1200", 1200},   {"2400", 2400},   {"4800", 4800},   {"9600", 9600},
    {"19.2", 19200},  {"28.8", 28800},  {"38.4", 38400},  {"57.6", 57600},
    {"115K", 115200}, {"230K", 230400}, {"460K", 460800}, {"921K", 921600},
};

const char *const rn41_chip_modes[] = {"Slav", "Mstr", "Trig", "Auto",
                                       "DTR ", "Any ", "Pair"};

void rn41_chip_factory_settings(struct rn41_chip *chip) {
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

bool rn41_chip_set_rate(unsigned *to, const char *text) {
    for (unsigned i = 0; i < RATES; i++) {
        if (strncmp(text, rn41_chip_rates[i].name, 2) == 0) {
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

int rn41_chip_store(struct rn41_chip *chip, char which, const char *text) {
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
        rn41_chip_factory_settings(chip);
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
        return rn41_chip_set_rate(&stored->rate, text);
    default:
        rn41_chip_complain(chip, "a setting that is not modelled");
        return -1;
    }
}

void rn41_chip_save(const struct rn41_chip *chip, char text[RN41_CHIP_TEXT]) {
    const struct settings *stored = &chip->stored;
    (void)snprintf(text, RN41_CHIP_TEXT,
                   "address=%012" PRIX64 "\nSN=%s\nSU=%.2s\nSM=%u\nSA=%u\nSP=%s\n"
                   "ST=%u\nSO=%s\nSS=%s\nS$=%c\n",
                   chip->config.address, stored->name,
                   rn41_chip_rates[stored->rate].name, stored->mode,
                   stored->authentication, stored->pin, stored->timer,
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
                   rn41_chip_store(chip, line[1], line + 3) != 1) {
            return false;
        }
    }
    return true;
}
