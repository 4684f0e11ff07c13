// SPDX-License-Identifier: MIT
// Follows the calls of an image; see profile.h.
#include "profile.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "symbols.h"

enum {
    NAMES_MAX = 1024,
    DEPTH_MAX = 64,  // frames; the deepest of the images here is 12
};

// Cycles of one name.
struct tally {
    uint64_t in_samples, outside;
    uint64_t worst;     // of a sample
    uint64_t in_worst;  // in the longest sample
    uint64_t now;       // in the current sample
};

struct names {
    char text[NAMES_MAX][SYMBOL_NAME_SIZE];
    uint16_t count;
};

struct frame {
    struct profile_call call;
    bool is_interrupt;
    uint64_t cycles;  // of an interrupt so far
};

struct profile {
    uint32_t start, count;  // of the code: address of a byte, instructions at most
    struct names functions;
    uint16_t *function_at;  // by place; one more for all places elsewhere
    struct tally self[NAMES_MAX], inclusive[NAMES_MAX], total;
    struct {
        uint64_t calls, cycles, worst;
    } interrupts[NAMES_MAX];  // by function
    uint32_t stamp[NAMES_MAX], stamp_now;

    struct frame stack[DEPTH_MAX];
    unsigned depth;
    uint64_t lost;  // calls deeper than that

    // Cycles not yet attributed; all belong to this function, under this stack.
    uint64_t pending;
    uint16_t function_now;
    uint64_t seen_cycle, seen_asleep;
    bool is_working;
    uint64_t samples;
};

// Index in the arrays of the instruction at that address.
static uint32_t place_of(const struct profile *profile, uint32_t address) {
    const uint32_t place = (address - profile->start) / 2;
    return place < profile->count ? place : profile->count;
}

// Names

static int find_name(struct names *names, const char *text) {
    for (int i = 0; i < names->count; i++) {
        if (strcmp(names->text[i], text) == 0) {
            return i;
        }
    }
    if (names->count == NAMES_MAX || strlen(text) >= SYMBOL_NAME_SIZE) {
        return -1;
    }
    (void)snprintf(names->text[names->count], SYMBOL_NAME_SIZE, "%s", text);
    return names->count++;
}

// The number of a symbol's name. Static functions of the same name in several files are
// told apart by their addresses.
static int name_symbol(struct names *names, const struct symbol *all, size_t count,
                       const struct symbol *symbol) {
    char text[SYMBOL_NAME_SIZE + 8];
    for (size_t i = 0; i < count; i++) {
        if (all[i].start != symbol->start && strcmp(all[i].name, symbol->name) == 0) {
            (void)snprintf(text, sizeof text, "%s@%" PRIx32, symbol->name,
                           symbol->start);
            return find_name(names, text);
        }
    }
    return find_name(names, symbol->name);
}

// Each instruction belongs to the function that spans it, or else to the symbol before
// it.
static bool name_functions(struct profile *profile, const char *image) {
    size_t count = 0;
    struct symbol *symbols = symbols_read(image, &count);
    bool is_good = count > 0;
    (void)find_name(&profile->functions, "");
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; is_good && i < count; i++) {
            const struct symbol *symbol = &symbols[i];
            const bool is_spanned = symbol->size > 0;
            const uint32_t from = place_of(profile, symbol->start);
            if (is_spanned != (pass == 1) || from == profile->count) {
                continue;  // code in RAM is not counted by function
            }
            const int name = name_symbol(&profile->functions, symbols, count, symbol);
            const uint32_t length = (symbol->size + 1) / 2;
            const uint32_t end = is_spanned ? from + length : profile->count;
            is_good = name >= 0 && end <= profile->count;
            for (uint32_t at = from; is_good && at < end; at++) {
                profile->function_at[at] = (uint16_t)name;
            }
        }
    }
    free(symbols);
    return is_good;
}

static uint16_t function_of(const struct profile *profile, uint32_t address) {
    return profile->function_at[place_of(profile, address)];
}

// Attribution

static void add(const struct profile *profile, struct tally *tally) {
    if (profile->is_working) {
        tally->now += profile->pending;
    } else {
        tally->outside += profile->pending;
    }
}

