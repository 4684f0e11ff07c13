// SPDX-License-Identifier: MIT
// The virtual STM32F405: runs the image that a user flashes, with the modelled sensor,
// and says at the end what it saw. Links libunicorn (GPL-2): this program and nothing
// else of the project does, and it is not part of any package.
#include "f405/f405.h"

#include "chips/lsm9ds0.h"
#include "run.h"

#ifndef F405_VERSION
#define F405_VERSION "0.1.0"
#endif

static const char usage_text[] =
    "usage: f405 --image FILE.elf [--motion FILE|-] [--pty LINK | --record FILE]\n"
    "            [--fast] [--seconds N] [--summary FILE] [--eeprom FILE] [--seed N]\n"
    "            [--faults FILE] [--press START_US:END_US]... [--send US:HEX]...\n"
    "       f405 --version\n"
    "--eeprom is what survives power: all of flash, over which the image is put\n";

static const char *const chip_faults[] = {
    [LSM9DS0_CHIP_NACK] = "nack",
    [LSM9DS0_CHIP_STUCK_SDA] = "stuck_sda",
    [LSM9DS0_CHIP_NO_DATA_READY] = "no_data_ready",
    [LSM9DS0_CHIP_WRONG_WHO_AM_I] = "wrong_who_am_i",
    [LSM9DS0_CHIP_NO_MAG] = "no_mag",
    [LSM9DS0_CHIP_GYR_SELF_TEST] = "gyr_self_test",
    [LSM9DS0_CHIP_ACC_SELF_TEST] = "acc_self_test",
    [LSM9DS0_CHIP_FROZEN] = "frozen",
};
_Static_assert((int)FAULTS_MAX <= (int)LSM9DS0_CHIP_FAULTS_MAX,
               "the chip takes them all");

static struct board {
    struct run run;
    struct f405 machine;
    struct lsm9ds0_chip *sensor;
    struct f405_chip chip;
    uint32_t flash, ram;  // bytes of the image
} board;

// The sensor, as the machine wants it

static void chip_advance(void *self, uint64_t now_ns) {
    lsm9ds0_chip_advance(self, now_ns);
}

static uint64_t chip_next_event(const void *self) {
    return lsm9ds0_chip_next_event(self);
}

static bool chip_holds_sda(void *self, uint64_t now_ns) {
    return lsm9ds0_chip_holds_sda(self, now_ns);
}

static bool chip_start(void *self, uint64_t now_ns, uint8_t address, bool is_read) {
    return lsm9ds0_chip_start(self, now_ns, address, is_read);
}

static bool chip_write(void *self, uint64_t now_ns, uint8_t byte) {
    return lsm9ds0_chip_write(self, now_ns, byte);
}

static uint8_t chip_read(void *self, uint64_t now_ns, bool ack) {
    return lsm9ds0_chip_read(self, now_ns, ack);
}

static void chip_stop(void *self, uint64_t now_ns) {
    lsm9ds0_chip_stop(self, now_ns);
}

static void chip_scl_pulse(void *self, uint64_t now_ns) {
    lsm9ds0_chip_scl_pulse(self, now_ns);
}

static void chip_power_cycle(void *self, uint64_t now_ns) {
    lsm9ds0_chip_power_cycle(self, now_ns);
}

static bool chip_data_ready(const void *self, unsigned pin) {
    return lsm9ds0_chip_pin_is_high(self, pin == 0 ? LSM9DS0_CHIP_DRDY_G
                                                   : LSM9DS0_CHIP_INT2_XM);
}

static void feel(void *context, enum lsm9ds0_chip_quantity quantity, int64_t from_ns,
                 int64_t to_ns, double mean[3]) {
    static const enum motion_quantity quantities[] = {
        [LSM9DS0_CHIP_GYR] = MOTION_GYR,
        [LSM9DS0_CHIP_ACC] = MOTION_ACC,
        [LSM9DS0_CHIP_MAG] = MOTION_MAG,
    };
    motion_mean(context, quantities[quantity], from_ns, to_ns, mean);
}

// What the machine tells

static void on_byte(void *context, uint8_t byte) {
    run_on_byte(context, byte);
}

static void on_data_ready(void *context) {
    run_on_data_ready(context);
}

static void on_bus(void *context, bool is_start) {
    run_on_bus(context, is_start);
}

static void on_mark(void *context, bool is_begin) {
    run_on_mark(context, f405_now(&board.machine), board.machine.cycle, is_begin);
}

static void on_reset(void *context) {
    run_on_reset(context);
}

static void on_flash_write(void *context, uint64_t number) {
    run_on_memory_write(context, number);
}

// The board, as run.h wants it

