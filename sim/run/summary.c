// SPDX-License-Identifier: MIT
// The summary of a run, as JSON and as text.
#include <inttypes.h>
#include <stdio.h>

#include "events.h"
#include "summary.h"

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
                      text);  // our own text: nothing to escape
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

static void write_numbers(FILE *file, const struct run *run,
                          const struct summary *summary) {
    const struct run_report *report = &summary->report;
    const uint64_t start = run->board->clock_start(run->self);
    const struct {
        const char *name;
        uint64_t value;
    } numbers[] = {
        {"motion_start_us", RUN_MOTION_AFTER_US},
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
    };
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        (void)fprintf(file, "  \"%s\": %" PRIu64 ",\n", numbers[i].name,
                      numbers[i].value);
    }
}

static bool write_summary(const struct run *run, const struct summary *summary) {
    const struct run_report *report = &summary->report;
    FILE *file = fopen(run->options.summary, "w");
    if (file == NULL) {
        return false;
    }
    (void)fputs("{\n", file);
    write_numbers(file, run, summary);
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

bool run_summarize(struct run *run, bool is_good) {
    const struct summary summary = summarize(run, is_good);
    say_summary(run, &summary);
    if (run->options.summary != NULL && !write_summary(run, &summary)) {
        (void)run_complain(run, run->options.summary, "can't be written");
        return false;
    }
    return true;
}

void run_add_number(struct run_report *report, const char *name, uint64_t value) {
    if (report->more_count < RUN_MORE_MAX) {
        report->more[report->more_count++] = (struct run_number){name, value};
    }
}
