// SPDX-License-Identifier: MIT
// Follows the image call by call; see profile.h.
#include "profile.h"

#include <fcntl.h>
#include <gelf.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum {
    FLASH_WORDS = 16384,
    NAMES_MAX = 1024,
    NAME_SIZE = 64,
    DEPTH_MAX = 64,   // frames of 2 bytes and more in 2 KB; the deepest here is 12
    PART_CALLER = 0,  // of the part that called
    PART_REST = 1,    // of none
};

// Cycles of one name.
struct tally {
    uint64_t in_samples, outside;
    uint64_t worst;     // of a sample
    uint64_t in_worst;  // of the sample that took longest in all
    uint64_t now;       // of the sample at work
};

struct names {
    char text[NAMES_MAX][NAME_SIZE];
    uint16_t count;
};

struct frame {
    uint16_t sp;     // before the call
    uint16_t from;   // word address of the call, or what was interrupted
    uint16_t entry;  // word address of what was called
    bool is_interrupt;
    uint64_t cycles;  // of an interrupt, so far
};

struct profile {
    struct machine *machine;
    struct names functions, parts;
    uint16_t function_at[FLASH_WORDS], part_at[FLASH_WORDS];
    struct tally self[NAMES_MAX], inclusive[NAMES_MAX], part[NAMES_MAX], total;
    struct {
        uint64_t calls, cycles, worst;
    } interrupts[NAMES_MAX];  // by function
    uint32_t stamp[NAMES_MAX], stamp_now;

    struct frame stack[DEPTH_MAX];
    unsigned depth;
    uint64_t lost;  // calls deeper than that

    // Cycles not yet attributed are all of this function and part, under this stack.
    uint64_t pending;
    uint16_t function_now, part_now;
    uint64_t seen_cycle, seen_asleep;
    bool is_working;
    uint64_t samples;
};

// Names

static int find_name(struct names *names, const char *text) {
    for (int i = 0; i < names->count; i++) {
        if (strcmp(names->text[i], text) == 0) {
            return i;
        }
    }
    if (names->count == NAMES_MAX || strlen(text) >= NAME_SIZE) {
        return -1;
    }
    (void)snprintf(names->text[names->count], NAME_SIZE, "%s", text);
    return names->count++;
}

struct symbol {
    char name[NAME_SIZE];
    uint32_t start, size;
    bool is_function;
};

// Functions first, so that a label inside one doesn't take its name.
static int by_address(const void *left, const void *right) {
    const struct symbol *a = left;
    const struct symbol *b = right;
    if (a->start != b->start) {
        return a->start < b->start ? -1 : 1;
    }
    if (a->is_function != b->is_function) {
        return a->is_function ? -1 : 1;
    }
    return strcmp(a->name, b->name);
}

// Symbols of code, by address.
static struct symbol *read_symbols(const char *image, size_t *count) {
    struct symbol *symbols = NULL;
    *count = 0;
    const int file = open(image, O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return NULL;
    }
    (void)elf_version(EV_CURRENT);
    Elf *elf = elf_begin(file, ELF_C_READ, NULL);
    for (Elf_Scn *section = elf_nextscn(elf, NULL); section != NULL;
         section = elf_nextscn(elf, section)) {
        GElf_Shdr header;
        Elf_Data *data = elf_getdata(section, NULL);
        if (gelf_getshdr(section, &header) == NULL || header.sh_type != SHT_SYMTAB ||
            header.sh_entsize == 0 || data == NULL) {
            continue;
        }
        const size_t all = header.sh_size / header.sh_entsize;
        symbols = calloc(all + 1, sizeof *symbols);
        for (size_t i = 0; symbols != NULL && i < all; i++) {
            GElf_Sym symbol;
            GElf_Shdr home;
            if (gelf_getsym(data, (int)i, &symbol) == NULL ||
                gelf_getshdr(elf_getscn(elf, symbol.st_shndx), &home) == NULL ||
                (home.sh_flags & SHF_EXECINSTR) == 0 ||
                GELF_ST_TYPE(symbol.st_info) == STT_SECTION ||
                GELF_ST_TYPE(symbol.st_info) == STT_FILE) {
                continue;
            }
            const char *name = elf_strptr(elf, header.sh_link, symbol.st_name);
            if (name == NULL || name[0] == '\0') {
                continue;
            }
            struct symbol *kept = &symbols[(*count)++];
            (void)snprintf(kept->name, sizeof kept->name, "%.*s", NAME_SIZE - 1, name);
            kept->start = (uint32_t)symbol.st_value;
            kept->size = (uint32_t)symbol.st_size;
            kept->is_function = GELF_ST_TYPE(symbol.st_info) == STT_FUNC;
        }
        break;
    }
    (void)elf_end(elf);
    (void)close(file);
    if (symbols != NULL) {
        qsort(symbols, *count, sizeof *symbols, by_address);
    }
    return symbols;
}

