// SPDX-License-Identifier: MIT
// The virtual STM32F405: runs the image that a user flashes, with the modelled sensor,
// and says at the end what it saw. Links libunicorn (GPL-2): this program and nothing
// else of the project does, and it is not part of any package.
#include "f405/f405.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "chips/lsm9ds0.h"
#include "chips/rn41.h"
#include "chips/sdcard.h"
#include "f405/follow.h"
#include "run.h"

#ifndef F405_VERSION
#define F405_VERSION "0.1.0"
#endif

static const char usage_text[] =
    "usage: f405 --image FILE.elf [--motion FILE|-] [--pty LINK | --record FILE]\n"
    "            [--fast] [--seconds N] [--summary FILE] [--eeprom FILE] [--seed N]\n"
    "            [--clock-ppm N] [--clock-drift PPM_S] [--batch-ms N] [--burst-ms N]\n"
    "            [--faults FILE] [--press START_US:END_US]... [--send US:HEX]...\n"
    "            [--card FILE [--card-kind KIND]] [--radio FILE] [--battery MV]\n"
    "            [--profile FILE [--parts FILE]]\n"
    "       f405 --version\n"
    "--eeprom is what survives power: all of flash, over which the image is put\n"
    "--card is what is on an SD card, --card-kind sdsc or sdhc where its size does "
    "not\n"
    "tell: up to 2 GB, or more\n"
    "--radio is an RN-41 between probe and wire, with its settings in FILE\n"
    "--battery is a cell of so many millivolts, and its charger\n";

static const char *const chip_faults[] = {
    [CHIP_FAULT_NACK] = "nack",
    [CHIP_FAULT_STUCK_SDA] = "stuck_sda",
    [CHIP_FAULT_NO_DATA_READY] = "no_data_ready",
    [CHIP_FAULT_WRONG_WHO_AM_I] = "wrong_who_am_i",
    [CHIP_FAULT_NO_MAG] = "no_mag",
    [CHIP_FAULT_GYR_SELF_TEST] = "gyr_self_test",
    [CHIP_FAULT_ACC_SELF_TEST] = "acc_self_test",
    [CHIP_FAULT_FROZEN] = "frozen",
};
_Static_assert((int)FAULTS_MAX <= (int)I2C_SLAVE_FAULTS_MAX, "the chip takes them all");

static struct board {
    struct run run;
    struct f405 machine;
    struct lsm9ds0_chip *sensor;
    struct f405_chip chip;
    const char *card_image, *card_kind;
    struct sdcard_chip *sd;  // null: no card
    struct f405_card card;
    const char *radio_file, *battery_mv;
    struct rn41_chip *rn41;  // null: a cable
    struct f405_radio radio;
    struct f405_follow follow;  // its profile is null: none is asked for
    const char *profile_path, *parts_path;
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

// The card, as the machine wants it

static const char *const card_faults[] = {
    [SDCARD_CHIP_PULLED] = "card_pulled", [SDCARD_CHIP_SLOW] = "card_slow",
    [SDCARD_CHIP_CRC] = "card_crc",       [SDCARD_CHIP_ERROR] = "card_error",
    [SDCARD_CHIP_WORN] = "card_worn",     [SDCARD_CHIP_DEAD] = "card_dead",
};
_Static_assert((int)FAULTS_MAX <= (int)SDCARD_CHIP_FAULTS_MAX,
               "the card takes them all");

static uint8_t card_exchange(void *self, uint64_t now_ns, uint32_t clock_hz,
                             uint8_t byte) {
    return sdcard_chip_exchange(self, now_ns, clock_hz, byte);
}

static void card_select(void *self, uint64_t now_ns, bool is_selected) {
    sdcard_chip_select(self, now_ns, is_selected);
}

static void card_power_cycle(void *self, uint64_t now_ns) {
    sdcard_chip_power_cycle(self, now_ns);
}

static void on_card_write(void *context, uint64_t number) {
    run_on_card_write(context, number);
}

// 0, or the exit code once it has complained.
static int insert_card(struct board *b, struct run *run) {
    for (unsigned i = 0; i < run->faults.count && b->card_image == NULL; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_CARD || fault->card_write > 0) {
            return run_complain(run, run->options.faults, "is for a card: --card FILE");
        }
    }
    if (b->card_image == NULL) {
        return 0;
    }
    struct sdcard_chip_config config = {
        .image = b->card_image,
        .seed = run->options.seed,
        .on_block = on_card_write,
        .context = run,
    };
    if (b->card_kind != NULL) {
        config.kind =
            strcmp(b->card_kind, "sdhc") == 0 ? SDCARD_CHIP_SDHC : SDCARD_CHIP_SDSC;
    }
    const char *problem = NULL;
    b->sd = sdcard_chip_new(&config, &problem);
    if (b->sd == NULL) {
        return run_complain(run, b->card_image, problem);
    }
    b->card = (struct f405_card){
        .self = b->sd,
        .exchange = card_exchange,
        .select = card_select,
        .power_cycle = card_power_cycle,
    };
    b->machine.card = &b->card;
    return 0;
}

