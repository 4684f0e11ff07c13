// SPDX-License-Identifier: MIT
// The virtual Nano and Mega: runs the image that a user flashes, with the modelled
// sensor, and prints a summary at the end. Links libsimavr (GPL-3) and libelf: this
// program and nothing else of the project does, and it is not part of any package.
#include <string.h>

#include "bootloader.h"
#include "follow.h"
#include "image.h"
#include "machine.h"
#include "run/run.h"
#include "selftest.h"

#ifndef NANO_VERSION
#define NANO_VERSION "0.1.0"
#endif

static const char usage_text[] =
    "usage: nano" RUN_OPTIONS "            [--profile FILE]"
    " [--bootloader FILE.hex]\n"
    "            [--sensor NAME] [--ready wire|none]\n"
    "       nano --self-test [--without NAME]\n"
    "       nano --version\n";

static struct nano {
    struct run run;
    struct machine machine;
    struct module *module;
    struct image image;
    struct follow follow;
    const char *bootloader, *sensor;
    const char *ready;  // "none": data-ready has no wire
} nano;

static struct run_board board_nano;  // the processor's part is set at power-up

// Callbacks of the machine

static void on_byte(void *context, uint64_t cycle, uint8_t byte) {
    (void)cycle;
    run_on_byte(context, byte);
}

// GPIOR0: 1 when work on a sample starts, 0 when it is done.
static void on_mark(void *context, uint64_t cycle, uint8_t value) {
    run_on_mark(context, cycle, cycle, value != 0);
}

static void on_reset(void *context, enum machine_reset cause) {
    (void)cause;
    run_on_reset(context);
}

// The functions of struct run_board

static int power_up(void *self, struct run *run) {
    struct nano *board = self;
    struct machine *machine = &board->machine;
    const struct run_options *options = &run->options;
    const struct module_config config = {
        .name = board->sensor,
        .motion = motion_source(&run->motion),
    };
    board->module = module_new(&config);
    const struct machine_kind *kind = image_kind(options->image);
    if (kind == NULL) {
        return run_complain(run, options->image,
                            "is no image of an ATmega328P or ATmega2560; `pio run -e "
                            "nano -e mega` makes them");
    }
    board_nano.memory = kind->memory;
    board_nano.code_size = kind->flash_size;
    if (board->module == NULL ||
        !machine_init(machine, kind, board->module, options->seed, 0)) {
        return run_complain(run, "libsimavr", "does not have the processor");
    }
    machine->is_unwired = !run_has_ready(board->ready);
    machine->context = run;
    machine->on_byte = on_byte;
    machine->on_mark = on_mark;
    machine->on_data_ready = run_on_data_ready;
    machine->on_bus = run_on_bus;
    machine->on_eeprom_write = run_on_memory_write;
    machine->on_reset = on_reset;
    if (!image_load(&board->image, options->image, machine)) {
        return run_complain(run, options->image,
                            "has no code, or more than fits into flash");
    }
    if (board->bootloader != NULL) {
        const char *problem = board->image.flash > kind->boot_start
                                  ? "does not fit beside this image"
                                  : bootloader_load(machine, board->bootloader);
        if (problem != NULL) {
            return run_complain(run, board->bootloader, problem);
        }
    }
    return run_load_memory(run);
}

static bool run_until(void *self, uint64_t until) {
    return machine_run(&((struct nano *)self)->machine, until);
}

static uint64_t now(const void *self) {
    return machine_now(&((const struct nano *)self)->machine);
}

static uint64_t clock_start(const void *self) {
    return ((const struct nano *)self)->machine.clock_start;
}

static uint64_t asleep(const void *self) {
    return ((const struct nano *)self)->machine.asleep;
}

static size_t line_count(const void *self) {
    return ((const struct nano *)self)->machine.uart.line.count;
}

static bool send(void *self, uint64_t from, uint8_t byte) {
    return machine_send(&((struct nano *)self)->machine, from, byte);
}

