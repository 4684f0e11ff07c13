// SPDX-License-Identifier: MIT
// Runs a filter alone on the ATmega328P: gives it samples, takes its answers, counts
// its cycles and its stack. Links libsimavr (GPL-3), as nano does.
//
// The program has the variables `bench_sample` and `bench_answer` and marks by GPIOR0:
// BENCH_TAKE before a sample (which is there when it goes on), BENCH_STEP before its
// step, BENCH_ANSWER before it makes the answer, BENCH_DONE after.
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "bench.h"
#include "image.h"
#include "machine.h"

static const char usage_text[] =
    "usage: bench --image FILE.elf --samples FILE --answers FILE --summary FILE\n";

struct work {
    uint64_t cycles, worst;
};

struct bench {
    const char *image, *samples, *answers, *summary;
    struct machine machine;
    FILE *in, *out;
    uint16_t sample_at, answer_at;
    uint64_t count, started;
    struct work step, answer;
    uint16_t sp_before, stack;  // bytes, below where the step was called from
    bool is_over;
};

static void end_work(struct work *work, uint64_t cycles) {
    work->cycles += cycles;
    work->worst = cycles > work->worst ? cycles : work->worst;
}

static void on_mark(void *context, uint64_t cycle, uint8_t value) {
    struct bench *bench = context;
    uint8_t *data = bench->machine.avr->data;
    switch (value) {
    case BENCH_TAKE:
        bench->sp_before = machine_sp(&bench->machine);
        if (fread(data + bench->sample_at, BENCH_SAMPLE_SIZE, 1, bench->in) != 1) {
            bench->is_over = true;
            machine_pause(&bench->machine, cycle);
        }
        return;
    case BENCH_STEP:
        bench->started = cycle;
        return;
    case BENCH_ANSWER:
        end_work(&bench->step, cycle - bench->started);
        bench->started = cycle;
        return;
    default:
        end_work(&bench->answer, cycle - bench->started);
        (void)fwrite(data + bench->answer_at, BENCH_ANSWER_SIZE, 1, bench->out);
        bench->count++;
        return;
    }
}

static void on_instruction(void *context, uint32_t at, uint32_t next) {
    (void)at;
    (void)next;
    struct bench *bench = context;
    const uint16_t sp = machine_sp(&bench->machine);
    if (sp < bench->sp_before && bench->sp_before - sp > bench->stack) {
        bench->stack = (uint16_t)(bench->sp_before - sp);
    }
}

static bool parse(struct bench *bench, char **words) {
    const struct {
        const char *name;
        const char **value;
    } options[] = {{"--image", &bench->image},
                   {"--samples", &bench->samples},
                   {"--answers", &bench->answers},
                   {"--summary", &bench->summary}};
    for (; words[0] != NULL; words += 2) {
        bool is_known = false;
        for (size_t i = 0; i < sizeof options / sizeof *options; i++) {
            if (strcmp(words[0], options[i].name) == 0) {
                *options[i].value = words[1];
                is_known = true;
            }
        }
        if (!is_known || words[1] == NULL) {
            return false;
        }
    }
    return bench->image != NULL && bench->samples != NULL && bench->answers != NULL &&
           bench->summary != NULL;
}

static int complain(const char *path, const char *what) {
    (void)fprintf(stderr, "bench: %s %s\n", path, what);
    return 2;
}

static bool write_summary(const struct bench *bench, const struct image *image) {
    FILE *file = fopen(bench->summary, "w");
    if (file == NULL) {
        return false;
    }
    (void)fprintf(file,
                  "{\n  \"samples\": %" PRIu64 ",\n  \"flash\": %" PRIu32
                  ",\n  \"ram\": %" PRIu32 ",\n  \"stack\": %u,\n",
                  bench->count, image->flash, image->ram, bench->stack);
    (void)fprintf(file,
                  "  \"step\": {\"cycles\": %" PRIu64 ", \"worst\": %" PRIu64
                  "},\n  \"answer\": {\"cycles\": %" PRIu64 ", \"worst\": %" PRIu64
                  "}\n}\n",
                  bench->step.cycles, bench->step.worst, bench->answer.cycles,
                  bench->answer.worst);
    return fclose(file) == 0;
}

int main(int argc, char **argv) {
    (void)argc;  // the list ends with a null
    static struct bench bench;
    struct image image;
    struct machine *machine = &bench.machine;
    if (!parse(&bench, argv + 1)) {
        (void)fputs(usage_text, stderr);
        return 2;
    }
    if (!machine_init(machine, &machine_atmega328p, NULL, 1, 0)) {
        return complain("libsimavr", "has no atmega328p");
    }
    machine->context = &bench;
    machine->on_mark = on_mark;
    machine->watch =
        (struct machine_watch){.context = &bench, .on_instruction = on_instruction};
    if (!image_load(&image, bench.image, machine) ||
        !image_find(&image, "bench_sample", &bench.sample_at) ||
        !image_find(&image, "bench_answer", &bench.answer_at)) {
        return complain(bench.image, "is no image of benchmarks/avr");
    }
    bench.in = fopen(bench.samples, "rb");
    bench.out = fopen(bench.answers, "wb");
    if (bench.in == NULL || bench.out == NULL) {
        return complain(bench.in == NULL ? bench.samples : bench.answers,
                        "can't be opened");
    }
    while (!bench.is_over) {
        if (!machine_run(machine, machine_now(machine) + MACHINE_HZ)) {
            (void)fprintf(stderr, "bench: crashed at pc 0x%04x, sp 0x%04x\n",
                          machine_pc(machine), machine_sp(machine));
            return 1;
        }
    }
    const bool is_written = write_summary(&bench, &image);
    (void)fclose(bench.in);
    if (fclose(bench.out) != 0 || !is_written) {
        return complain(is_written ? bench.answers : bench.summary, "can't be written");
    }
    machine_free(machine);
    return 0;
}