static int power_up(void *self, struct run *run) {
    struct board *b = self;
    struct f405 *machine = &b->machine;
    const struct run_options *options = &run->options;
    struct lsm9ds0_chip_config config = lsm9ds0_chip_defaults();
    if (options->motion != NULL) {
        config.is_recorded = (run->motion.flags & MOTION_RECORDED) != 0;
        config.motion = feel;
        config.context = &run->motion;
    }
    b->sensor = lsm9ds0_chip_new(&config);
    b->chip = (struct f405_chip){
        .self = b->sensor,
        .advance = chip_advance,
        .next_event = chip_next_event,
        .holds_sda = chip_holds_sda,
        .start = chip_start,
        .write = chip_write,
        .read = chip_read,
        .stop = chip_stop,
        .scl_pulse = chip_scl_pulse,
        .power_cycle = chip_power_cycle,
        .data_ready = chip_data_ready,
    };
    if (b->sensor == NULL || !f405_init(machine, &b->chip, options->seed)) {
        return run_complain(run, "libunicorn", "has no Cortex-M4");
    }
    machine->context = run;
    machine->on_byte = on_byte;
    machine->on_mark = on_mark;
    machine->on_data_ready = on_data_ready;
    machine->on_bus = on_bus;
    machine->on_flash_write = on_flash_write;
    machine->on_reset = on_reset;
    const int code = run_load_memory(run);
    if (code != 0) {
        return code;
    }
    if (!f405_load(machine, options->image, &b->flash, &b->ram)) {
        return run_complain(run, options->image, "is no image of an STM32F405");
    }
    f405_power_up(machine);
    return 0;
}

static bool run_until(void *self, uint64_t until) {
    return f405_run(&((struct board *)self)->machine, until);
}

static uint64_t now(const void *self) {
    return f405_now(&((const struct board *)self)->machine);
}

static uint64_t clock_start(const void *self) {
    return ((const struct board *)self)->machine.clock_start;
}

static uint64_t asleep(const void *self) {
    return ((const struct board *)self)->machine.asleep;
}

static size_t line_count(const void *self) {
    return ((const struct board *)self)->machine.usart.line_count;
}

static bool send(void *self, uint64_t from, uint8_t byte) {
    return f405_send(&((struct board *)self)->machine, from, byte);
}

static void press(void *self, bool is_down) {
    f405_press(&((struct board *)self)->machine, is_down);
}

static void suffer(void *self, const struct fault *fault) {
    struct f405 *machine = &((struct board *)self)->machine;
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
    case FAULT_CHIP:
    case FAULT_POWER_CUT:
        break;
    }
}

static void add_chip_fault(void *self, const struct chip_fault *fault) {
    const struct lsm9ds0_chip_fault chip_fault = {
        .kind = (enum lsm9ds0_chip_fault_kind)fault->kind,
        .die = (enum lsm9ds0_chip_die)fault->die,
        .from_ns = fault->from_ns,
        .for_ns = fault->for_ns,
        .first = fault->first,
        .transactions = fault->transactions,
        .at_byte = fault->at_byte,
        .clocks = fault->clocks,
        .value = fault->value,
    };
    (void)lsm9ds0_chip_add_fault(((struct board *)self)->sensor, &chip_fault);
}

static void cut_memory(void *self) {
    f405_cut_flash(&((struct board *)self)->machine);
}

static uint8_t *memory_bytes(void *self, size_t *size) {
    *size = F405_FLASH_SIZE;
    return ((struct board *)self)->machine.flash;
}

static void pause_at(void *self, uint64_t at) {
    f405_pause(&((struct board *)self)->machine, at);
}

static void report(void *self, struct run_report *out) {
    struct board *b = self;
    struct f405 *machine = &b->machine;
    *out = (struct run_report){
        .resets = machine->resets,
        .memory_writes = machine->flash_control.writes,
        .uart_overruns = machine->usart.overruns,
        .bus_transactions = lsm9ds0_chip_transactions(b->sensor),
        .stack = f405_stack_deepest(machine),
        .flash = b->flash,
        .ram = b->ram,
        .firmware_complaint = machine->complaint,
        .sensor_complaint = lsm9ds0_chip_complaint(b->sensor),
        .crash = machine->ended,
        .pc = machine->pc,
        .sp = f405_sp(machine),
    };
}

static const struct run_path own_paths[] = {{NULL, NULL}};

static const struct run_board board_f405 = {
    .name = "f405",
    .usage = usage_text,
    .version = F405_VERSION,
    .ticks_per_us = F405_PS_PER_US,
    .fault_kinds = {chip_faults, sizeof chip_faults / sizeof *chip_faults, true, true},
    .memory = "is no flash of 1048576 bytes",
    .paths = own_paths,
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
    .cut_memory = cut_memory,
    .memory_bytes = memory_bytes,
    .pause = pause_at,
    .report = report,
};

int main(int argc, char **argv) {
    (void)argc;  // the list ends with a null
    const int code = run_main(&board.run, &board_f405, &board, argv + 1);
    f405_free(&board.machine);
    lsm9ds0_chip_free(board.sensor);
    return code;
}
