// SPDX-License-Identifier: MIT
// Options, events, pace and summary of a virtual board; see run.h.
#include "run.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum {
    TICK_US = 1000,             // how often the outside is looked at
    SETTLE_US = 20000,          // after the last record, for its frames to leave
    MOTION_AFTER_US = 100000,   // motion starts this long after the device clock
    PACE_SLACK_NS = 200000000,  // further behind than this is not caught up
};

static volatile sig_atomic_t wants_stop;

static void on_signal(int number) {
    (void)number;
    wants_stop = 1;
}

// What the board tells

void run_on_byte(struct run *run, uint8_t byte) {
    run->bytes++;
    if (byte == 0) {
        run->frames += run->chunk > 0 ? 1 : 0;
        run->chunk = 0;
    } else {
        run->chunk++;
    }
    if (run->record != NULL) {
        (void)putc_unlocked(byte, run->record);
    }
    if (run->cable != NULL) {
        (void)cable_put(run->cable, byte, run->options.is_fast && wants_stop == 0);
    }
}

void run_on_data_ready(struct run *run) {
    run->data_ready++;
}

static uint64_t take_waiting(struct run *run) {
    if (run->waiting_count == 0) {
        return run->last_edge;
    }
    const uint64_t edge = run->waiting[0];
    run->waiting_count--;
    memmove(run->waiting, run->waiting + 1, run->waiting_count * sizeof edge);
    return edge;
}

void run_on_bus(struct run *run, bool is_start) {
    if (is_start) {
        run->burst_edge = run->data_ready;
        return;
    }
    if (run->burst_edge == run->last_edge) {
        return;  // no sample's burst: one of set-up
    }
    // Who sleeps has no sample to work on: what waits was no sample either.
    const uint64_t asleep = run->board->asleep(run->self);
    if (!run->is_working && asleep != run->waiting_asleep) {
        run->waiting_count = 0;
    }
    run->last_edge = run->burst_edge;
    run->waiting_asleep = asleep;
    if (run->waiting_count == RUN_WAITING_MAX) {
        (void)take_waiting(run);
        run->late += run->samples > 0 ? 1 : 0;  // before the first: of set-up
    }
    run->waiting[run->waiting_count++] = run->burst_edge;
}

// A sample is late when, at the end of its work, the data-ready edge after the next one
// has already come; each edge between two worked samples that had no work is late too.
void run_on_mark(struct run *run, uint64_t tick, uint64_t cycle, bool is_begin) {
    if (is_begin) {
        if (run->samples == 0 && !run->is_working) {
            run->first_mark_tick = tick;
            run->first_mark_asleep = run->board->asleep(run->self);
        }
        run->is_working = true;
        run->mark_cycle = cycle;
        run->work_edge = take_waiting(run);
        return;
    }
    if (!run->is_working) {
        return;
    }
    run->is_working = false;
    const uint64_t cycles = cycle - run->mark_cycle;
    run->samples++;
    run->cycles_sum += cycles;
    if (cycles > run->cycles_worst) {
        run->cycles_worst = cycles;
    }
    if (run->data_ready >= run->work_edge + 2) {
        run->late++;
    }
    if (run->worked_edge != 0 && run->work_edge > run->worked_edge + 1) {
        run->late += run->work_edge - run->worked_edge - 1;
    }
    run->worked_edge = run->work_edge;
}

void run_on_reset(struct run *run) {
    run->is_working = false;
    run->worked_edge = 0;
    run->waiting_count = 0;
}

static void add_event(struct run *run, struct run_event event) {
    if (run->event_count < RUN_EVENTS_MAX) {
        run->events[run->event_count++] = event;
    }
}

static void cut_after(struct run *run, const struct fault *fault) {
    const uint64_t at =
        run->board->now(run->self) + fault->after_us * run->board->ticks_per_us;
    add_event(run, (struct run_event){at, EVENT_POWER_CUT, fault});
    run->board->pause(run->self, at);
}

void run_on_memory_write(struct run *run, uint64_t number) {
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_POWER_CUT && fault->write == number) {
            cut_after(run, fault);
        }
    }
}

void run_on_card_write(struct run *run, uint64_t number) {
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_POWER_CUT && fault->card_write == number) {
            cut_after(run, fault);
        }
    }
}

// Set-up

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