static void add_once(struct profile *profile, uint16_t function) {
    if (profile->stamp[function] != profile->stamp_now) {
        profile->stamp[function] = profile->stamp_now;
        add(profile, &profile->inclusive[function]);
    }
}

static void settle(struct profile *profile) {
    if (profile->pending == 0) {
        return;
    }
    profile->stamp_now++;
    add(profile, &profile->total);
    add(profile, &profile->self[profile->function_now]);
    add_once(profile, profile->function_now);
    for (unsigned i = profile->depth; i-- > 0;) {
        struct frame *frame = &profile->stack[i];
        add_once(profile, function_of(profile, frame->call.entry));
        if (frame->is_interrupt) {
            frame->cycles += profile->pending;
            break;
        }
        add_once(profile, function_of(profile, frame->call.from));
    }
    profile->pending = 0;
}

static void take_cycles(struct profile *profile, struct profile_time now) {
    profile->pending += now.cycle - profile->seen_cycle;
    profile->pending -= now.asleep - profile->seen_asleep;
    profile->seen_cycle = now.cycle;
    profile->seen_asleep = now.asleep;
}

static void enter(struct profile *profile, uint32_t address) {
    const uint16_t function = function_of(profile, address);
    if (function != profile->function_now) {
        settle(profile);
        profile->function_now = function;
    }
}

void profile_instruction(struct profile *profile, uint32_t address,
                         struct profile_time now) {
    enter(profile, address);
    take_cycles(profile, now);
}

// The stack

static void push(struct profile *profile, struct frame frame) {
    settle(profile);
    if (profile->depth == DEPTH_MAX) {
        profile->lost++;
        return;
    }
    profile->stack[profile->depth++] = frame;
}

static void pop(struct profile *profile) {
    const struct frame *frame = &profile->stack[--profile->depth];
    if (frame->is_interrupt) {
        const uint16_t function = function_of(profile, frame->call.entry);
        profile->interrupts[function].calls++;
        profile->interrupts[function].cycles += frame->cycles;
        if (frame->cycles > profile->interrupts[function].worst) {
            profile->interrupts[function].worst = frame->cycles;
        }
    }
}

void profile_call(struct profile *profile, struct profile_call call) {
    push(profile, (struct frame){.call = call});
}

void profile_interrupt(struct profile *profile, struct profile_call call,
                       struct profile_time now) {
    push(profile, (struct frame){.call = call, .is_interrupt = true});
    enter(profile, call.entry);
    take_cycles(profile, now);
}

void profile_return_above(struct profile *profile, uint32_t sp) {
    settle(profile);
    while (profile->depth > 0 && profile->stack[profile->depth - 1].call.sp <= sp) {
        pop(profile);
    }
}

void profile_return_to(struct profile *profile, uint32_t address, uint32_t sp) {
    unsigned depth = profile->depth;
    while (depth > 0 && !profile->stack[depth - 1].is_interrupt) {
        const struct profile_call *call = &profile->stack[--depth].call;
        if (call->back == address && call->sp == sp) {
            settle(profile);
            while (profile->depth > depth) {
                pop(profile);
            }
            return;
        }
    }
}

void profile_leave(struct profile *profile) {
    settle(profile);
    while (profile->depth > 0) {
        const bool is_last = profile->stack[profile->depth - 1].is_interrupt;
        pop(profile);
        if (is_last) {
            break;
        }
    }
}

// Samples

static void close_tally(struct tally *tally, bool is_sample, bool is_worst) {
    if (is_sample) {
        tally->in_samples += tally->now;
        tally->worst = tally->now > tally->worst ? tally->now : tally->worst;
        tally->in_worst = is_worst ? tally->now : tally->in_worst;
    } else {
        tally->outside += tally->now;
    }
    tally->now = 0;
}

static void close_sample(struct profile *profile, bool is_sample) {
    settle(profile);
    profile->is_working = false;
    profile->samples += is_sample ? 1 : 0;
    const bool is_worst = profile->total.now > profile->total.worst;
    close_tally(&profile->total, is_sample, is_worst);
    for (int i = 0; i < profile->functions.count; i++) {
        close_tally(&profile->self[i], is_sample, is_worst);
        close_tally(&profile->inclusive[i], is_sample, is_worst);
    }
}

