// SPDX-License-Identifier: MIT
// Reads the list of faults. Knows only as much of JSON as that takes.
#include "faults.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const chip_kinds[] = {
    [CHIP_FAULT_NACK] = "nack",
    [CHIP_FAULT_STUCK_SDA] = "stuck_sda",
    [CHIP_FAULT_NO_DATA_READY] = "no_data_ready",
    [CHIP_FAULT_WRONG_WHO_AM_I] = "wrong_who_am_i",
    [CHIP_FAULT_NO_MAG] = NULL,  // each board has its own name
    [CHIP_FAULT_GYR_SELF_TEST] = "gyr_self_test",
    [CHIP_FAULT_ACC_SELF_TEST] = "acc_self_test",
    [CHIP_FAULT_FROZEN] = "frozen",
    [CHIP_FAULT_REGISTER_FLIP] = "register_flip",
    [CHIP_FAULT_BROWN_OUT] = "sensor_brown_out",
    [CHIP_FAULT_MAG_HUNG] = "mag_hung",
    [CHIP_FAULT_MAG_IDLE] = "mag_idle",
};

// Faults of every board.
static const struct fault_kind board_kinds[] = {
    {"reset", FAULT_RESET, 0},
    {"brown_out", FAULT_BROWN_OUT, 0},
    {"power_cut", FAULT_POWER_CUT, 0},
};

static bool fail(struct faults *faults, const char *format, ...) {
    va_list list;
    va_start(list, format);
    (void)vsnprintf(faults->problem, sizeof faults->problem, format, list);
    va_end(list);
    return false;
}

static const char *skip(const char *at) {
    while (isspace((unsigned char)*at)) {
        at++;
    }
    return at;
}

static bool read_word(struct faults *faults, const char **at, char *word, size_t room) {
    const char *from = skip(*at);
    const char *end = *from == '"' ? strchr(from + 1, '"') : NULL;
    if (end == NULL || (size_t)(end - from) > room) {
        return fail(faults, "a short word in quotes is missing at: %.20s", from);
    }
    const size_t length = (size_t)(end - from) - 1;
    memcpy(word, from + 1, length);
    word[length] = '\0';
    *at = skip(end + 1);
    return true;
}

static bool set_kind(struct faults *faults, struct fault *fault, const char *kind) {
    const struct fault_kinds *kinds = faults->kinds;
    for (size_t i = 0; i < sizeof chip_kinds / sizeof *chip_kinds; i++) {
        const char *name = i == CHIP_FAULT_NO_MAG ? kinds->no_mag : chip_kinds[i];
        const bool is_known = i < CHIP_FAULT_MAG_HUNG || kinds->has_aux_bus;
        if (is_known && strcmp(kind, name) == 0) {
            fault->target = FAULT_CHIP;
            fault->chip.kind = (enum chip_fault_kind)i;
            return true;
        }
    }
    for (unsigned i = 0; i < kinds->card_count; i++) {
        if (strcmp(kind, kinds->card[i]) == 0) {
            fault->target = FAULT_CARD;
            fault->card.kind = i;
            return true;
        }
    }
    enum { SHARED = sizeof board_kinds / sizeof *board_kinds };
    for (unsigned i = 0; i < SHARED + kinds->own_count; i++) {
        const struct fault_kind *known =
            i < SHARED ? &board_kinds[i] : &kinds->own[i - SHARED];
        if (strcmp(kind, known->name) == 0) {
            fault->target = known->target;
            fault->radio = known->radio;
            return true;
        }
    }
    return fail(faults, "no such kind of fault: %s", kind);
}

// Sets a key of a card's fault. False: it is no such key.
static bool set_card_number(const struct faults *faults, struct fault *fault,
                            const char *name, uint64_t value) {
    if (faults->kinds->card_count == 0) {
        return false;
    }
    if (strcmp(name, "card_write") == 0) {
        fault->card_write = value;
    } else if (strcmp(name, "card_writes") == 0) {
        fault->card.count = value;
    } else if (strcmp(name, "block") == 0) {
        fault->card.block = value;
    } else if (strcmp(name, "blocks") == 0) {
        fault->card.blocks = value;
    } else if (strcmp(name, "ms") == 0) {
        fault->card.ms = value > UINT32_MAX ? UINT32_MAX : (uint32_t)value;
    } else {
        return false;
    }
    return true;
}

// Fills in the defaults of a card's fault. False: a key is missing that has none.
static bool complete_card(struct fault *fault) {
    enum { SLOW_MS = 250, VALUE_MAX = 2 };
    struct card_fault *card = &fault->card;
    card->for_ns = fault->chip.for_ns;
    card->value = fault->chip.value;
    card->after_ns = fault->after_us * 1000;
    card->first = fault->card_write;
    if (card->first > 0 && card->count == 0) {
        card->count = 1;
    }
    if (card->ms == 0) {
        card->ms = SLOW_MS;
    }
    if (card->blocks == 0) {
        card->blocks = 1;
    }
    return fault->target != FAULT_CARD || card->value <= VALUE_MAX;
}

