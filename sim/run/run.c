// SPDX-License-Identifier: MIT
// A run of a virtual board from its start to its end, in real time or as fast as it
// goes; see run.h.
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "events.h"
#include "options.h"
#include "run.h"
#include "summary.h"

enum {
    TICK_US = 1000,             // how often cable and wall clock are looked at
    SETTLE_US = 20000,          // time for frames to leave after the last record
    PACE_SLACK_NS = 200000000,  // a larger delay is not caught up
    // With --now: the steps of the host's time. No large delay is caught up, because
    // time would run too fast for the host.
    NOW_TICK_US = 100,
    NOW_SLACK_NS = 1000000,
};

static volatile sig_atomic_t wants_stop;

bool run_has_ready(const char *ready) {
    return ready == NULL || strcmp(ready, "wire") == 0;
}

const char *run_check_ready(const char *ready) {
    const bool is_known = run_has_ready(ready) || strcmp(ready, "none") == 0;
    return is_known ? NULL : "--ready is wire or none";
}

static void on_signal(int number) {
    (void)number;
    wants_stop = 1;
}

// What survives power

static bool read_memory(struct run *run) {
    FILE *file = fopen(run->options.memory, "rb");
    if (file == NULL) {
        return errno == ENOENT;  // no file: an erased memory
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

// The run

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
        return run_tick_of(run, (uint64_t)llround(options->seconds * 1e6));
    }
    if (options->motion == NULL) {
        return RUN_NEVER;
    }
    const uint64_t now = board->now(run->self);
    if (!motion_is_over(&run->motion, (int64_t)board->nanoseconds(now))) {
        return RUN_NEVER;
    }
    return run_tick_of(run, RUN_MOTION_AFTER_US + SETTLE_US) +
           (uint64_t)ceil((double)(run->motion.read - 1) / run->motion.rate_hz *
                          ticks_per_s);
}

static int64_t wall_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

// The host's time: what it is told by --now, or the wall clock.
static int64_t host_ns(const struct run *run) {
    return run->now_ns == NULL ? wall_ns() : atomic_load(run->now_ns);
}

// Converts a device time to nanoseconds of the host's time since power came, with the
// clock's error.
static int64_t after_power(const struct run *run, uint64_t tick) {
    const double device_ns = (double)run->board->nanoseconds(tick);
    const double device_s = device_ns * 1e-9;
    const double fast_ppm =
        run->options.clock_ppm + run->options.drift / 2.0 * device_s;
    return llround(device_ns - device_ns * fast_ppm * 1e-6);
}

// Waits until the wall clock has come as far as the device. Tells the host's time.
static void pace(struct run *run) {
    const int64_t run_ns = after_power(run, run->board->now(run->self));
    const int64_t slack_ns = run->now_ns == NULL ? PACE_SLACK_NS : NOW_SLACK_NS;
    const int64_t ahead = run->pace_ns + run_ns - wall_ns();
    if (ahead > 0) {
        const struct timespec wait = {.tv_sec = ahead / 1000000000,
                                      .tv_nsec = ahead % 1000000000};
        (void)nanosleep(&wait, NULL);
    } else if (ahead < -slack_ns) {
        run->pace_ns -= ahead;
    }
    if (run->now_ns == NULL) {
        run->power_ns = run->pace_ns;
    } else {
        atomic_store(run->now_ns, run->power_ns + run_ns);
    }
}

// Whether bytes to the host are held back now, as by a USB adapter, which delivers at
// multiples of its latency, or by a busy host, which reads nothing for a while once a
// second.
static bool is_held(const struct run *run) {
    const double now_ms = (double)(host_ns(run) - run->power_ns) * 1e-6;
    const double batch_ms = run->options.batch_ms;
    if (batch_ms > 0.0 && fmod(now_ms, batch_ms) >= TICK_US / 1000.0) {
        return true;
    }
    const double second = floor(now_ms / 1000.0);
    const double room_ms = 1000.0 - run->options.burst_ms;
    // Multiples of the golden ratio spread these moments evenly over the second.
    const double from_ms = fmod(second * 0.6180339887, 1.0) * room_ms;
    const double in_second_ms = now_ms - second * 1000.0;
    return in_second_ms >= from_ms && in_second_ms < from_ms + run->options.burst_ms;
}