// The number under which a symbol is known. Static functions of one name in several
// files are told apart by their address.
static int name_symbol(struct names *names, const struct symbol *all, size_t count,
                       const struct symbol *symbol) {
    char text[NAME_SIZE + 8];
    for (size_t i = 0; i < count; i++) {
        if (all[i].start != symbol->start && strcmp(all[i].name, symbol->name) == 0) {
            (void)snprintf(text, sizeof text, "%s@%" PRIx32, symbol->name,
                           symbol->start);
            return find_name(names, text);
        }
    }
    return find_name(names, symbol->name);
}

// Each word belongs to the function that spans it, or else to the symbol before it.
static bool name_functions(struct profile *profile, const char *image) {
    size_t count = 0;
    struct symbol *symbols = read_symbols(image, &count);
    bool is_good = count > 0;
    (void)find_name(&profile->functions, "");
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; is_good && i < count; i++) {
            const struct symbol *symbol = &symbols[i];
            const bool is_spanned = symbol->size > 0;
            if (is_spanned != (pass == 1)) {
                continue;
            }
            const int name = name_symbol(&profile->functions, symbols, count, symbol);
            const uint32_t end =
                is_spanned ? (symbol->start + symbol->size + 1) / 2 : FLASH_WORDS;
            is_good = name >= 0 && end <= FLASH_WORDS;
            for (uint32_t at = symbol->start / 2; is_good && at < end; at++) {
                profile->function_at[at] = (uint16_t)name;
            }
        }
    }
    free(symbols);
    return is_good;
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

// The part of the innermost code that has one; an interrupt's ends with its handler.
static uint16_t part_of(const struct profile *profile) {
    uint16_t part = profile->part_now;
    for (unsigned i = profile->depth; part == PART_CALLER && i-- > 0;) {
        const struct frame *frame = &profile->stack[i];
        part = profile->part_at[frame->entry];
        if (part == PART_CALLER) {
            if (frame->is_interrupt) {
                break;
            }
            part = profile->part_at[frame->from];
        }
    }
    return part == PART_CALLER ? PART_REST : part;
}

static void settle(struct profile *profile) {
    if (profile->pending == 0) {
        return;
    }
    profile->stamp_now++;
    add(profile, &profile->total);
    add(profile, &profile->self[profile->function_now]);
    add(profile, &profile->part[part_of(profile)]);
    add_once(profile, profile->function_now);
    for (unsigned i = profile->depth; i-- > 0;) {
        struct frame *frame = &profile->stack[i];
        add_once(profile, profile->function_at[frame->entry]);
        if (frame->is_interrupt) {
            frame->cycles += profile->pending;
            break;
        }
        add_once(profile, profile->function_at[frame->from]);
    }
    profile->pending = 0;
}

