// SPDX-License-Identifier: MIT
// The virtual Nano: runs the image that a user flashes, with the modelled sensor, and
// says at the end what it saw. Links libsimavr (GPL-3) and libelf: this program and
// nothing else of the project does, and it is not part of any package.
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "cable.h"
#include "faults.h"
#include "image.h"
#include "machine.h"
#include "motion.h"
#include "profile.h"
#include "selftest.h"

#ifndef NANO_VERSION
#define NANO_VERSION "0.1.0"
#endif

enum {
    EVENTS_MAX = 512,
    WAITING_MAX = 8,
    LIST_MAX = 64,              // of --press, and of --send
    TICK_CYCLES = 16000,        // 1 ms: how often the outside is looked at
    SETTLE_US = 20000,          // after the last record, for its frames to leave
    MOTION_AFTER_US = 100000,   // motion starts this long after the device clock
    PACE_SLACK_NS = 200000000,  // further behind than this is not caught up
};

static const char usage_text[] =
    "usage: nano --image FILE.elf [--motion FILE|-] [--pty LINK | --record FILE]\n"
    "            [--fast] [--seconds N] [--summary FILE] [--eeprom FILE] [--seed N]\n"
    "            [--faults FILE] [--press START_US:END_US]... [--send US:HEX]...\n"
    "            [--profile FILE [--parts FILE]]\n"
    "       nano --self-test [--without NAME]\n"
    "       nano --version\n";

enum event_kind {
    EVENT_PRESS,
    EVENT_RELEASE,
    EVENT_RESET,
    EVENT_BROWN_OUT,
    EVENT_POWER_CUT,
};

struct event {
    uint64_t cycle;
    enum event_kind kind;
};

struct options {
    const char *image, *motion, *pty, *record, *summary, *eeprom, *faults;
    const char *profile, *parts;
    bool is_fast;
    double seconds;  // 0: no limit
    uint64_t seed;
    struct {
        uint64_t from_us, to_us;
    } presses[LIST_MAX];
    unsigned press_count;
    struct {
        uint64_t at_us;
        const char *hex;
    } sends[LIST_MAX];
    unsigned send_count;
};

struct run {
    struct options options;
    struct machine machine;
    struct mpu9250_chip *chip;
    struct motion motion;
    struct cable *cable;
    FILE *record;
    struct faults faults;
    struct profile *profile;
    struct event events[EVENTS_MAX];
    unsigned event_count;
    bool is_scheduled;
    bool is_power_cut;
    bool is_over;

    uint64_t bytes, frames, chunk;
    uint64_t data_ready;  // edges on INT0
    // Which edge a sample belongs to: the last before its burst's START. From the
    // burst's STOP on it waits for work, first come first served.
    uint64_t burst_edge, last_edge, work_edge, worked_edge;
    uint64_t waiting[WAITING_MAX];
    unsigned waiting_count;
    uint64_t waiting_asleep;  // cycles slept when the last one came
    bool is_working;
    uint64_t mark_cycle, first_mark_cycle, first_mark_asleep;
    uint64_t samples, late, cycles_sum, cycles_worst;
    uint64_t eeprom_writes;
    struct image image;
};

static volatile sig_atomic_t wants_stop;

static void on_signal(int number) {
    (void)number;
    wants_stop = 1;
}

// What the machine tells

