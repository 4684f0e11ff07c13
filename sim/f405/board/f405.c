// SPDX-License-Identifier: MIT
// The virtual STM32F405: runs the image that a user flashes, with the modelled sensor,
// and says at the end what it saw. Links libunicorn (GPL-2): this program and nothing
// else of the project does, and it is not part of any package.
#include <stdlib.h>

#include "board.h"

#ifndef F405_VERSION
#define F405_VERSION "0.1.0"
#endif

static const char usage_text[] =
    "usage: f405" RUN_OPTIONS
    "            [--card FILE [--card-kind KIND]] [--radio FILE] [--battery MV]\n"
    "            [--crystal MHZ] [--hsi MHZ] [--profile FILE]\n"
    "       f405 --version\n"
    "--eeprom is what survives power: all of flash, over which the image is put\n"
    "--card is what is on an SD card, --card-kind sdsc or sdhc where its size does "
    "not\n"
    "tell: up to 2 GB, or more\n"
    "--radio is an RN-41 between probe and wire, with its settings in FILE\n"
    "--battery is the voltage of a cell in millivolts, with its charger\n"
    "--crystal is the frequency of the board's crystal, 4 to 26 MHz: 12 on a "
    "pyboard\n"
    "v1.1, 8 on a v1.0\n"
    "--hsi is that of the oscillator inside the chip, 16 but for its error\n";

static struct f405_board the_board;

// Callbacks of the machine

static void on_mark(void *context, bool is_begin) {
    const struct f405 *machine = &the_board.machine;
    run_on_mark(context, f405_now(machine), machine->cycle, is_begin);
}

static void on_reset(void *context) {
    run_on_reset(context);
    if (the_board.card != NULL) {
        sdcard_chip_host_reset(the_board.card, f405_ns(f405_now(&the_board.machine)));
    }
}

// Options

static uint32_t frequency_hz(const char *mhz) {
    return (uint32_t)(strtod(mhz, NULL) * 1e6 + 0.5);
}

static bool is_frequency(const char *text, double min_mhz, double max_mhz) {
    char *end = NULL;
    const double mhz = text == NULL ? min_mhz : strtod(text, &end);
    return text == NULL ||
           (end != text && *end == '\0' && mhz >= min_mhz && mhz <= max_mhz);
}

// DS, "HSE oscillator characteristics" and "HSI oscillator characteristics", over all
// temperatures and a little more.
static const char *check_frequencies(const struct f405_board *board) {
    if (!is_frequency(board->crystal_mhz, 4.0, 26.0)) {
        return "--crystal takes megahertz, 4 to 26";
    }
    return is_frequency(board->hsi_mhz, 14.5, 17.0)
               ? NULL
               : "--hsi takes megahertz, 14.5 to 17";
}

// The functions of struct run_board

static int power_up(void *self, struct run *run) {
    struct f405_board *board = self;
    struct f405 *machine = &board->machine;
    const struct run_options *options = &run->options;
    struct lsm9ds0_chip_config config = lsm9ds0_chip_defaults();
    config.sensor.motion = motion_source(&run->motion);
    board->sensor = lsm9ds0_chip_new(&config);
    if (board->sensor == NULL || !f405_init(machine, board->sensor, options->seed)) {
        return run_complain(run, "libunicorn", "has no Cortex-M4");
    }
    if (board->crystal_mhz != NULL) {
        machine->crystal_hz = frequency_hz(board->crystal_mhz);
    }
    if (board->hsi_mhz != NULL) {
        machine->hsi_hz = frequency_hz(board->hsi_mhz);
    }
    machine->context = run;
    machine->on_byte = run_on_byte;
    machine->on_mark = on_mark;
    machine->on_data_ready = run_on_data_ready;
    machine->on_bus = run_on_bus;
    machine->on_flash_write = run_on_memory_write;
    machine->on_reset = on_reset;
    const int code = f405_card_insert(board) != 0 || f405_radio_add(board) != 0
                         ? 2
                         : run_load_memory(run);
    if (code != 0) {
        return code;
    }
    if (!f405_load(machine, options->image, &board->flash, &board->ram)) {
        return run_complain(run, options->image, "is no image of an STM32F405");
    }
    if (board->battery_mv != NULL) {
        const uint32_t mv = (uint32_t)strtoul(board->battery_mv, NULL, 10);
        f405_battery(machine, mv, mv, 0);
    }
    f405_power_up(machine);
    return 0;
}