// Cycles since the last look, those asleep left out.
static uint64_t take_cycles(struct profile *profile) {
    const uint64_t cycle = machine_now(profile->machine);
    const uint64_t asleep = profile->machine->asleep;
    const uint64_t cycles =
        cycle - profile->seen_cycle - (asleep - profile->seen_asleep);
    profile->seen_cycle = cycle;
    profile->seen_asleep = asleep;
    return cycles;
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

// After a return: whatever was called from deeper is over, however it ended.
static void pop(struct profile *profile, uint16_t sp) {
    settle(profile);
    while (profile->depth > 0 && profile->stack[profile->depth - 1].sp <= sp) {
        const struct frame *frame = &profile->stack[--profile->depth];
        if (frame->is_interrupt) {
            const uint16_t function = profile->function_at[frame->entry];
            profile->interrupts[function].calls++;
            profile->interrupts[function].cycles += frame->cycles;
            if (frame->cycles > profile->interrupts[function].worst) {
                profile->interrupts[function].worst = frame->cycles;
            }
        }
    }
}

static uint16_t word_of(uint32_t byte_address) {
    return (uint16_t)(byte_address / 2 % FLASH_WORDS);
}

// CALL, ICALL, RCALL (instruction set manual, DS40002198). RCALL to the next
// instruction makes room on the stack, and nothing else.
static bool is_call(uint16_t opcode, uint16_t at, uint16_t next) {
    return (opcode & 0xFE0E) == 0x940E || opcode == 0x9509 ||
           ((opcode & 0xF000) == 0xD000 && next != at + 1);
}

static bool is_return(uint16_t opcode) {
    return opcode == 0x9508 || opcode == 0x9518;  // RET, RETI
}

static uint16_t opcode_at(const struct profile *profile, uint16_t word) {
    const uint8_t *flash = profile->machine->avr->flash + 2 * (word % FLASH_WORDS);
    return (uint16_t)(flash[0] | (flash[1] << 8));
}

static void on_instruction(void *context, uint32_t at_byte, uint32_t next_byte) {
    struct profile *profile = context;
    const uint16_t at = word_of(at_byte);
    const uint16_t next = word_of(next_byte);
    const uint16_t function = profile->function_at[at];
    const uint16_t part = profile->part_at[at];
    if (function != profile->function_now || part != profile->part_now) {
        settle(profile);
        profile->function_now = function;
        profile->part_now = part;
    }
    profile->pending += take_cycles(profile);
    const uint16_t opcode = opcode_at(profile, at);
    const uint16_t sp = machine_sp(profile->machine);
    if (is_call(opcode, at, next)) {
        push(profile,
             (struct frame){.sp = (uint16_t)(sp + 2), .from = at, .entry = next});
    } else if (is_return(opcode)) {
        pop(profile, sp);
    }
}

// The handler that a vector's JMP or RJMP leads to.
static uint16_t handler_of(const struct profile *profile, uint16_t vector) {
    const uint16_t opcode = opcode_at(profile, vector);
    if ((opcode & 0xFE0E) == 0x940C) {
        return opcode_at(profile, (uint16_t)(vector + 1)) % FLASH_WORDS;
    }
    if ((opcode & 0xF000) == 0xC000) {
        const uint16_t offset = (uint16_t)((opcode & 0x0FFF) ^ 0x0800);
        return (uint16_t)(vector + 1 + offset - 0x0800) % FLASH_WORDS;
    }
    return vector;
}

// The jumps of the table are of the handlers.
static void name_vectors(struct profile *profile) {
    for (int i = 0; i < MACHINE_VECTORS; i++) {
        const uint16_t vector = (uint16_t)(2 * i);
        const uint16_t handler = handler_of(profile, vector);
        profile->function_at[vector] = profile->function_at[handler];
        profile->part_at[vector] = profile->part_at[handler];
    }
}

static void on_interrupt(void *context, uint32_t from_byte, uint32_t vector_byte) {
    struct profile *profile = context;
    const uint16_t vector = word_of(vector_byte);
    push(profile, (struct frame){.sp = (uint16_t)(machine_sp(profile->machine) + 2),
                                 .from = word_of(from_byte),
                                 .entry = handler_of(profile, vector),
                                 .is_interrupt = true});
    profile->function_now = profile->function_at[vector];
    profile->part_now = profile->part_at[vector];
    profile->pending += take_cycles(profile);
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
    for (int i = 0; i < profile->parts.count; i++) {
        close_tally(&profile->part[i], is_sample, is_worst);
    }
}

// Called while the OUT that marks is under way, with its cycle still to come: the first
// one counts for the sample, the last one doesn't.
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

void profile_reset(struct profile *profile) {
    close_sample(profile, false);
    profile->depth = 0;
    (void)take_cycles(profile);
}

// Life

bool profile_read_parts(struct profile *profile, const char *path) {
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        return false;
    }
    unsigned start = 0;
    unsigned end = 0;
    char name[NAME_SIZE];
    int fields;
    bool is_good = true;
    while (is_good && (fields = fscanf(file, "%x %x %63s", &start, &end, name)) == 3) {
        const int part =
            strcmp(name, "-") == 0 ? PART_CALLER : find_name(&profile->parts, name);
        is_good = part >= 0 && start <= end && end <= 2 * FLASH_WORDS;
        for (unsigned at = start / 2; is_good && at < end / 2; at++) {
            profile->part_at[at] = (uint16_t)part;
        }
    }
    is_good = is_good && fields == EOF && ferror(file) == 0;
    (void)fclose(file);
    name_vectors(profile);
    return is_good;
}