static void on_byte(void *context, uint64_t cycle, uint8_t byte) {
    (void)cycle;
    struct run *run = context;
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

static void on_data_ready(void *context, uint64_t cycle) {
    (void)cycle;
    ((struct run *)context)->data_ready++;
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

static void on_bus(void *context, uint64_t cycle, bool is_start) {
    (void)cycle;
    struct run *run = context;
    if (is_start) {
        run->burst_edge = run->data_ready;
        return;
    }
    if (run->burst_edge == run->last_edge) {
        return;  // no sample's burst: one of set-up
    }
    // Who sleeps has no sample to work on: what waits was no sample either.
    if (!run->is_working && run->machine.asleep != run->waiting_asleep) {
        run->waiting_count = 0;
    }
    run->last_edge = run->burst_edge;
    run->waiting_asleep = run->machine.asleep;
    if (run->waiting_count == WAITING_MAX) {
        (void)take_waiting(run);
        run->late++;
    }
    run->waiting[run->waiting_count++] = run->burst_edge;
}

// GPIOR0: 1 when work on a sample starts, 0 when it is done. A sample is late when, at
// the end of its work, the data-ready edge after the next one has already come; each
// edge between two worked samples that had no work is late too.
static void on_mark(void *context, uint64_t cycle, uint8_t value) {
    struct run *run = context;
    if (run->profile != NULL) {
        (value != 0 ? profile_begin_sample : profile_end_sample)(run->profile);
    }
    if (value != 0) {
        if (run->samples == 0 && !run->is_working) {
            run->first_mark_cycle = cycle;
            run->first_mark_asleep = run->machine.asleep;
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

static void on_reset(void *context, enum machine_reset cause) {
    (void)cause;
    struct run *run = context;
    if (run->profile != NULL) {
        profile_reset(run->profile);
    }
    run->is_working = false;
    run->worked_edge = 0;
    run->waiting_count = 0;
}

static void on_eeprom_write(void *context, uint64_t number) {
    struct run *run = context;
    run->eeprom_writes = number;
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_POWER_CUT && fault->write == number &&
            run->event_count < EVENTS_MAX) {
            const uint64_t at =
                machine_now(&run->machine) + fault->after_us * MACHINE_CYCLES_PER_US;
            run->events[run->event_count++] = (struct event){at, EVENT_POWER_CUT};
            machine_pause(&run->machine, at);
        }
    }
}

// Set-up

static int usage(const char *what, const char *which) {
    (void)fprintf(stderr, "nano: %s%s%s\n%s", what, which == NULL ? "" : " ",
                  which == NULL ? "" : which, usage_text);
    return 2;
}

static int complain(const char *path, const char *what) {
    (void)fprintf(stderr, "nano: %s %s\n", path, what);
    return 2;
}

static bool parse_number(const char *text, double *value) {
    char *end = NULL;
    *value = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*value) && *value >= 0.0;
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

// Options that take a value. Null, or what is wrong with it.
static const char *set_option(struct options *options, const char *name,
                              const char *value) {
    const struct {
        const char *name;
        const char **value;
    } paths[] = {
        {"--image", &options->image},     {"--motion", &options->motion},
        {"--pty", &options->pty},         {"--record", &options->record},
        {"--summary", &options->summary}, {"--eeprom", &options->eeprom},
        {"--faults", &options->faults},   {"--profile", &options->profile},
        {"--parts", &options->parts},
    };
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        if (strcmp(name, paths[i].name) == 0) {
            *paths[i].value = value;
            return NULL;
        }
    }
    if (strcmp(name, "--seconds") == 0) {
        return parse_number(value, &options->seconds) ? NULL : "takes a number, not";
    }
    if (strcmp(name, "--seed") == 0) {
        double number = 0.0;
        const bool good = parse_number(value, &number) && number < 9e15;
        options->seed = (uint64_t)number;
        return good ? NULL : "takes a number, not";
    }
    if (strcmp(name, "--press") == 0) {
        const unsigned at = options->press_count++;
        return at < LIST_MAX && parse_span(value, &options->presses[at].from_us,
                                           &options->presses[at].to_us)
                   ? NULL
                   : "takes START_US:END_US, 64 times at most, not";
    }
    if (strcmp(name, "--send") == 0) {
        const unsigned at = options->send_count++;
        return at < LIST_MAX && parse_send(value, &options->sends[at].at_us,
                                           &options->sends[at].hex)
                   ? NULL
                   : "takes TIME_US:HEXBYTES, 64 times at most, not";
    }
    return "is no option; it came with";
}

static int run_self_test(char **rest) {
    if (rest[0] == NULL) {
        return selftest_run(NULL);
    }
    if (strcmp(rest[0], "--without") == 0 && rest[1] != NULL && rest[2] == NULL) {
        return selftest_run(rest[1]);
    }
    return usage("--self-test does not go with", rest[0]);
}

// 0 to go on, else the exit code plus 1.
static int parse_options(char **rest, struct options *options) {
    for (; rest[0] != NULL; rest++) {
        const char *name = rest[0];
        if (strcmp(name, "--fast") == 0) {
            options->is_fast = true;
            continue;
        }
        if (strcmp(name, "--version") == 0) {
            (void)printf("nano %s\n", NANO_VERSION);
            return 1;
        }
        if (strcmp(name, "--help") == 0) {
            (void)fputs(usage_text, stdout);
            return 1;
        }
        if (strcmp(name, "--self-test") == 0) {
            return 1 + run_self_test(rest + 1);
        }
        if (rest[1] == NULL) {
            return 1 + usage("this is no option, or its value is missing:", name);
        }
        const char *problem = set_option(options, name, rest[1]);
        if (problem != NULL) {
            (void)fprintf(stderr, "nano: %s %s %s\n%s", name, problem, rest[1],
                          usage_text);
            return 1 + 2;
        }
        rest++;
    }
    if (options->image == NULL) {
        return 1 + usage("--image is missing", NULL);
    }
    if (options->pty != NULL && options->record != NULL) {
        return 1 + usage("--pty and --record exclude each other", NULL);
    }
    if (options->parts != NULL && options->profile == NULL) {
        return 1 + usage("--parts needs --profile", NULL);
    }
    return 0;
}

static bool load_eeprom(struct run *run) {
    FILE *file = fopen(run->options.eeprom, "rb");
    if (file == NULL) {
        return errno == ENOENT;  // an erased one
    }
    uint8_t *bytes = run->machine.eeprom.bytes;
    memset(bytes, 0xFF, MACHINE_EEPROM_SIZE);
    const bool good =
        fread(bytes, 1, MACHINE_EEPROM_SIZE, file) == MACHINE_EEPROM_SIZE &&
        fgetc(file) == EOF;
    (void)fclose(file);
    return good;
}

static bool save_eeprom(const struct run *run) {
    FILE *file = fopen(run->options.eeprom, "wb");
    if (file == NULL) {
        return false;
    }
    const bool good = fwrite(run->machine.eeprom.bytes, 1, MACHINE_EEPROM_SIZE, file) ==
                      MACHINE_EEPROM_SIZE;
    return fclose(file) == 0 && good;
}

static uint64_t cycle_of(const struct run *run, uint64_t device_us) {
    return run->machine.clock_start + device_us * MACHINE_CYCLES_PER_US;
}

static void add_event(struct run *run, uint64_t cycle, enum event_kind kind) {
    if (run->event_count < EVENTS_MAX) {
        run->events[run->event_count++] = (struct event){cycle, kind};
    }
}

// Faults that don't wait for the device clock.
static void schedule_at_power_up(struct run *run) {
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_CHIP &&
            (fault->at_us == 0 || fault->chip.transactions > 0)) {
            (void)mpu9250_chip_add_fault(run->chip, &fault->chip);
        }
    }
}