// Called during the store that marks, before its cycles are reported: those of the
// first store count for the sample, those of the last one don't.
void profile_begin_sample(struct profile *profile) {
    if (profile->is_working) {
        close_sample(profile, false);
    }
    settle(profile);
    profile->is_working = true;
}

void profile_end_sample(struct profile *profile) {
    if (profile->is_working) {
        close_sample(profile, true);
    }
}

void profile_reset(struct profile *profile, struct profile_time now) {
    close_sample(profile, false);
    profile->depth = 0;
    take_cycles(profile, now);
    profile->pending = 0;
}

// Life

void profile_same(struct profile *profile, uint32_t address, uint32_t as) {
    const uint32_t place = place_of(profile, address);
    if (place < profile->count) {
        profile->function_at[place] = function_of(profile, as);
    }
}

struct profile *profile_new(const char *image, uint32_t start, uint32_t size) {
    struct profile *profile = calloc(1, sizeof *profile);
    if (profile == NULL) {
        return NULL;
    }
    profile->start = start;
    profile->count = size / 2;
    profile->function_at = calloc(profile->count + 1, sizeof *profile->function_at);
    if (profile->function_at == NULL || !name_functions(profile, image)) {
        profile_free(profile);
        return NULL;
    }
    return profile;
}

void profile_free(struct profile *profile) {
    if (profile != NULL) {
        free(profile->function_at);
        free(profile);
    }
}

// A key of JSON (RFC 8259, section 7): a symbol's name may hold any byte but zero.
static void write_key(FILE *file, const char *name) {
    (void)fputc('"', file);
    for (const char *at = name; *at != '\0'; at++) {
        const unsigned char byte = (unsigned char)*at;
        if (byte < 0x20) {
            (void)fprintf(file, "\\u%04x", byte);
        } else {
            if (byte == '"' || byte == '\\') {
                (void)fputc('\\', file);
            }
            (void)fputc(byte, file);
        }
    }
    (void)fputs("\": ", file);
}

static void write_tally(FILE *file, const char *name, const struct tally *tally,
                        const char *end) {
    write_key(file, name);
    (void)fprintf(file,
                  "{\"cycles\": %" PRIu64 ", \"worst\": %" PRIu64
                  ", \"in_worst\": %" PRIu64 ", \"outside\": %" PRIu64 "}%s",
                  tally->in_samples, tally->worst, tally->in_worst, tally->outside,
                  end);
}

static void write_interrupts(FILE *file, const struct profile *profile) {
    (void)fputs("\n  },\n  \"interrupts\": {", file);
    const char *between = "\n    ";
    for (int i = 0; i < profile->functions.count; i++) {
        if (profile->interrupts[i].calls > 0) {
            (void)fputs(between, file);
            write_key(file, profile->functions.text[i]);
            (void)fprintf(file,
                          "{\"calls\": %" PRIu64 ", \"cycles\": %" PRIu64
                          ", \"worst\": %" PRIu64 "}",
                          profile->interrupts[i].calls, profile->interrupts[i].cycles,
                          profile->interrupts[i].worst);
            between = ",\n    ";
        }
    }
}

bool profile_write(struct profile *profile, const char *path) {
    close_sample(profile, false);
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        return false;
    }
    (void)fprintf(file,
                  "{\n  \"samples\": %" PRIu64 ",\n  \"cycles\": %" PRIu64
                  ",\n  \"asleep\": %" PRIu64 ",\n  \"lost_calls\": %" PRIu64 ",\n  ",
                  profile->samples, profile->seen_cycle, profile->seen_asleep,
                  profile->lost);
    write_tally(file, "total", &profile->total, ",\n  \"functions\": {");
    const char *between = "\n    ";
    for (int i = 0; i < profile->functions.count; i++) {
        const struct tally *all = &profile->inclusive[i];
        if (all->in_samples + all->outside > 0) {
            (void)fputs(between, file);
            write_key(file, profile->functions.text[i]);
            (void)fputc('{', file);
            write_tally(file, "self", &profile->self[i], ", ");
            write_tally(file, "inclusive", all, "}");
            between = ",\n    ";
        }
    }
    write_interrupts(file, profile);
    (void)fputs("\n  }\n}\n", file);
    return fclose(file) == 0;
}