struct profile *profile_new(struct machine *machine, const char *image) {
    struct profile *profile = calloc(1, sizeof *profile);
    if (profile == NULL) {
        return NULL;
    }
    profile->machine = machine;
    (void)find_name(&profile->parts, "-");
    (void)find_name(&profile->parts, "rest");
    for (int i = 0; i < FLASH_WORDS; i++) {
        profile->part_at[i] = PART_REST;
    }
    if (!name_functions(profile, image)) {
        free(profile);
        return NULL;
    }
    name_vectors(profile);
    machine->watch = (struct machine_watch){profile, on_instruction, on_interrupt};
    return profile;
}

void profile_free(struct profile *profile) {
    free(profile);
}

static void write_tally(FILE *file, const char *name, const struct tally *tally,
                        const char *end) {
    (void)fprintf(file,
                  "\"%s\": {\"cycles\": %" PRIu64 ", \"worst\": %" PRIu64
                  ", \"in_worst\": %" PRIu64 ", \"outside\": %" PRIu64 "}%s",
                  name, tally->in_samples, tally->worst, tally->in_worst,
                  tally->outside, end);
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
    write_tally(file, "total", &profile->total, ",\n  \"parts\": {");
    const char *between = "\n    ";
    for (int i = 0; i < profile->parts.count; i++) {
        const struct tally *part = &profile->part[i];
        if (part->in_samples + part->outside > 0) {
            (void)fputs(between, file);
            write_tally(file, profile->parts.text[i], part, "");
            between = ",\n    ";
        }
    }
    (void)fputs("\n  },\n  \"functions\": {", file);
    between = "\n    ";
    for (int i = 0; i < profile->functions.count; i++) {
        const struct tally *all = &profile->inclusive[i];
        if (all->in_samples + all->outside > 0) {
            (void)fprintf(file, "%s\"%s\": {", between, profile->functions.text[i]);
            write_tally(file, "self", &profile->self[i], ", ");
            write_tally(file, "inclusive", all, "}");
            between = ",\n    ";
        }
    }
    (void)fputs("\n  },\n  \"interrupts\": {", file);
    between = "\n    ";
    for (int i = 0; i < profile->functions.count; i++) {
        if (profile->interrupts[i].calls > 0) {
            (void)fprintf(file,
                          "%s\"%s\": {\"calls\": %" PRIu64 ", \"cycles\": %" PRIu64
                          ", \"worst\": %" PRIu64 "}",
                          between, profile->functions.text[i],
                          profile->interrupts[i].calls, profile->interrupts[i].cycles,
                          profile->interrupts[i].worst);
            between = ",\n    ";
        }
    }
    (void)fputs("\n  }\n}\n", file);
    return fclose(file) == 0;
}