// All else, once the device clock runs.
static void schedule(struct run *run) {
    run->is_scheduled = true;
    motion_begin(&run->motion, (int64_t)machine_ns(cycle_of(run, MOTION_AFTER_US)));
    const struct options *options = &run->options;
    for (unsigned i = 0; i < options->press_count; i++) {
        add_event(run, cycle_of(run, options->presses[i].from_us), EVENT_PRESS);
        add_event(run, cycle_of(run, options->presses[i].to_us), EVENT_RELEASE);
    }
    for (unsigned i = 0; i < options->send_count; i++) {
        const char *hex = options->sends[i].hex;
        for (; hex[0] != '\0'; hex += 2) {
            (void)machine_send(&run->machine, cycle_of(run, options->sends[i].at_us),
                               (uint8_t)(hex_digit(hex[0]) * 16 + hex_digit(hex[1])));
        }
    }
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        const uint64_t cycle = cycle_of(run, fault->at_us);
        switch (fault->target) {
        case FAULT_CHIP:
            if (fault->at_us != 0 && fault->chip.transactions == 0) {
                struct mpu9250_chip_fault chip_fault = fault->chip;
                chip_fault.from_ns = machine_ns(cycle);
                (void)mpu9250_chip_add_fault(run->chip, &chip_fault);
            }
            break;
        case FAULT_RESET:
            add_event(run, cycle, EVENT_RESET);
            break;
        case FAULT_BROWN_OUT:
            add_event(run, cycle, EVENT_BROWN_OUT);
            break;
        case FAULT_POWER_CUT:
            if (fault->write == 0) {
                add_event(run, cycle, EVENT_POWER_CUT);
            }
            break;
        }
    }
}