void run_on_byte(void *context, uint8_t byte) {
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

static void exchange(struct run *run, bool is_paced) {
    if (run->options.resets_on_open && cable_was_opened(run->cable)) {
        static const struct fault reset = {.target = FAULT_RESET};
        run->board->suffer(run->self, &reset);
    }
    if (!is_held(run)) {
        cable_flush(run->cable);
    }
    // Take no more from the sender than the line can carry in a tick.
    if (run->inbox_count == 0 &&
        run->board->line_count(run->self) < sizeof run->inbox) {
        run->inbox_count = cable_get(run->cable, run->inbox, sizeof run->inbox);
        run->inbox_ns = host_ns(run);
    }
    // Where the board is behind the host's time, a byte must not be received before it
    // was sent.
    const int64_t now_ns = run->power_ns + after_power(run, run->board->now(run->self));
    if (is_paced && now_ns < run->inbox_ns) {
        return;
    }
    for (size_t i = 0; i < run->inbox_count; i++) {
        (void)run->board->send(run->self, 0, run->inbox[i]);
    }
    run->inbox_count = 0;
}

// False when the processor can't continue.
static bool run_all(struct run *run) {
    const struct run_board *board = run->board;
    const uint64_t tick_us = run->now_ns == NULL ? TICK_US : NOW_TICK_US;
    const uint64_t step = tick_us * board->ticks_per_us;
    const bool is_paced = run->cable != NULL && !run->options.is_fast;
    run->power_ns = run->pace_ns = is_paced ? host_ns(run) : 0;
    uint64_t tick = 0;
    while (wants_stop == 0 && !run->is_over) {
        uint64_t until = tick + step;
        if (!run->is_scheduled) {
            until = board->now(run->self) + board->ticks_per_us;
        }
        const uint64_t event = run_next_event(run);
        const uint64_t end = end_tick(run);
        until = event < until ? event : until;
        until = end < until ? end : until;
        if (!board->run(run->self, until)) {
            return false;
        }
        const uint64_t now = board->now(run->self);
        if (!run->is_scheduled && board->clock_start(run->self) != RUN_NEVER) {
            run_schedule(run);
        }
        run_do_events(run);
        if (now >= end) {
            break;
        }
        if (now >= tick + step) {
            tick += step;
            // Pace first, so that no byte comes before its time.
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

// Set-up

static int begin_profile(struct run *run) {
    const struct run_options *options = &run->options;
    const struct run_board *board = run->board;
    run->profile = profile_new(options->image, board->code_start, board->code_size);
    if (run->profile == NULL) {
        return run_complain(run, options->image, "has no symbols to profile by");
    }
    board->watch(run->self, run->profile);
    return 0;
}

static int open_now(struct run *run) {
    const char *path = run->options.now;
    const int file = open(path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (file < 0) {
        return run_complain(run, path, "can't be written");
    }
    void *map = MAP_FAILED;
    if (ftruncate(file, sizeof *run->now_ns) == 0) {
        map = mmap(NULL, sizeof *run->now_ns, PROT_READ | PROT_WRITE, MAP_SHARED, file,
                   0);
    }
    (void)close(file);
    if (map == MAP_FAILED) {
        return run_complain(run, path, "can't be written");
    }
    run->now_ns = map;
    atomic_store(run->now_ns, wall_ns());
    return 0;
}

static int set_up(struct run *run) {
    const struct run_options *options = &run->options;
    if (options->faults != NULL && !faults_load(&run->faults, options->faults,
                                                run->board->fault_kinds(run->self))) {
        return run_complain(run, options->faults, run->faults.problem);
    }
    if (options->motion != NULL) {
        const char *problem = motion_open(&run->motion, options->motion);
        if (problem != NULL) {
            return run_complain(run, options->motion, problem);
        }
    }
    int code = run->board->power_up(run->self, run);
    if (code == 0 && options->profile != NULL) {
        code = begin_profile(run);
    }
    if (code != 0) {
        return code;
    }
    if (options->record != NULL) {
        run->record = fopen(options->record, "wb");
        if (run->record == NULL) {
            return run_complain(run, options->record, "can't be written");
        }
    }
    if (options->now != NULL && (code = open_now(run)) != 0) {
        return code;
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
    run_schedule_at_power_up(run);
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
    if (!run_summarize(run, is_good)) {
        code = 1;
    }
    if (run->board->finish != NULL && !run->board->finish(run->self)) {
        code = 1;
    }
    if (run->profile != NULL && !profile_write(run->profile, options->profile)) {
        (void)run_complain(run, options->profile, "can't be written");
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
    const int stop = run_parse_options(run, arguments);
    if (stop != 0) {
        return stop - 1;
    }
    struct sigaction action = {.sa_handler = on_signal};
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGINT, &action, NULL);
    (void)signal(SIGPIPE, SIG_IGN);
    int code = set_up(run);
    if (code == 0) {
        code = finish(run, run_all(run));
        code = run->is_misused ? 2 : code;
        motion_close(&run->motion);
    } else if (run->cable != NULL) {
        cable_close(run->cable);
    }
    profile_free(run->profile);
    return code;
}
