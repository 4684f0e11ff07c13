// SPDX-License-Identifier: MIT
// The virtual Pico: the RP2040 is rp2040js, in the process that loads this library
// (pico.mjs); the sensor, the wire, options, faults and the run's pace are those of the
// other virtual boards. Time is in nanoseconds since power came; a double holds those
// of a hundred days.
#include <elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "chips/module.h"
#include "run/line.h"
#include "run/run.h"

#ifndef PICO_VERSION
#define PICO_VERSION "0.1.0"
#endif

enum {
    FLASH_BYTES = 2 << 20,
    FLASH_AT = 0x10000000,
    BYTE_NS = 10851,  // ten bits at 921,600 baud
    FILE_MAX = 64 << 20,
};

// What rp2040js does for this library.
struct machine {
    // Switches power on; the image is in flash. False: it has no such wire.
    bool (*power_up)(const char *wire, const char *rom);
    double (*run)(double until_ns);  // returns the time that it has come to
    void (*receive)(int byte);       // of the wire
    void (*press)(bool is_down);
    void (*reset)(bool is_power);  // by its pin, or by loss of power
};

struct pico {
    struct machine machine;
    struct module *module;
    struct run *run;
    struct line line;
    const char *wire, *ready, *rom, *sensor;
    uint64_t now_ns, pause_ns, free_ns;  // free: when the line may start its next byte
    bool is_ready_high, has_ready_wire;
    uint64_t resets, writes, overruns, asleep_ns;
    uint32_t flash_bytes, stack;
    char complaint[120];
    uint8_t flash[FLASH_BYTES];
};

static struct pico the_pico;
static struct run the_run;

static const char usage_text[] =
    "usage: pico" RUN_OPTIONS "            [--wire usb|uart] [--ready wire|none]\n"
    "            [--sensor NAME]\n"
    "       pico --version\n"
    "--eeprom is what survives power: all of flash, over which the image is put\n"
    "--wire is which of its two ports the host has: usb, unless told otherwise\n"
    "--ready is whether data-ready has a wire: it has, unless told otherwise\n";

#define EXPORT __attribute__((visibility("default")))

// For the machine

static uint64_t at(double ns) {
    the_pico.now_ns = (uint64_t)ns;
    return the_pico.now_ns;
}

static struct i2c_bus *bus(void) {
    return module_bus(the_pico.module);
}

EXPORT uint8_t *pico_flash(void) {
    return the_pico.flash;
}

// The wire of the sensor: START with an address, bytes, STOP. True is an ACK.
EXPORT bool pico_start(double ns, int address, bool is_read) {
    run_on_bus(the_pico.run, true);
    return i2c_bus_start(bus(), at(ns), (uint8_t)address, is_read);
}

EXPORT bool pico_put(double ns, int byte) {
    return i2c_bus_write(bus(), at(ns), (uint8_t)byte);
}

EXPORT int pico_get(double ns, bool ack) {
    return i2c_bus_read(bus(), at(ns), ack);
}

EXPORT void pico_stop(double ns) {
    i2c_bus_stop(bus(), at(ns));
    run_on_bus(the_pico.run, false);
}

// The lines, worked by hand.
EXPORT bool pico_holds_sda(double ns) {
    return i2c_bus_holds_sda(bus(), at(ns));
}

EXPORT void pico_clock(double ns) {
    i2c_bus_scl_pulse(bus(), at(ns));
}

// A byte has left the board.
EXPORT void pico_byte(double ns, int byte) {
    (void)at(ns);
    run_on_byte(the_pico.run, (uint8_t)byte);
}

EXPORT void pico_writes_flash(double ns) {
    (void)at(ns);
    run_on_memory_write(the_pico.run, ++the_pico.writes);
}

EXPORT void pico_was_reset(double ns) {
    (void)at(ns);
    the_pico.resets++;
    run_on_reset(the_pico.run);
}

// Work on a sample begins or is done, as its pin says.
EXPORT void pico_mark(double ns, double cycle, bool is_begin) {
    run_on_mark(the_pico.run, at(ns), (uint64_t)cycle, is_begin);
}

EXPORT void pico_overran(void) {
    the_pico.overruns++;
}