static const char *check_card(void) {
    if (board.card_kind == NULL) {
        return NULL;
    }
    if (board.card_image == NULL) {
        return "--card-kind comes with --card FILE";
    }
    return strcmp(board.card_kind, "sdsc") == 0 || strcmp(board.card_kind, "sdhc") == 0
               ? NULL
               : "--card-kind is sdsc or sdhc";
}

static void add_card_fault(void *self, const struct card_fault *fault) {
    const struct sdcard_chip_fault card_fault = {
        .kind = (enum sdcard_chip_fault_kind)fault->kind,
        .from_ns = fault->from_ns,
        .for_ns = fault->for_ns,
        .first = fault->first,
        .count = fault->count,
        .after_ns = fault->after_ns,
        .block = fault->block,
        .blocks = fault->blocks,
        .ms = fault->ms,
        .wear = (enum sdcard_chip_wear)fault->value,
    };
    (void)sdcard_chip_add_fault(((struct board *)self)->sd, &card_fault);
}

static void report_card(const struct board *b, struct run_report *out) {
    if (b->sd != NULL) {
        out->has_card = true;
        out->card_blocks = sdcard_chip_written(b->sd);
        out->card_bad_crc = sdcard_chip_bad_crc(b->sd);
        out->card_busy_worst_us = sdcard_chip_busy_worst_ns(b->sd) / 1000;
        out->card_complaint = sdcard_chip_complaint(b->sd);
    }
}

// At the end of a run that no cut has ended the card finishes what it has taken.
static void free_card(struct board *b) {
    if (b->sd != NULL) {
        sdcard_chip_finish(b->sd, f405_ns(f405_now(&b->machine)));
        sdcard_chip_free(b->sd);
    }
}

// The radio, as the machine wants it

static void hear_host(void) {
    uint8_t byte = 0;
    while (rn41_chip_host_read(board.rn41, &byte)) {
        run_on_byte(&board.run, byte);
    }
}

static void radio_advance(void *self, uint64_t now_ns) {
    rn41_chip_advance(self, now_ns);
    hear_host();
}

static uint64_t radio_next_event(const void *self) {
    return rn41_chip_next_event(self);
}

static void radio_receive(void *self, uint64_t now_ns, uint8_t byte, uint32_t baud) {
    rn41_chip_receive(self, now_ns, byte, baud);
    hear_host();
}

static bool radio_take(void *self, uint8_t *byte, uint32_t *baud) {
    return rn41_chip_take(self, byte, baud);
}

static bool radio_is_sending(const void *self) {
    return rn41_chip_is_sending(self);
}

static void radio_set_cts(void *self, uint64_t now_ns, bool is_high) {
    rn41_chip_set_cts(self, now_ns, is_high);
    hear_host();
}

static void radio_set_reset(void *self, uint64_t now_ns, bool is_low) {
    rn41_chip_set_reset(self, now_ns, is_low);
    hear_host();
}

static int radio_rts(const void *self) {
    return rn41_chip_rts(self);
}

static int radio_pio2(const void *self) {
    return rn41_chip_pio2(self);
}

static void radio_host_write(void *self, uint64_t now_ns, uint8_t byte) {
    rn41_chip_host_write(self, now_ns, byte);
    hear_host();
}

static void radio_power_cycle(void *self, uint64_t now_ns) {
    rn41_chip_power_cycle(self, now_ns);
    hear_host();
}

// A file that is not there is a module as it comes from the factory.
static bool load_radio(const struct board *b) {
    char text[RN41_CHIP_TEXT + 1] = "";
    FILE *file = fopen(b->radio_file, "rb");
    if (file == NULL) {
        return true;
    }
    const size_t length = fread(text, 1, sizeof text - 1, file);
    (void)fclose(file);
    text[length] = '\0';
    return rn41_chip_load(b->rn41, text);
}