static int hex_digit(char digit) {
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
        if (hex_digit((*hex)[i]) < 0) {
            return false;
        }
    }
    return length > 0 && length % 2 == 0;
}

static bool set_path(const struct run_path *paths, const char *name,
                     const char *value) {
    for (; paths->name != NULL; paths++) {
        if (strcmp(name, paths->name) == 0) {
            *paths->value = value;
            return true;
        }
    }
    return false;
}

// Options that take a value. Null, or what is wrong with it.
static const char *set_option(struct run *run, const char *name, const char *value) {
    struct run_options *options = &run->options;
    const struct run_path paths[] = {
        {"--image", &options->image},     {"--motion", &options->motion},
        {"--pty", &options->pty},         {"--record", &options->record},
        {"--summary", &options->summary}, {"--eeprom", &options->memory},
        {"--faults", &options->faults},   {NULL, NULL},
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
                   : "takes START_US:END_US, 64 times at most, not";
    }
    if (strcmp(name, "--send") == 0) {
        const unsigned at = options->send_count++;
        return at < RUN_LIST_MAX && parse_send(value, &options->sends[at].at_us,
                                               &options->sends[at].hex)
                   ? NULL
                   : "takes TIME_US:HEXBYTES, 64 times at most, not";
    }
    return "is no option; it came with";
}