static bool set_number(struct faults *faults, struct fault *fault, const char *name,
                       uint64_t value) {
    const bool is_byte = strcmp(name, "byte") == 0 || strcmp(name, "clocks") == 0 ||
                         strcmp(name, "reg") == 0 || strcmp(name, "value") == 0;
    const bool is_mv = strcmp(name, "mv") == 0 || strcmp(name, "to_mv") == 0;
    if (is_byte && value > UINT8_MAX) {
        return fail(faults, "%s is above 255", name);
    }
    if (is_mv && value > FAULT_MV_MAX) {
        return fail(faults, "%s is above %d", name, FAULT_MV_MAX);
    }
    if (set_card_number(faults, fault, name, value)) {
        return true;
    }
    if (strcmp(name, "die") == 0 && faults->kinds->has_dies) {
        if (value != 1 && value != 2) {
            return fail(faults, "die is neither 1 nor 2");
        }
        fault->chip.die = (uint8_t)value;
    } else if (strcmp(name, "at_us") == 0) {
        fault->at_us = value;
    } else if (strcmp(name, "for_us") == 0) {
        fault->chip.for_ns = value * 1000;
    } else if (strcmp(name, "after_us") == 0) {
        fault->after_us = value;
    } else if (strcmp(name, "write") == 0) {
        fault->write = value;
    } else if (strcmp(name, "transaction") == 0) {
        fault->chip.first = value;
        if (fault->chip.transactions == 0) {
            fault->chip.transactions = 1;
        }
    } else if (strcmp(name, "transactions") == 0) {
        fault->chip.transactions = value;
    } else if (strcmp(name, "byte") == 0) {
        fault->chip.at_byte = (uint8_t)value;
    } else if (strcmp(name, "clocks") == 0) {
        fault->chip.clocks = (uint8_t)value;
    } else if (strcmp(name, "reg") == 0) {
        fault->chip.reg = (uint8_t)value;
    } else if (strcmp(name, "value") == 0) {
        fault->chip.value = (uint8_t)value;
    } else if (strcmp(name, "mv") == 0) {
        fault->mv = (uint32_t)value;
    } else if (strcmp(name, "to_mv") == 0) {
        fault->to_mv = (uint32_t)value;
        fault->has_to_mv = true;
    } else {
        return fail(faults, "no such key: %s", name);
    }
    return true;
}

static bool read_fault(struct faults *faults, const char **at, struct fault *fault) {
    bool has_kind = false;
    memset(fault, 0, sizeof *fault);
    if (**at != '{') {
        return fail(faults, "an object in braces is missing at: %.20s", *at);
    }
    do {
        char name[24];
        (*at)++;
        if (!read_word(faults, at, name, sizeof name)) {
            return false;
        }
        if (**at != ':') {
            return fail(faults, "a colon is missing after %s", name);
        }
        *at = skip(*at + 1);
        if (strcmp(name, "kind") == 0) {
            char kind[24];
            has_kind = true;
            if (!read_word(faults, at, kind, sizeof kind) ||
                !set_kind(faults, fault, kind)) {
                return false;
            }
        } else {
            char *end = NULL;
            const uint64_t value = strtoull(*at, &end, 10);
            if (end == *at || **at == '-' || *end == '.' || *end == 'e') {
                return fail(faults, "%s is no whole number of 0 or more", name);
            }
            *at = skip(end);
            if (!set_number(faults, fault, name, value)) {
                return false;
            }
        }
    } while (**at == ',');
    if (**at != '}') {
        return fail(faults, "a closing brace is missing at: %.20s", *at);
    }
    *at = skip(*at + 1);
    if (!complete_card(fault)) {
        return fail(faults, "the value of a card's fault is above 2");
    }
    return has_kind || fail(faults, "a fault has no kind");
}

// The chips accept only a few faults that stay listed for the whole run.
static bool are_few(struct faults *faults, enum fault_target target,
                    const char *whose) {
    unsigned count = 0;
    for (unsigned i = 0; i < faults->count; i++) {
        count += faults->list[i].target == target;
    }
    return count <= FAULTS_RARE_MAX ||
           fail(faults, "more than %d faults of the %s", FAULTS_RARE_MAX, whose);
}

static bool parse(struct faults *faults, const char *text) {
    const char *at = skip(text);
    if (*at != '[') {
        return fail(faults, "a list in brackets is missing");
    }
    at = skip(at + 1);
    while (*at != ']') {
        if (faults->count == FAULTS_MAX) {
            return fail(faults, "more than %d faults", FAULTS_MAX);
        }
        if (!read_fault(faults, &at, &faults->list[faults->count])) {
            return false;
        }
        faults->count++;
        if (*at == ',') {
            at = skip(at + 1);
        } else if (*at != ']') {
            return fail(faults, "a comma or bracket is missing at: %.20s", at);
        }
    }
    return are_few(faults, FAULT_CARD, "card") && are_few(faults, FAULT_RADIO, "radio");
}

const struct fault_kinds *faults_of_module(const char *name) {
    static const struct fault_kinds mpu9250 = {.no_mag = "no_ak8963",
                                               .has_aux_bus = true};
    static const struct fault_kinds lsm6dsox = {.no_mag = "no_mag", .has_dies = true};
    return name == NULL || strcmp(name, "mpu9250") == 0 ? &mpu9250 : &lsm6dsox;
}

bool faults_load(struct faults *faults, const char *path,
                 const struct fault_kinds *kinds) {
    memset(faults, 0, sizeof *faults);
    faults->kinds = kinds;
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return fail(faults, "can't be opened");
    }
    static char text[1 << 20];
    const size_t length = fread(text, 1, sizeof text - 1, file);
    (void)fclose(file);
    text[length] = '\0';
    return parse(faults, text);
}