static bool run_until(void *self, uint64_t until) {
    return f405_run(&((struct f405_board *)self)->machine, until);
}

static uint64_t now(const void *self) {
    return f405_now(&((const struct f405_board *)self)->machine);
}

static uint64_t clock_start(const void *self) {
    return ((const struct f405_board *)self)->machine.clock_start;
}

static uint64_t asleep(const void *self) {
    return ((const struct f405_board *)self)->machine.asleep;
}

// While the radio has no link, the host can't write and keeps its bytes.
static size_t line_count(const void *self) {
    enum { RADIO_ROOM = 512 };  // more than the run passes on at once
    const struct f405_board *board = self;
    if (board->radio != NULL && rn41_chip_host_room(board->radio) < RADIO_ROOM) {
        return SIZE_MAX;
    }
    return board->machine.usart.line.count;
}

static bool send(void *self, uint64_t from, uint8_t byte) {
    return f405_send(&((struct f405_board *)self)->machine, from, byte);
}

static void press(void *self, bool is_down) {
    f405_press(&((struct f405_board *)self)->machine, is_down);
}

static void suffer(void *self, const struct fault *fault) {
    struct f405 *machine = &((struct f405_board *)self)->machine;
    switch (fault->target) {
    case FAULT_RESET:
        f405_reset(machine, F405_RESET_PIN);
        break;
    case FAULT_BROWN_OUT:
        f405_reset(machine, F405_RESET_BROWN_OUT);
        break;
    case FAULT_CRYSTAL:
        f405_kill_crystal(machine);
        break;
    case FAULT_GLITCH:
        f405_glitch(machine);
        break;
    case FAULT_SPURIOUS_BERR:
        f405_spurious_berr(machine);
        break;
    case FAULT_BATTERY:
        f405_battery(machine, fault->mv, fault->has_to_mv ? fault->to_mv : fault->mv,
                     fault->chip.for_ns * 1000);
        break;
    case FAULT_CHARGER:
        f405_charger(machine, (fault->chip.value & 1) != 0,
                     (fault->chip.value & 2) != 0);
        break;
    case FAULT_RADIO:
        f405_radio_suffer(self, fault);
        break;
    case FAULT_CHIP:
    case FAULT_CARD:
    case FAULT_POWER_CUT:
        break;
    }
}

static bool add_chip_fault(void *self, const struct chip_fault *fault) {
    struct f405_board *const board = self;
    return i2c_slave_add_fault(sensor_chip_wire(board->sensor), fault);
}

static void cut_memory(void *self) {
    struct f405_board *board = self;
    f405_cut_flash(&board->machine);
    if (board->card != NULL) {
        sdcard_chip_cut(board->card, f405_ns(f405_now(&board->machine)));
    }
}

static uint8_t *memory_bytes(void *self, size_t *size) {
    *size = F405_FLASH_SIZE;
    return ((struct f405_board *)self)->machine.flash;
}

static void pause_at(void *self, uint64_t at) {
    f405_pause(&((struct f405_board *)self)->machine, at);
}

static void report(void *self, struct run_report *out) {
    struct f405_board *board = self;
    struct f405 *machine = &board->machine;
    *out = (struct run_report){
        .resets = machine->resets,
        .memory_writes = machine->flash_control.writes,
        .uart_overruns = machine->usart.overruns,
        .bus_transactions = sensor_chip_transactions(board->sensor),
        .stack = f405_stack_deepest(machine),
        .flash = board->flash,
        .ram = board->ram,
        .firmware_complaint = machine->complaint,
        .sensor_complaint = sensor_chip_complaint(board->sensor),
        .crash = machine->ended,
        .pc = machine->pc,
        .sp = f405_sp(machine),
    };
    f405_card_report(board, out);
    if (machine->i2c.bus_errors > 0) {
        run_add_number(out, "i2c_bus_errors", machine->i2c.bus_errors);
    }
    run_add_number(out, "uart_baud", usart_baud(machine));
    run_add_number(out, "core_hz", machine->hclk_hz);
    if (f405_stopped(machine) > 0) {
        run_add_number(out, "stopped_us", f405_stopped(machine) / F405_PS_PER_US);
    }
    f405_radio_report(board, out);
}