// The deepest that its stack has been.
EXPORT void pico_stack(double bytes) {
    the_pico.stack = (uint32_t)bytes;
}

EXPORT void pico_slept(double ns) {
    the_pico.asleep_ns += (uint64_t)ns;
}

// What the firmware has done that no RP2040 would bear: kept, if it is the first.
EXPORT void pico_complain(const char *text) {
    if (the_pico.complaint[0] == '\0') {
        (void)snprintf(the_pico.complaint, sizeof the_pico.complaint, "%s", text);
    }
}

// Lets sensor and line come to a time. Returns the level of the data-ready pin.
EXPORT bool pico_advance(double ns) {
    struct pico *pico = &the_pico;
    const uint64_t now = at(ns);
    module_advance(pico->module, now);
    const bool is_high = module_pin_is_high(pico->module);
    if (is_high && !pico->is_ready_high) {
        run_on_data_ready(pico->run);
    }
    pico->is_ready_high = is_high;
    while (pico->line.count > 0 && pico->free_ns <= now &&
           line_next(&pico->line) <= now) {
        pico->free_ns = now + BYTE_NS;
        pico->machine.receive(line_take(&pico->line));
    }
    return is_high && pico->has_ready_wire;
}

static uint64_t least(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

static uint64_t most(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

// When pico_advance() has something to do next.
EXPORT double pico_next(void) {
    const struct pico *pico = &the_pico;
    uint64_t next = least(module_next_event(pico->module), pico->pause_ns);
    if (pico->line.count > 0) {
        next = least(next, most(line_next(&pico->line), pico->free_ns));
    }
    return (double)next;
}

// The image

static bool copy_segments(struct pico *pico, const uint8_t *file, size_t size) {
    Elf32_Ehdr header;
    if (size < sizeof header) {
        return false;
    }
    memcpy(&header, file, sizeof header);
    if (memcmp(header.e_ident, ELFMAG, SELFMAG) != 0 ||
        header.e_ident[EI_CLASS] != ELFCLASS32 || header.e_machine != EM_ARM ||
        header.e_phentsize != sizeof(Elf32_Phdr)) {
        return false;
    }
    for (unsigned i = 0; i < header.e_phnum; i++) {
        const uint64_t entry = (uint64_t)header.e_phoff + i * sizeof(Elf32_Phdr);
        Elf32_Phdr segment;
        if (entry + sizeof segment > size) {
            return false;
        }
        memcpy(&segment, file + entry, sizeof segment);
        if (segment.p_type != PT_LOAD || segment.p_filesz == 0) {
            continue;
        }
        const uint32_t to = segment.p_paddr - FLASH_AT;
        if (to > FLASH_BYTES || segment.p_filesz > FLASH_BYTES - to ||
            (uint64_t)segment.p_offset + segment.p_filesz > size) {
            return false;
        }
        memcpy(pico->flash + to, file + segment.p_offset, segment.p_filesz);
        pico->flash_bytes += segment.p_filesz;
    }
    return pico->flash_bytes > 0;
}

static bool load_image(struct pico *pico, const char *path) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return false;
    }
    bool good = fseek(file, 0, SEEK_END) == 0;
    const long size = good ? ftell(file) : -1;
    good = size > 0 && size <= FILE_MAX && fseek(file, 0, SEEK_SET) == 0;
    uint8_t *bytes = good ? malloc((size_t)size) : NULL;
    good = bytes != NULL && fread(bytes, 1, (size_t)size, file) == (size_t)size &&
           copy_segments(pico, bytes, (size_t)size);
    free(bytes);
    (void)fclose(file);
    return good;
}

// The functions of struct run_board

static int power_up(void *self, struct run *run) {
    struct pico *pico = self;
    pico->run = run;
    pico->pause_ns = RUN_NEVER;
    pico->has_ready_wire = run_has_ready(pico->ready);
    const struct module_config config = {
        .name = pico->sensor,
        .motion = motion_source(&run->motion),
    };
    pico->module = module_new(&config);
    if (pico->module == NULL) {
        return run_complain(run, "the sensor", "does not fit into memory");
    }
    memset(pico->flash, 0xFF, sizeof pico->flash);
    const int code = run_load_memory(run);
    if (code != 0) {
        return code;
    }
    if (!load_image(pico, run->options.image)) {
        return run_complain(run, run->options.image, "is no image of an RP2040");
    }
    if (!pico->machine.power_up(pico->wire == NULL ? "usb" : pico->wire, pico->rom)) {
        return run_complain(run, "--wire", "is usb or uart");
    }
    return 0;
}