static void press(void *self, bool is_down) {
    machine_press(&((struct nano *)self)->machine, is_down);
}

static void suffer(void *self, const struct fault *fault) {
    machine_reset(&((struct nano *)self)->machine, fault->target == FAULT_BROWN_OUT
                                                       ? MACHINE_BROWN_OUT
                                                       : MACHINE_EXTERNAL);
}

static bool add_chip_fault(void *self, const struct chip_fault *fault) {
    return module_add_fault(((struct nano *)self)->module, fault);
}

static void cut_memory(void *self) {
    machine_cut_eeprom(&((struct nano *)self)->machine);
}

static uint8_t *memory_bytes(void *self, size_t *size) {
    *size = ((struct nano *)self)->machine.kind->eeprom_size;
    return ((struct nano *)self)->machine.eeprom.bytes;
}

static void pause_at(void *self, uint64_t at) {
    machine_pause(&((struct nano *)self)->machine, at);
}

static void report(void *self, struct run_report *out) {
    struct nano *board = self;
    struct machine *machine = &board->machine;
    *out = (struct run_report){
        .resets = machine->resets,
        .memory_writes = machine->eeprom.writes,
        .uart_overruns = machine->uart.overruns,
        .bus_transactions = module_transactions(board->module),
        .stack = machine_stack_deepest(machine),
        .flash = board->image.flash,
        .ram = board->image.ram,
        .firmware_complaint = machine->complaint,
        .sensor_complaint = module_complaint(board->module),
        .crash = machine->is_stuck ? "sleeps with interrupts off" : "crashed",
        .pc = machine_pc(machine),
        .sp = machine_sp(machine),
    };
    run_add_number(out, "uart_baud", machine->uart.baud);
    run_add_number(out, "clock_restart_ns", machine_ns(machine->clock_restart));
}

static int command(char **rest) {
    if (strcmp(rest[0], "--self-test") != 0) {
        return -1;
    }
    if (rest[1] == NULL) {
        return selftest_run(NULL);
    }
    if (strcmp(rest[1], "--without") == 0 && rest[2] != NULL && rest[3] == NULL) {
        return selftest_run(rest[2]);
    }
    return run_usage(&nano.run, "--self-test does not go with", rest[1]);
}

static void watch(void *self, struct profile *profile) {
    struct nano *board = self;
    board->follow = (struct follow){profile, &board->machine};
    follow_begin(&board->follow);
}

static struct profile_time profile_now(const void *self) {
    return follow_time(&((const struct nano *)self)->machine);
}

static const char *check(const void *self) {
    const struct nano *board = self;
    const char *wrong = module_misnamed(board->sensor);
    return wrong == NULL ? run_check_ready(board->ready) : wrong;
}

static const struct fault_kinds *fault_kinds(const void *self) {
    return faults_of_module(((const struct nano *)self)->sensor);
}

static const struct run_path paths[] = {{"--bootloader", &nano.bootloader},
                                        {"--sensor", &nano.sensor},
                                        {"--ready", &nano.ready},
                                        {NULL, NULL}};

static struct run_board board_nano = {
    .name = "nano",
    .usage = usage_text,
    .version = NANO_VERSION,
    .ticks_per_us = MACHINE_CYCLES_PER_US,
    .fault_kinds = fault_kinds,
    .paths = paths,
    .command = command,
    .check = check,
    .power_up = power_up,
    .run = run_until,
    .now = now,
    .nanoseconds = machine_ns,
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
    .watch = watch,
    .profile_now = profile_now,
};

int main(int argc, char **argv) {
    (void)argc;  // the list ends with a null
    const int code = run_main(&nano.run, &board_nano, &nano, argv + 1);
    if (nano.machine.avr != NULL) {
        machine_free(&nano.machine);
    }
    module_free(nano.module);
    return code;
}