// 0 to go on, else the exit code plus 1.
static int parse_options(struct run *run, char **rest) {
    const struct run_board *board = run->board;
    struct run_options *options = &run->options;
    for (; rest[0] != NULL; rest++) {
        const char *name = rest[0];
        if (strcmp(name, "--fast") == 0) {
            options->is_fast = true;
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
    const char *problem = board->check == NULL ? NULL : board->check();
    return problem == NULL ? 0 : 1 + run_usage(run, problem, NULL);
}

static bool read_memory(struct run *run) {
    FILE *file = fopen(run->options.memory, "rb");
    if (file == NULL) {
        return errno == ENOENT;  // an erased one
    }
    size_t size = 0;
    uint8_t *bytes = run->board->memory_bytes(run->self, &size);
    memset(bytes, 0xFF, size);
    const bool good = fread(bytes, 1, size, file) == size && fgetc(file) == EOF;
    (void)fclose(file);
    return good;
}

int run_load_memory(struct run *run) {
    if (run->options.memory == NULL || read_memory(run)) {
        return 0;
    }
    return run_complain(run, run->options.memory, run->board->memory);
}

static bool save_memory(struct run *run) {
    FILE *file = fopen(run->options.memory, "wb");
    if (file == NULL) {
        return false;
    }
    size_t size = 0;
    const uint8_t *bytes = run->board->memory_bytes(run->self, &size);
    const bool good = fwrite(bytes, 1, size, file) == size;
    return fclose(file) == 0 && good;
}

static uint64_t tick_of(const struct run *run, uint64_t device_us) {
    return run->board->clock_start(run->self) + device_us * run->board->ticks_per_us;
}

// Whether it is there from power-up on.
static bool is_from_power_up(const struct fault *fault) {
    switch (fault->target) {
    case FAULT_CHIP:
        return fault->at_us == 0 || fault->chip.transactions > 0;
    case FAULT_CARD:
        return fault->at_us == 0 || fault->card.count > 0;
    case FAULT_CRYSTAL:
    case FAULT_BATTERY:
    case FAULT_CHARGER:
    case FAULT_RADIO:
        return fault->at_us == 0;
    default:
        return false;
    }
}

// Faults that don't wait for the device clock.
static void schedule_at_power_up(struct run *run) {
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (!is_from_power_up(fault)) {
            continue;
        }
        if (fault->target == FAULT_CHIP) {
            run->board->add_chip_fault(run->self, &fault->chip);
        } else if (fault->target == FAULT_CARD) {
            run->board->add_card_fault(run->self, &fault->card);
        } else {
            run->board->suffer(run->self, fault);
        }
    }
}

static void schedule_fault(struct run *run, const struct fault *fault) {
    const uint64_t tick = tick_of(run, fault->at_us);
    if (is_from_power_up(fault)) {
        return;
    }
    switch (fault->target) {
    case FAULT_CHIP: {
        struct chip_fault chip_fault = fault->chip;
        chip_fault.from_ns = run->board->nanoseconds(tick);
        run->board->add_chip_fault(run->self, &chip_fault);
        break;
    }
    case FAULT_CARD: {
        struct card_fault card_fault = fault->card;
        card_fault.from_ns = run->board->nanoseconds(tick);
        run->board->add_card_fault(run->self, &card_fault);
        break;
    }
    case FAULT_CRYSTAL:
    case FAULT_RESET:
    case FAULT_BROWN_OUT:
    case FAULT_GLITCH:
    case FAULT_BATTERY:
    case FAULT_CHARGER:
    case FAULT_RADIO:
        add_event(run, (struct run_event){tick, EVENT_FAULT, fault});
        break;
    case FAULT_POWER_CUT:
        if (fault->write == 0 && fault->card_write == 0) {
            add_event(run, (struct run_event){tick, EVENT_POWER_CUT, fault});
        }
        break;
    }
}

// All else, once the device clock runs.
static void schedule(struct run *run) {
    const struct run_board *board = run->board;
    const struct run_options *options = &run->options;
    run->is_scheduled = true;
    motion_begin(&run->motion,
                 (int64_t)board->nanoseconds(tick_of(run, MOTION_AFTER_US)));
    for (unsigned i = 0; i < options->press_count; i++) {
        const uint64_t from = tick_of(run, options->presses[i].from_us);
        const uint64_t to = tick_of(run, options->presses[i].to_us);
        add_event(run, (struct run_event){from, EVENT_PRESS, NULL});
        add_event(run, (struct run_event){to, EVENT_RELEASE, NULL});
    }
    for (unsigned i = 0; i < options->send_count; i++) {
        const char *hex = options->sends[i].hex;
        for (; hex[0] != '\0'; hex += 2) {
            (void)board->send(run->self, tick_of(run, options->sends[i].at_us),
                              (uint8_t)(hex_digit(hex[0]) * 16 + hex_digit(hex[1])));
        }
    }
    for (unsigned i = 0; i < run->faults.count; i++) {
        schedule_fault(run, &run->faults.list[i]);
    }
}

// The run

static uint64_t next_event(const struct run *run) {
    uint64_t next = RUN_NEVER;
    for (unsigned i = 0; i < run->event_count; i++) {
        next = run->events[i].tick < next ? run->events[i].tick : next;
    }
    return next;
}

static void do_events(struct run *run) {
    const struct run_board *board = run->board;
    const uint64_t now = board->now(run->self);
    for (unsigned i = 0; i < run->event_count;) {
        if (run->events[i].tick > now) {
            i++;
            continue;
        }
        switch (run->events[i].kind) {
        case EVENT_PRESS:
            board->press(run->self, true);
            break;
        case EVENT_RELEASE:
            board->press(run->self, false);
            break;
        case EVENT_FAULT:
            board->suffer(run->self, run->events[i].fault);
            break;
        case EVENT_POWER_CUT:
            board->cut_memory(run->self);
            run->is_power_cut = true;
            run->is_over = true;
            break;
        }
        run->events[i] = run->events[--run->event_count];
    }
}

static uint64_t end_tick(struct run *run) {
    const struct run_board *board = run->board;
    const struct run_options *options = &run->options;
    const double ticks_per_s = (double)board->ticks_per_us * 1e6;
    if (board->clock_start(run->self) == RUN_NEVER) {
        // A firmware that never starts its clock is over after --seconds of power.
        return options->seconds > 0.0 ? (uint64_t)(options->seconds * ticks_per_s)
                                      : RUN_NEVER;
    }
    if (options->seconds > 0.0) {
        return tick_of(run, (uint64_t)llround(options->seconds * 1e6));
    }
    if (options->motion == NULL) {
        return RUN_NEVER;
    }
    const uint64_t now = board->now(run->self);
    if (!motion_is_over(&run->motion, (int64_t)board->nanoseconds(now))) {
        return RUN_NEVER;
    }
    return tick_of(run, MOTION_AFTER_US + SETTLE_US) +
           (uint64_t)ceil((double)(run->motion.read - 1) / run->motion.rate_hz *
                          ticks_per_s);
}

static int64_t wall_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

// How long after power a time of the device is on the wall clock.
static int64_t after_power(const struct run *run, uint64_t tick) {
    const double device_ns = (double)run->board->nanoseconds(tick);
    const double device_s = device_ns * 1e-9;
    const double fast_ppm =
        run->options.clock_ppm + run->options.drift / 2.0 * device_s;
    return llround(device_ns - device_ns * fast_ppm * 1e-6);
}

// Waits until the wall clock has come as far as the device.
static void pace(struct run *run) {
    const uint64_t now = run->board->now(run->self);
    const int64_t ahead = run->power_ns + after_power(run, now) - wall_ns();
    if (ahead > 0) {
        const struct timespec wait = {.tv_sec = ahead / 1000000000,
                                      .tv_nsec = ahead % 1000000000};
        (void)nanosleep(&wait, NULL);
    } else if (ahead < -PACE_SLACK_NS) {
        run->power_ns -= ahead;
        run->caught_up_ns += (uint64_t)-ahead;
    }
}

// A USB adapter hands over what it has at whole multiples of its latency, and a busy
// host nothing for a while, once a second, somewhere in it.
static bool is_held(const struct run *run) {
    const double now_ms = (double)(wall_ns() - run->power_ns) * 1e-6;
    const double batch_ms = run->options.batch_ms;
    if (batch_ms > 0.0 && fmod(now_ms, batch_ms) >= TICK_US / 1000.0) {
        return true;
    }
    const double second = floor(now_ms / 1000.0);
    const double room_ms = 1000.0 - run->options.burst_ms;
    // The golden ratio's multiples are spread evenly.
    const double from_ms = fmod(second * 0.6180339887, 1.0) * room_ms;
    const double in_second_ms = now_ms - second * 1000.0;
    return in_second_ms >= from_ms && in_second_ms < from_ms + run->options.burst_ms;
}

static void exchange(struct run *run, bool is_paced) {
    if (!is_held(run)) {
        cable_flush(run->cable);
    }
    // What the line can carry in a tick and no more stays between us and the sender.
    if (run->inbox_count == 0 &&
        run->board->line_count(run->self) < sizeof run->inbox) {
        run->inbox_count = cable_get(run->cable, run->inbox, sizeof run->inbox);
        run->inbox_ns = wall_ns();
    }
    // Nor is a byte heard before it came, where the board is behind the wall clock.
    const int64_t now_ns = run->power_ns + after_power(run, run->board->now(run->self));
    if (is_paced && now_ns < run->inbox_ns) {
        return;
    }
    for (size_t i = 0; i < run->inbox_count; i++) {
        (void)run->board->send(run->self, 0, run->inbox[i]);
    }
    run->inbox_count = 0;
}

// False when the processor can't go on.
static bool run_all(struct run *run) {
    const struct run_board *board = run->board;
    const uint64_t step = TICK_US * board->ticks_per_us;
    const bool is_paced = run->cable != NULL && !run->options.is_fast;
    run->power_ns = is_paced ? wall_ns() : 0;
    uint64_t tick = 0;
    while (wants_stop == 0 && !run->is_over) {
        uint64_t until = tick + step;
        if (!run->is_scheduled) {
            until = board->now(run->self) + board->ticks_per_us;
        }
        const uint64_t event = next_event(run);
        const uint64_t end = end_tick(run);
        until = event < until ? event : until;
        until = end < until ? end : until;
        if (!board->run(run->self, until)) {
            return false;
        }
        const uint64_t now = board->now(run->self);
        if (!run->is_scheduled && board->clock_start(run->self) != RUN_NEVER) {
            schedule(run);
        }
        do_events(run);
        if (now >= end) {
            break;
        }
        if (now >= tick + step) {
            tick += step;
            // In this order: a byte never comes before its time.
            if (is_paced) {
                pace(run);
            }
            if (run->cable != NULL) {
                exchange(run, is_paced);
            }
        }
    }
    return true;
}

// The summary

struct summary {
    struct run_report report;
    bool is_crashed;
    double seconds, cycles_mean, idle;
    uint64_t dropped, unheard;
};

static struct summary summarize(struct run *run, bool is_good) {
    const struct run_board *board = run->board;
    const double ticks_per_s = (double)board->ticks_per_us * 1e6;
    const uint64_t now = board->now(run->self);
    const uint64_t start = board->clock_start(run->self);
    const uint64_t from = run->samples > 0 ? run->first_mark_tick : 0;
    const uint64_t asleep =
        board->asleep(run->self) - (run->samples > 0 ? run->first_mark_asleep : 0);
    struct summary summary = {.is_crashed = !is_good};
    board->report(run->self, &summary.report);
    if (start != RUN_NEVER) {
        summary.seconds = (double)(now - start) / ticks_per_s;
    }
    if (run->samples > 0) {
        summary.cycles_mean = (double)run->cycles_sum / (double)run->samples;
    }
    if (now > from) {
        summary.idle = (double)asleep / (double)(now - from);
    }
    if (run->cable != NULL) {
        summary.dropped = run->cable->dropped;
        summary.unheard = run->cable->unheard;
    }
    return summary;
}

static void write_text(FILE *file, const char *name, const char *text) {
    if (text == NULL) {
        (void)fprintf(file, "  \"%s\": null,\n", name);
    } else {
        (void)fprintf(file, "  \"%s\": \"%s\",\n", name,
                      text);  // ours: nothing to escape
    }
}

static void write_card(FILE *file, const struct run_report *report) {
    (void)fprintf(file,
                  "  \"card_blocks\": %" PRIu64 ",\n  \"card_bad_crc\": %" PRIu64
                  ",\n  \"card_busy_worst_us\": %" PRIu64 ",\n",
                  report->card_blocks, report->card_bad_crc,
                  report->card_busy_worst_us);
    write_text(file, "card_complaint", report->card_complaint);
}

static bool write_summary(const struct run *run, const struct summary *summary) {
    const struct run_report *report = &summary->report;
    const uint64_t start = run->board->clock_start(run->self);
    FILE *file = fopen(run->options.summary, "w");
    if (file == NULL) {
        return false;
    }
    const struct {
        const char *name;
        uint64_t value;
    } numbers[] = {
        {"motion_start_us", MOTION_AFTER_US},
        {"samples", run->samples},
        {"data_ready", run->data_ready},
        {"late", run->late},
        {"frames", run->frames},
        {"bytes", run->bytes},
        {"cycles_worst", run->cycles_worst},
        {"stack_max", report->stack},
        {"flash", report->flash},
        {"ram", report->ram},
        {"resets", report->resets},
        {"eeprom_writes", report->memory_writes},
        {"uart_dropped", summary->dropped},
        {"uart_unheard", summary->unheard},
        {"uart_overruns", report->uart_overruns},
        {"bus_transactions", report->bus_transactions},
        {"power_ns", (uint64_t)run->power_ns},
        {"clock_start_ns", start == RUN_NEVER ? 0 : run->board->nanoseconds(start)},
        {"caught_up_ns", run->caught_up_ns},
    };
    (void)fputs("{\n", file);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        (void)fprintf(file, "  \"%s\": %" PRIu64 ",\n", numbers[i].name,
                      numbers[i].value);
    }
    (void)fprintf(file, "  \"cycles_mean\": %.1f,\n  \"idle\": %.6f,\n",
                  summary->cycles_mean, summary->idle);
    (void)fprintf(file, "  \"seconds\": %.6f,\n", summary->seconds);
    write_text(file, "firmware_complaint", report->firmware_complaint);
    write_text(file, "sensor_complaint", report->sensor_complaint);
    if (report->has_card) {
        write_card(file, report);
    }
    for (unsigned i = 0; i < report->more_count; i++) {
        (void)fprintf(file, "  \"%s\": %" PRIu64 ",\n", report->more[i].name,
                      report->more[i].value);
    }
    if (report->has_radio) {
        write_text(file, "radio_complaint", report->radio_complaint);
    }
    (void)fprintf(file, "  \"power_cut\": %s,\n  \"crashed\": %s",
                  run->is_power_cut ? "true" : "false",
                  summary->is_crashed ? "true" : "false");
    if (summary->is_crashed) {
        (void)fprintf(file, ",\n  \"crash_pc\": %u,\n  \"crash_sp\": %u", report->pc,
                      report->sp);
    }
    (void)fputs("\n}\n", file);
    return fclose(file) == 0;
}

