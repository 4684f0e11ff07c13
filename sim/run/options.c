// SPDX-License-Identifier: MIT
// The options of a virtual board; see options.h.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "options.h"

int run_usage(const struct run *run, const char *what, const char *which) {
    (void)fprintf(stderr, "%s: %s%s%s\n%s", run->board->name, what,
                  which == NULL ? "" : " ", which == NULL ? "" : which,
                  run->board->usage);
    return 2;
}

int run_complain(const struct run *run, const char *path, const char *what) {
    (void)fprintf(stderr, "%s: %s %s\n", run->board->name, path, what);
    return 2;
}

static bool parse_number(const char *text, double *value) {
    char *end = NULL;
    *value = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*value) && *value >= 0.0;
}

static bool parse_signed(const char *text, double *value) {
    const bool is_negative = text[0] == '-';
    const bool good = parse_number(text + is_negative, value);
    *value = is_negative ? -*value : *value;
    return good;
}

static bool parse_span(const char *text, uint64_t *from, uint64_t *to) {
    char *end = NULL;
    *from = strtoull(text, &end, 10);
    if (end == text || *end != ':' || text[0] == '-') {
        return false;
    }
    const char *second = end + 1;
    *to = strtoull(second, &end, 10);
    return end != second && *end == '\0' && *to > *from;
}

int run_hex_digit(char digit) {
    if (digit >= '0' && digit <= '9') {
        return digit - '0';
    }
    const char lower = (char)(digit | 0x20);
    return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

static bool parse_send(const char *text, uint64_t *at_us, const char **hex) {
    char *end = NULL;
    *at_us = strtoull(text, &end, 10);
    if (end == text || *end != ':' || text[0] == '-') {
        return false;
    }
    *hex = end + 1;
    const size_t length = strlen(*hex);
    for (size_t i = 0; i < length; i++) {
        if (run_hex_digit((*hex)[i]) < 0) {
            return false;
        }
    }
    return length > 0 && length % 2 == 0;
}

static bool set_path(const struct run_path *paths, const char *name,
                     const char *value) {
    for (; paths != NULL && paths->name != NULL; paths++) {
        if (strcmp(name, paths->name) == 0) {
            *paths->value = value;
            return true;
        }
    }
    return false;
}

// Sets an option that takes a value. Null, or what is wrong with the value.
static const char *set_option(struct run *run, const char *name, const char *value) {
    struct run_options *options = &run->options;
    const struct run_path paths[] = {
        {"--image", &options->image},     {"--motion", &options->motion},
        {"--pty", &options->pty},         {"--record", &options->record},
        {"--summary", &options->summary}, {"--eeprom", &options->memory},
        {"--faults", &options->faults},   {"--profile", &options->profile},
        {"--now", &options->now},         {NULL, NULL},
    };
    if (set_path(paths, name, value) || set_path(run->board->paths, name, value)) {
        return NULL;
    }
    if (strcmp(name, "--seconds") == 0) {
        return parse_number(value, &options->seconds) ? NULL : "takes a number, not";
    }
    const struct {
        const char *name;
        double *value;
        bool (*parse)(const char *text, double *value);
    } numbers[] = {
        {"--clock-ppm", &options->clock_ppm, parse_signed},
        {"--clock-drift", &options->drift, parse_signed},
        {"--batch-ms", &options->batch_ms, parse_number},
        {"--burst-ms", &options->burst_ms, parse_number},
    };
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        if (strcmp(name, numbers[i].name) == 0) {
            return numbers[i].parse(value, numbers[i].value) ? NULL
                                                             : "takes a number, not";
        }
    }
    if (strcmp(name, "--seed") == 0) {
        double number = 0.0;
        const bool good = parse_number(value, &number) && number < 9e15;
        options->seed = (uint64_t)number;
        return good ? NULL : "takes a number, not";
    }
    if (strcmp(name, "--press") == 0) {
        const unsigned at = options->press_count++;
        return at < RUN_LIST_MAX && parse_span(value, &options->presses[at].from_us,
                                               &options->presses[at].to_us)
                   ? NULL
                   : "takes START_US:END_US, 4096 times at most, not";
    }
    if (strcmp(name, "--send") == 0) {
        const unsigned at = options->send_count++;
        return at < RUN_LIST_MAX && parse_send(value, &options->sends[at].at_us,
                                               &options->sends[at].hex)
                   ? NULL
                   : "takes TIME_US:HEXBYTES, 4096 times at most, not";
    }
    return "is no option; it came with";
}

int run_parse_options(struct run *run, char **rest) {
    const struct run_board *board = run->board;
    struct run_options *options = &run->options;
    for (; rest[0] != NULL; rest++) {
        const char *name = rest[0];
        if (strcmp(name, "--fast") == 0) {
            options->is_fast = true;
            continue;
        }
        if (strcmp(name, "--reset-on-open") == 0) {
            options->resets_on_open = true;
            continue;
        }
        if (strcmp(name, "--version") == 0) {
            (void)printf("%s %s\n", board->name, board->version);
            return 1;
        }
        if (strcmp(name, "--help") == 0) {
            (void)fputs(board->usage, stdout);
            return 1;
        }
        const int code = board->command == NULL ? -1 : board->command(rest);
        if (code >= 0) {
            return 1 + code;
        }
        if (rest[1] == NULL) {
            return 1 +
                   run_usage(run, "this is no option, or its value is missing:", name);
        }
        const char *problem = set_option(run, name, rest[1]);
        if (problem != NULL) {
            (void)fprintf(stderr, "%s: %s %s %s\n%s", board->name, name, problem,
                          rest[1], board->usage);
            return 1 + 2;
        }
        rest++;
    }
    if (options->image == NULL) {
        return 1 + run_usage(run, "--image is missing", NULL);
    }
    if (options->pty != NULL && options->record != NULL) {
        return 1 + run_usage(run, "--pty and --record exclude each other", NULL);
    }
    if (options->now != NULL && (options->pty == NULL || options->is_fast)) {
        return 1 + run_usage(run, "--now needs --pty and real time", NULL);
    }
    if (options->resets_on_open && options->pty == NULL) {
        return 1 + run_usage(run, "--reset-on-open needs --pty", NULL);
    }
    const char *problem = board->check == NULL ? NULL : board->check(run->self);
    return problem == NULL ? 0 : 1 + run_usage(run, problem, NULL);
}