// The run

static uint64_t next_event(const struct run *run) {
    uint64_t next = MACHINE_NEVER;
    for (unsigned i = 0; i < run->event_count; i++) {
        next = run->events[i].cycle < next ? run->events[i].cycle : next;
    }
    return next;
}

static void do_events(struct run *run) {
    struct machine *machine = &run->machine;
    const uint64_t now = machine_now(machine);
    for (unsigned i = 0; i < run->event_count;) {
        if (run->events[i].cycle > now) {
            i++;
            continue;
        }
        switch (run->events[i].kind) {
        case EVENT_PRESS:
            machine_press(machine, true);
            break;
        case EVENT_RELEASE:
            machine_press(machine, false);
            break;
        case EVENT_RESET:
            machine_reset(machine, MACHINE_EXTERNAL);
            break;
        case EVENT_BROWN_OUT:
            machine_reset(machine, MACHINE_BROWN_OUT);
            break;
        case EVENT_POWER_CUT:
            machine_cut_eeprom(machine);
            run->is_power_cut = true;
            run->is_over = true;
            break;
        }
        run->events[i] = run->events[--run->event_count];
    }
}

static uint64_t end_cycle(struct run *run) {
    const struct options *options = &run->options;
    if (run->machine.clock_start == MACHINE_NEVER) {
        // A firmware that never starts its clock is over after --seconds of power.
        return options->seconds > 0.0 ? (uint64_t)(options->seconds * MACHINE_HZ)
                                      : MACHINE_NEVER;
    }
    if (options->seconds > 0.0) {
        return cycle_of(run, (uint64_t)llround(options->seconds * 1e6));
    }
    if (options->motion == NULL) {
        return MACHINE_NEVER;
    }
    const uint64_t now = machine_now(&run->machine);
    if (!motion_is_over(&run->motion, (int64_t)machine_ns(now))) {
        return MACHINE_NEVER;
    }
    return cycle_of(run, MOTION_AFTER_US + SETTLE_US) +
           (uint64_t)ceil((double)(run->motion.read - 1) / run->motion.rate_hz *
                          MACHINE_HZ);
}

static int64_t wall_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

// Waits until the wall clock has come as far as the device.
static void pace(const struct run *run, int64_t *base_ns) {
    const int64_t device = (int64_t)machine_ns(machine_now(&run->machine));
    const int64_t ahead = *base_ns + device - wall_ns();
    if (ahead > 0) {
        const struct timespec wait = {.tv_sec = ahead / 1000000000,
                                      .tv_nsec = ahead % 1000000000};
        (void)nanosleep(&wait, NULL);
    } else if (ahead < -PACE_SLACK_NS) {
        *base_ns -= ahead;
    }
}

static void exchange(struct run *run) {
    uint8_t bytes[256];
    cable_flush(run->cable);
    // What the line can carry in a tick and no more stays between us and the sender.
    if (run->machine.uart.line_count < sizeof bytes) {
        const size_t got = cable_get(run->cable, bytes, sizeof bytes);
        for (size_t i = 0; i < got; i++) {
            (void)machine_send(&run->machine, 0, bytes[i]);
        }
    }
}

// False when the processor can't go on.
static bool run_all(struct run *run) {
    struct machine *machine = &run->machine;
    const bool is_paced = run->cable != NULL && !run->options.is_fast;
    int64_t base_ns = wall_ns();
    uint64_t tick = 0;
    while (wants_stop == 0 && !run->is_over) {
        uint64_t until = tick + TICK_CYCLES;
        if (!run->is_scheduled) {
            until = machine_now(machine) + MACHINE_CYCLES_PER_US;
        }
        const uint64_t event = next_event(run);
        const uint64_t end = end_cycle(run);
        until = event < until ? event : until;
        until = end < until ? end : until;
        if (!machine_run(machine, until)) {
            return false;
        }
        const uint64_t now = machine_now(machine);
        if (!run->is_scheduled && machine->clock_start != MACHINE_NEVER) {
            schedule(run);
        }
        do_events(run);
        if (now >= end) {
            break;
        }
        if (now >= tick + TICK_CYCLES) {
            tick += TICK_CYCLES;
            if (run->cable != NULL) {
                exchange(run);
            }
            if (is_paced) {
                pace(run, &base_ns);
            }
        }
    }
    return true;
}