static void say_summary(const struct run *run, const struct summary *summary) {
    const struct run_report *report = &summary->report;
    const char *name = run->board->name;
    (void)fprintf(stderr,
                  "%s: %.3f s: %" PRIu64 " samples, %" PRIu64 " late; %" PRIu64
                  " frames, %" PRIu64 " bytes; %.0f cycles a sample, %" PRIu64
                  " at worst; asleep %.1f %%; stack %u bytes; %" PRIu64 " resets\n",
                  name, summary->seconds, run->samples, run->late, run->frames,
                  run->bytes, summary->cycles_mean, run->cycles_worst,
                  100.0 * summary->idle, report->stack, report->resets);
    if (summary->dropped + summary->unheard > 0) {
        (void)fprintf(stderr,
                      "%s: %" PRIu64 " bytes dropped for a slow reader, %" PRIu64
                      " sent while nobody listened\n",
                      name, summary->dropped, summary->unheard);
    }
    if (report->firmware_complaint != NULL) {
        (void)fprintf(stderr, "%s: the firmware: %s\n", name,
                      report->firmware_complaint);
    }
    if (report->sensor_complaint != NULL) {
        (void)fprintf(stderr, "%s: on the sensor's bus: %s\n", name,
                      report->sensor_complaint);
    }
    if (report->card_complaint != NULL) {
        (void)fprintf(stderr, "%s: on the card's bus: %s\n", name,
                      report->card_complaint);
    }
    if (report->radio_complaint != NULL) {
        (void)fprintf(stderr, "%s: to the radio: %s\n", name, report->radio_complaint);
    }
    if (summary->is_crashed) {
        (void)fprintf(stderr, "%s: the firmware %s at pc 0x%04x, sp 0x%04x\n", name,
                      report->crash, report->pc, report->sp);
    }
}