// 0, or the exit code once it has complained.
static int add_radio(struct board *b, struct run *run) {
    for (unsigned i = 0; i < run->faults.count && b->radio_file == NULL; i++) {
        if (run->faults.list[i].target == FAULT_RADIO) {
            return run_complain(run, run->options.faults,
                                "is for a radio: --radio FILE");
        }
    }
    if (b->radio_file == NULL) {
        return 0;
    }
    const struct rn41_chip_config config = rn41_chip_defaults();
    b->rn41 = rn41_chip_new(&config);
    if (b->rn41 == NULL || !load_radio(b)) {
        return run_complain(run, b->radio_file, "has no settings of an RN-41");
    }
    b->radio = (struct f405_radio){
        .self = b->rn41,
        .advance = radio_advance,
        .next_event = radio_next_event,
        .receive = radio_receive,
        .take = radio_take,
        .is_sending = radio_is_sending,
        .set_cts = radio_set_cts,
        .set_reset = radio_set_reset,
        .rts = radio_rts,
        .pio2 = radio_pio2,
        .host_write = radio_host_write,
        .power_cycle = radio_power_cycle,
    };
    b->machine.radio = &b->radio;
    return 0;
}

static void suffer_radio(struct board *b, const struct fault *fault) {
    static const enum rn41_chip_fault_kind kinds[] = {
        [RADIO_DROP] = RN41_CHIP_DROP,
        [RADIO_AWAY] = RN41_CHIP_AWAY,
        [RADIO_DEAF] = RN41_CHIP_DEAF,
        [RADIO_RESET] = RN41_CHIP_RESET,
    };
    const struct rn41_chip_fault radio_fault = {
        .kind = kinds[fault->radio],
        .from_ns = f405_ns(f405_now(&b->machine)),
        .for_ns = fault->chip.for_ns,
    };
    (void)rn41_chip_add_fault(b->rn41, &radio_fault);
    wired_event(&b->machine);
}

static void add_number(struct run_report *out, const char *name, uint64_t value) {
    if (out->more_count < RUN_MORE_MAX) {
        out->more[out->more_count++] = (struct run_number){name, value};
    }
}

static void report_radio(const struct board *b, struct run_report *out) {
    if (b->rn41 == NULL) {
        return;
    }
    const struct rn41_chip_counters counters = rn41_chip_counters(b->rn41);
    add_number(out, "radio_to_host", counters.to_host);
    add_number(out, "radio_from_host", counters.from_host);
    add_number(out, "radio_lost_to_host", counters.lost_to_host);
    add_number(out, "radio_lost_from_host", counters.lost_from_host);
    add_number(out, "radio_commands", counters.commands);
    add_number(out, "radio_writes", counters.writes);
    add_number(out, "radio_resets", counters.resets);
    add_number(out, "radio_links", counters.links);
    out->has_radio = true;
    out->radio_complaint = rn41_chip_complaint(b->rn41);
}

static bool save_radio(const struct board *b) {
    if (b->rn41 == NULL) {
        return true;
    }
    char text[RN41_CHIP_TEXT];
    rn41_chip_save(b->rn41, text);
    FILE *file = fopen(b->radio_file, "wb");
    const bool good = file != NULL && fputs(text, file) >= 0;
    if (file != NULL && fclose(file) == 0 && good) {
        return true;
    }
    (void)run_complain(&b->run, b->radio_file, "can't be written");
    return false;
}

static const char *check_battery(void) {
    const char *text = board.battery_mv;
    if (text == NULL) {
        return NULL;
    }
    char *end = NULL;
    const unsigned long mv = strtoul(text, &end, 10);
    return text[0] >= '0' && text[0] <= '9' && *end == '\0' && mv <= FAULT_MV_MAX
               ? NULL
               : "--battery takes millivolts, 6600 at most";
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
    if (board.follow.profile != NULL) {
        (is_begin ? profile_begin_sample : profile_end_sample)(board.follow.profile);
    }
    run_on_mark(context, f405_now(&board.machine), board.machine.cycle, is_begin);
}

static void on_reset(void *context) {
    if (board.follow.profile != NULL) {
        f405_follow_reset(&board.follow);
    }
    run_on_reset(context);
    if (board.sd != NULL) {
        sdcard_chip_host_reset(board.sd, f405_ns(f405_now(&board.machine)));
    }
}

static void on_flash_write(void *context, uint64_t number) {
    run_on_memory_write(context, number);
}