// The summary

struct summary {
    bool is_crashed;
    double seconds, cycles_mean, idle;
    uint64_t dropped, unheard;
    uint16_t stack;
    const char *firmware_complaint, *sensor_complaint;
};

static struct summary summarize(struct run *run, bool is_good) {
    struct machine *machine = &run->machine;
    const uint64_t now = machine_now(machine);
    const uint64_t from = run->samples > 0 ? run->first_mark_cycle : 0;
    const uint64_t asleep =
        machine->asleep - (run->samples > 0 ? run->first_mark_asleep : 0);
    struct summary summary = {
        .is_crashed = !is_good,
        .stack = machine_stack_deepest(machine),
        .firmware_complaint = machine->complaint,
        .sensor_complaint = mpu9250_chip_complaint(run->chip),
    };
    if (machine->clock_start != MACHINE_NEVER) {
        summary.seconds = (double)(now - machine->clock_start) / MACHINE_HZ;
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

static bool write_summary(const struct run *run, const struct summary *summary) {
    const struct machine *machine = &run->machine;
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
        {"stack_max", summary->stack},
        {"flash", run->image.flash},
        {"ram", run->image.ram},
        {"resets", machine->resets},
        {"eeprom_writes", machine->eeprom.writes},
        {"uart_dropped", summary->dropped},
        {"uart_unheard", summary->unheard},
        {"uart_overruns", machine->uart.overruns},
        {"bus_transactions", mpu9250_chip_transactions(run->chip)},
    };
    (void)fputs("{\n", file);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        (void)fprintf(file, "  \"%s\": %" PRIu64 ",\n", numbers[i].name,
                      numbers[i].value);
    }
    (void)fprintf(file, "  \"cycles_mean\": %.1f,\n  \"idle\": %.6f,\n",
                  summary->cycles_mean, summary->idle);
    (void)fprintf(file, "  \"seconds\": %.6f,\n", summary->seconds);
    write_text(file, "firmware_complaint", summary->firmware_complaint);
    write_text(file, "sensor_complaint", summary->sensor_complaint);
    (void)fprintf(file, "  \"power_cut\": %s,\n  \"crashed\": %s",
                  run->is_power_cut ? "true" : "false",
                  summary->is_crashed ? "true" : "false");
    if (summary->is_crashed) {
        (void)fprintf(file, ",\n  \"crash_pc\": %u,\n  \"crash_sp\": %u",
                      machine_pc(machine), machine_sp(machine));
    }
    (void)fputs("\n}\n", file);
    return fclose(file) == 0;
}

static void say_summary(const struct run *run, const struct summary *summary) {
    const struct machine *machine = &run->machine;
    (void)fprintf(stderr,
                  "nano: %.3f s: %" PRIu64 " samples, %" PRIu64 " late; %" PRIu64
                  " frames, %" PRIu64 " bytes; %.0f cycles a sample, %" PRIu64
                  " at worst; asleep %.1f %%; stack %u bytes; %" PRIu64 " resets\n",
                  summary->seconds, run->samples, run->late, run->frames, run->bytes,
                  summary->cycles_mean, run->cycles_worst, 100.0 * summary->idle,
                  summary->stack, machine->resets);
    if (summary->dropped + summary->unheard > 0) {
        (void)fprintf(stderr,
                      "nano: %" PRIu64 " bytes dropped for a slow reader, %" PRIu64
                      " sent while nobody listened\n",
                      summary->dropped, summary->unheard);
    }
    if (summary->firmware_complaint != NULL) {
        (void)fprintf(stderr, "nano: the firmware: %s\n", summary->firmware_complaint);
    }
    if (summary->sensor_complaint != NULL) {
        (void)fprintf(stderr, "nano: on the sensor's bus: %s\n",
                      summary->sensor_complaint);
    }
    if (summary->is_crashed) {
        (void)fprintf(stderr, "nano: the firmware %s at pc 0x%04x, sp 0x%04x\n",
                      machine->is_stuck ? "sleeps with interrupts off" : "crashed",
                      machine_pc(machine), machine_sp(machine));
    }
}