static int set_up(struct run *run) {
    const struct run_options *options = &run->options;
    if (options->faults != NULL &&
        !faults_load(&run->faults, options->faults, &run->board->fault_kinds)) {
        return run_complain(run, options->faults, run->faults.problem);
    }
    if (options->motion != NULL) {
        const char *problem = motion_open(&run->motion, options->motion);
        if (problem != NULL) {
            return run_complain(run, options->motion, problem);
        }
    }
    const int code = run->board->power_up(run->self, run);
    if (code != 0) {
        return code;
    }
    if (options->record != NULL) {
        run->record = fopen(options->record, "wb");
        if (run->record == NULL) {
            return run_complain(run, options->record, "can't be written");
        }
    }
    if (options->pty != NULL) {
        run->cable = malloc(sizeof *run->cable);
        if (run->cable == NULL) {
            return run_complain(run, options->pty, "does not fit into memory");
        }
        const char *problem = cable_open(run->cable, options->pty);
        if (problem != NULL) {
            return run_complain(run, options->pty, problem);
        }
        (void)fprintf(stderr, "ready %s\n", options->pty);
    }
    schedule_at_power_up(run);
    return 0;
}

static int finish(struct run *run, bool is_good) {
    const struct run_options *options = &run->options;
    int code = is_good ? 0 : 1;
    if (run->record != NULL && fclose(run->record) != 0) {
        (void)run_complain(run, options->record, "can't be written");
        code = 1;
    }
    if (run->cable != NULL) {
        cable_flush(run->cable);
    }
    const struct summary summary = summarize(run, is_good);
    say_summary(run, &summary);
    if (options->summary != NULL && !write_summary(run, &summary)) {
        (void)run_complain(run, options->summary, "can't be written");
        code = 1;
    }
    if (run->board->finish != NULL && !run->board->finish(run->self)) {
        code = 1;
    }
    if (options->memory != NULL && !save_memory(run)) {
        (void)run_complain(run, options->memory, "can't be written");
        code = 1;
    }
    if (run->cable != NULL) {
        cable_close(run->cable);
        free(run->cable);
    }
    return code;
}

int run_main(struct run *run, const struct run_board *board, void *self,
             char **arguments) {
    run->board = board;
    run->self = self;
    const int stop = parse_options(run, arguments);
    if (stop != 0) {
        return stop - 1;
    }
    struct sigaction action = {.sa_handler = on_signal};
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGINT, &action, NULL);
    (void)signal(SIGPIPE, SIG_IGN);
    const int problem = set_up(run);
    if (problem != 0) {
        if (run->cable != NULL) {
            cable_close(run->cable);
        }
        return problem;
    }
    const int code = finish(run, run_all(run));
    motion_close(&run->motion);
    return code;
}