static bool follow(struct board *b) {
    struct f405_follow *follow = &b->follow;
    follow->machine = &b->machine;
    follow->profile = profile_new(b->run.options.image, F405_FLASH, F405_FLASH_SIZE);
    if (follow->profile == NULL ||
        (b->parts_path != NULL &&
         !profile_read_parts(follow->profile, b->parts_path))) {
        return false;
    }
    f405_follow_begin(follow);
    return true;
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
    const int code =
        insert_card(b, run) != 0 || add_radio(b, run) != 0 ? 2 : run_load_memory(run);
    if (code != 0) {
        return code;
    }
    if (!f405_load(machine, options->image, &b->flash, &b->ram)) {
        return run_complain(run, options->image, "is no image of an STM32F405");
    }
    if (b->profile_path != NULL && !follow(b)) {
        return b->follow.profile == NULL
                   ? run_complain(run, options->image, "has no symbols to profile by")
                   : run_complain(run, b->parts_path,
                                  "has other lines than START END PART");
    }
    if (b->battery_mv != NULL) {
        const uint32_t mv = (uint32_t)strtoul(b->battery_mv, NULL, 10);
        f405_battery(machine, mv, mv, 0);
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

// A host without a link can't write: what it would stays with it.
static size_t line_count(const void *self) {
    enum { RADIO_ROOM = 512 };  // more than the run hands over at once
    const struct board *b = self;
    if (b->rn41 != NULL && rn41_chip_host_room(b->rn41) < RADIO_ROOM) {
        return SIZE_MAX;
    }
    return b->machine.usart.line_count;
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
    case FAULT_BATTERY:
        f405_battery(machine, fault->mv, fault->has_to_mv ? fault->to_mv : fault->mv,
                     fault->chip.for_ns * 1000);
        break;
    case FAULT_CHARGER:
        f405_charger(machine, (fault->chip.value & 1) != 0,
                     (fault->chip.value & 2) != 0);
        break;
    case FAULT_RADIO:
        suffer_radio(self, fault);
        break;
    case FAULT_CHIP:
    case FAULT_CARD:
    case FAULT_POWER_CUT:
        break;
    }
}

static void add_chip_fault(void *self, const struct chip_fault *fault) {
    (void)i2c_slave_add_fault(lsm9ds0_chip_wire(((struct board *)self)->sensor), fault);
}

static void cut_memory(void *self) {
    struct board *b = self;
    f405_cut_flash(&b->machine);
    if (b->sd != NULL) {
        sdcard_chip_cut(b->sd, f405_ns(f405_now(&b->machine)));
    }
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
    report_card(b, out);
    if (f405_stopped(machine) > 0) {
        add_number(out, "stopped_us", f405_stopped(machine) / F405_PS_PER_US);
    }
    report_radio(b, out);
}

static const char *check(void) {
    const char *problem = check_card();
    problem = problem != NULL ? problem : check_battery();
    return problem == NULL && board.parts_path != NULL && board.profile_path == NULL
               ? "--parts needs --profile"
               : problem;
}

static bool finish(void *self) {
    struct board *b = self;
    struct profile *profile = b->follow.profile;
    const bool is_saved = save_radio(b);
    if (profile != NULL && !profile_write(profile, b->profile_path)) {
        (void)run_complain(&b->run, b->profile_path, "can't be written");
        return false;
    }
    return is_saved;
}

static const struct run_path own_paths[] = {
    {"--card", &board.card_image},
    {"--card-kind", &board.card_kind},
    {"--radio", &board.radio_file},
    {"--battery", &board.battery_mv},
    {"--profile", &board.profile_path},
    {"--parts", &board.parts_path},
    {NULL, NULL},
};

static const struct run_board board_f405 = {
    .name = "f405",
    .usage = usage_text,
    .version = F405_VERSION,
    .ticks_per_us = F405_PS_PER_US,
    .fault_kinds =
        {
            .chip = chip_faults,
            .chip_count = sizeof chip_faults / sizeof *chip_faults,
            .card = card_faults,
            .card_count = sizeof card_faults / sizeof *card_faults,
            .has_dies = true,
            .is_stm32 = true,
        },
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
    .add_card_fault = add_card_fault,
    .cut_memory = cut_memory,
    .memory_bytes = memory_bytes,
    .pause = pause_at,
    .report = report,
    .finish = finish,
};

int main(int argc, char **argv) {
    (void)argc;  // the list ends with a null
    const int code = run_main(&board.run, &board_f405, &board, argv + 1);
    free_card(&board);
    f405_free(&board.machine);
    lsm9ds0_chip_free(board.sensor);
    rn41_chip_free(board.rn41);
    profile_free(board.follow.profile);
    return code;
}