static int set_up(struct run *run) {
    const struct options *options = &run->options;
    struct mpu9250_chip_config config = mpu9250_chip_defaults();
    if (options->faults != NULL && !faults_load(&run->faults, options->faults)) {
        return complain(options->faults, run->faults.problem);
    }
    if (options->motion != NULL) {
        const char *problem = motion_open(&run->motion, options->motion);
        if (problem != NULL) {
            return complain(options->motion, problem);
        }
        config.is_recorded = (run->motion.flags & MOTION_RECORDED) != 0;
        config.motion = motion_mean;
        config.context = &run->motion;
    }
    run->chip = mpu9250_chip_new(&config);
    if (run->chip == NULL ||
        !machine_init(&run->machine, run->chip, options->seed, 0)) {
        return complain("libsimavr", "has no atmega328p");
    }
    struct machine *machine = &run->machine;
    machine->context = run;
    machine->on_byte = on_byte;
    machine->on_mark = on_mark;
    machine->on_data_ready = on_data_ready;
    machine->on_bus = on_bus;
    machine->on_eeprom_write = on_eeprom_write;
    machine->on_reset = on_reset;
    if (!image_load(&run->image, options->image, machine)) {
        return complain(options->image, "is no image of an ATmega328P; pio run -e nano "
                                        "makes one");
    }
    if (options->profile != NULL) {
        run->profile = profile_new(machine, options->image);
        if (run->profile == NULL) {
            return complain(options->image, "has no symbols to profile by");
        }
    }
    if (options->parts != NULL && !profile_read_parts(run->profile, options->parts)) {
        return complain(options->parts, "has other lines than START END PART");
    }
    if (options->eeprom != NULL && !load_eeprom(run)) {
        return complain(options->eeprom, "is no EEPROM of 1024 bytes");
    }
    if (options->record != NULL) {
        run->record = fopen(options->record, "wb");
        if (run->record == NULL) {
            return complain(options->record, "can't be written");
        }
    }
    if (options->pty != NULL) {
        run->cable = malloc(sizeof *run->cable);
        if (run->cable == NULL) {
            return complain(options->pty, "does not fit into memory");
        }
        const char *problem = cable_open(run->cable, options->pty);
        if (problem != NULL) {
            return complain(options->pty, problem);
        }
        (void)fprintf(stderr, "ready %s\n", options->pty);
    }
    schedule_at_power_up(run);
    return 0;
}

static int finish(struct run *run, bool is_good) {
    const struct options *options = &run->options;
    int code = is_good ? 0 : 1;
    if (run->record != NULL && fclose(run->record) != 0) {
        (void)complain(options->record, "can't be written");
        code = 1;
    }
    if (run->cable != NULL) {
        cable_flush(run->cable);
    }
    const struct summary summary = summarize(run, is_good);
    say_summary(run, &summary);
    if (options->summary != NULL && !write_summary(run, &summary)) {
        (void)complain(options->summary, "can't be written");
        code = 1;
    }
    if (run->profile != NULL && !profile_write(run->profile, options->profile)) {
        (void)complain(options->profile, "can't be written");
        code = 1;
    }
    if (options->eeprom != NULL && !save_eeprom(run)) {
        (void)complain(options->eeprom, "can't be written");
        code = 1;
    }
    if (run->cable != NULL) {
        cable_close(run->cable);
        free(run->cable);
    }
    return code;
}

int main(int argc, char **argv) {
    (void)argc;             // the list ends with a null
    static struct run run;  // too big for the stack
    const int stop = parse_options(argv + 1, &run.options);
    if (stop != 0) {
        return stop - 1;
    }
    struct sigaction action = {.sa_handler = on_signal};
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGINT, &action, NULL);
    (void)signal(SIGPIPE, SIG_IGN);
    const int problem = set_up(&run);
    if (problem != 0) {
        if (run.cable != NULL) {
            cable_close(run.cable);
        }
        return problem;
    }
    const bool is_good = run_all(&run);
    const int code = finish(&run, is_good);
    profile_free(run.profile);
    motion_close(&run.motion);
    machine_free(&run.machine);
    mpu9250_chip_free(run.chip);
    return code;
}