static bool run_until(void *self, uint64_t until) {
    struct pico *pico = self;
    const uint64_t end = least(until, pico->pause_ns);
    pico->pause_ns = RUN_NEVER;
    (void)at(pico->machine.run((double)end));
    return true;
}

static uint64_t now(const void *self) {
    return ((const struct pico *)self)->now_ns;
}

static uint64_t nanoseconds(uint64_t tick) {
    return tick;
}

static uint64_t clock_start(const void *self) {
    (void)self;
    return 0;  // its timer runs from power on
}

static uint64_t asleep(const void *self) {
    return ((const struct pico *)self)->asleep_ns;
}

static size_t line_count(const void *self) {
    return ((const struct pico *)self)->line.count;
}

static bool send(void *self, uint64_t from, uint8_t byte) {
    return line_put(&((struct pico *)self)->line, from, byte);
}

static void press(void *self, bool is_down) {
    ((struct pico *)self)->machine.press(is_down);
}

static void suffer(void *self, const struct fault *fault) {
    struct pico *pico = self;
    if (fault->target == FAULT_RESET || fault->target == FAULT_BROWN_OUT) {
        pico->machine.reset(fault->target == FAULT_BROWN_OUT);
    }
}

static bool add_chip_fault(void *self, const struct chip_fault *fault) {
    return module_add_fault(((struct pico *)self)->module, fault);
}

static void cut_memory(void *self) {
    (void)self;  // a word is programmed in one step here
}

static uint8_t *memory_bytes(void *self, size_t *size) {
    *size = FLASH_BYTES;
    return ((struct pico *)self)->flash;
}

static void pause_at(void *self, uint64_t tick) {
    struct pico *pico = self;
    pico->pause_ns = least(pico->pause_ns, tick);
}

static void report(void *self, struct run_report *out) {
    struct pico *pico = self;
    *out = (struct run_report){
        .resets = pico->resets,
        .memory_writes = pico->writes,
        .uart_overruns = pico->overruns,
        .bus_transactions = module_transactions(pico->module),
        .stack = pico->stack,
        .flash = pico->flash_bytes,
        .firmware_complaint = pico->complaint[0] != '\0' ? pico->complaint : NULL,
        .sensor_complaint = module_complaint(pico->module),
    };
}

static const char *check(const void *self) {
    const struct pico *pico = self;
    const char *wrong = module_misnamed(pico->sensor);
    return wrong == NULL ? run_check_ready(pico->ready) : wrong;
}

static const struct fault_kinds *fault_kinds(const void *self) {
    return faults_of_module(((const struct pico *)self)->sensor);
}

static const struct run_path own_paths[] = {
    {"--wire", &the_pico.wire},
    {"--ready", &the_pico.ready},
    {"--rom", &the_pico.rom},
    {"--sensor", &the_pico.sensor},
    {NULL, NULL},
};

static const struct run_board board_pico = {
    .name = "pico",
    .usage = usage_text,
    .version = PICO_VERSION,
    .ticks_per_us = 1000,
    .fault_kinds = fault_kinds,
    .memory = "is no flash of 2097152 bytes",
    .paths = own_paths,
    .check = check,
    .power_up = power_up,
    .run = run_until,
    .now = now,
    .nanoseconds = nanoseconds,
    .clock_start = clock_start,
    .asleep = asleep,
    .line_count = line_count,
    .send = send,
    .press = press,
    .suffer = suffer,
    .add_chip_fault = add_chip_fault,
    .cut_memory = cut_memory,
    .memory_bytes = memory_bytes,
    .pause = pause_at,
    .report = report,
};

// Runs the board as its arguments say, which end with a null. Returns the exit code.
EXPORT int pico_main(char **arguments, const struct machine *machine) {
    the_pico.machine = *machine;
    return run_main(&the_run, &board_pico, &the_pico, arguments);
}