static const char *check_battery(const char *text) {
    if (text == NULL) {
        return NULL;
    }
    char *end = NULL;
    const unsigned long mv = strtoul(text, &end, 10);
    return text[0] >= '0' && text[0] <= '9' && *end == '\0' && mv <= FAULT_MV_MAX
               ? NULL
               : "--battery takes millivolts, 6600 at most";
}

static const char *check(const void *self) {
    const struct f405_board *board = self;
    const char *problem = f405_card_check(board);
    if (problem == NULL) {
        problem = check_frequencies(board);
    }
    return problem != NULL ? problem : check_battery(board->battery_mv);
}

static bool finish(void *self) {
    return f405_radio_save(self);
}

static void watch(void *self, struct profile *profile) {
    struct f405_board *board = self;
    board->follow = (struct f405_follow){profile, &board->machine};
    f405_follow_begin(&board->follow);
}

static struct profile_time profile_now(const void *self) {
    return f405_follow_time(&((const struct f405_board *)self)->machine);
}

static const struct run_path own_paths[] = {
    {"--card", &the_board.card_image},
    {"--card-kind", &the_board.card_kind},
    {"--radio", &the_board.radio_file},
    {"--battery", &the_board.battery_mv},
    {"--crystal", &the_board.crystal_mhz},
    {"--hsi", &the_board.hsi_mhz},
    {NULL, NULL},
};

static const struct fault_kind own_faults[] = {
    {"crystal", FAULT_CRYSTAL, 0},
    {"glitch", FAULT_GLITCH, 0},
    {"spurious_berr", FAULT_SPURIOUS_BERR, 0},
    {"battery", FAULT_BATTERY, 0},
    {"charger", FAULT_CHARGER, 0},
    {"radio_drop", FAULT_RADIO, RADIO_DROP},
    {"radio_away", FAULT_RADIO, RADIO_AWAY},
    {"radio_deaf", FAULT_RADIO, RADIO_DEAF},
    {"radio_reset", FAULT_RADIO, RADIO_RESET},
};

static const struct fault_kinds *fault_kinds(const void *self) {
    static const struct fault_kinds kinds = {
        .no_mag = "no_mag",
        .card = f405_card_faults,
        .card_count = F405_CARD_FAULTS,
        .has_dies = true,
        .own = own_faults,
        .own_count = sizeof own_faults / sizeof *own_faults,
    };
    (void)self;
    return &kinds;
}

static const struct run_board board_f405 = {
    .name = "f405",
    .usage = usage_text,
    .version = F405_VERSION,
    .ticks_per_us = F405_PS_PER_US,
    .code_start = F405_FLASH,
    .code_size = F405_FLASH_SIZE,
    .fault_kinds = fault_kinds,
    .memory = "is no flash of 1048576 bytes",
    .paths = own_paths,
    .check = check,
    .power_up = power_up,
    .run = run_until,
    .now = now,
    .nanoseconds = f405_ns,
    .clock_start = clock_start,
    .asleep = asleep,
    .line_count = line_count,
    .send = send,
    .press = press,
    .suffer = suffer,
    .add_chip_fault = add_chip_fault,
    .add_card_fault = f405_card_add_fault,
    .cut_memory = cut_memory,
    .memory_bytes = memory_bytes,
    .pause = pause_at,
    .report = report,
    .finish = finish,
    .watch = watch,
    .profile_now = profile_now,
};

int main(int argc, char **argv) {
    (void)argc;  // the list ends with a null
    struct f405_board *board = &the_board;
    const int code = run_main(&board->run, &board_f405, board, argv + 1);
    f405_card_free(board);
    f405_free(&board->machine);
    sensor_chip_free(board->sensor);
    rn41_chip_free(board->radio);
    return code;
}
