// SPDX-License-Identifier: MIT
// Runs the small programs of selftest/probes.c and compares their results with the data
// sheet; then leaves out each correction and demands that its check fails.
#include "selftest.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "machine.h"
#include "selftest/probes.h"

enum {
    BYTES_MAX = 16,
    MS_CYCLES = 16000,
    PROCESSORS = 2,
};

// selftest/probes.c as built, from the linker.
extern const uint8_t _binary_atmega328p_bin_start[];
extern const uint8_t _binary_atmega328p_bin_end[];
extern const uint8_t _binary_atmega2560_bin_start[];
extern const uint8_t _binary_atmega2560_bin_end[];

static const struct processor {
    const struct machine_kind *kind;
    const uint8_t *begin, *end;  // of the programs
} processors[PROCESSORS] = {
    {&machine_atmega328p, _binary_atmega328p_bin_start, _binary_atmega328p_bin_end},
    {&machine_atmega2560, _binary_atmega2560_bin_start, _binary_atmega2560_bin_end},
};

// One program on one machine, and its results.
struct bench {
    struct machine machine;
    struct module *module;
    uint64_t byte_cycles[BYTES_MAX];
    unsigned bytes;
    char found[200];
};

static void on_byte(void *context, uint64_t cycle, uint8_t byte) {
    (void)byte;
    struct bench *bench = context;
    if (bench->bytes < BYTES_MAX) {
        bench->byte_cycles[bench->bytes++] = cycle;
    }
}

static void set_up(struct bench *bench, const struct processor *processor,
                   enum probe probe, uint32_t without) {
    memset(bench, 0, sizeof *bench);
    const struct module_config config = {.starts_at_once = true};
    bench->module = module_new(&config);
    if (bench->module == NULL ||
        !machine_init(&bench->machine, processor->kind, bench->module, 1, without)) {
        abort();  // no memory, or no such processor in the library
    }
    bench->machine.context = bench;
    bench->machine.on_byte = on_byte;
    machine_load(&bench->machine, processor->begin,
                 (size_t)(processor->end - processor->begin), 0);
    memset(bench->machine.avr->data + PROBE_RESULTS, 0, 64);
    bench->machine.avr->data[PROBE_ADDRESS] = (uint8_t)probe;
}

static void tear_down(struct bench *bench) {
    machine_free(&bench->machine);
    module_free(bench->module);
}

static unsigned result(const struct bench *bench, unsigned index) {
    const uint8_t *at = bench->machine.avr->data + PROBE_RESULTS + 2 * index;
    return (unsigned)(at[0] | (at[1] << 8));
}

// Runs the program. False where it is not done within the time.
static bool run_for(struct bench *bench, unsigned ms) {
    const uint64_t end = machine_now(&bench->machine) + (uint64_t)ms * MS_CYCLES;
    while (machine_now(&bench->machine) < end) {
        if (!machine_run(&bench->machine, machine_now(&bench->machine) + 1600)) {
            return false;
        }
        if (bench->machine.avr->data[REG_GPIOR2] == PROBE_DONE) {
            return true;
        }
    }
    return false;
}

// Runs until the program sets result 8 to this.
static void run_to_signal(struct bench *bench, unsigned value) {
    for (int i = 0; i < 200 * MS_CYCLES / 64 && result(bench, 8) != value; i++) {
        (void)machine_run(&bench->machine, machine_now(&bench->machine) + 64);
    }
}

static void found(struct bench *bench, const char *format, ...) {
    va_list list;
    va_start(list, format);
    (void)vsnprintf(bench->found, sizeof bench->found, format, list);
    va_end(list);
}

static bool is_in(uint64_t value, uint64_t low, uint64_t high) {
    return value >= low && value <= high;
}

static double wall_s(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

// What comes before a program is run.

// As long as the power is on.
static void hold_sda(struct bench *bench) {
    const struct chip_fault fault = {.kind = CHIP_FAULT_STUCK_SDA};
    (void)module_add_fault(bench->module, &fault);
}

static void hold_sda_for_five_clocks(struct bench *bench) {
    const struct chip_fault fault = {.kind = CHIP_FAULT_STUCK_SDA, .clocks = 5};
    (void)module_add_fault(bench->module, &fault);
}

static void send_six_bytes(struct bench *bench) {
    run_to_signal(bench, 1);
    for (uint8_t i = 0; i < 6; i++) {
        (void)machine_send(&bench->machine, machine_now(&bench->machine),
                           (uint8_t)(0x41 + i));
    }
}

static void press(struct bench *bench) {
    run_to_signal(bench, 1);
    machine_press(&bench->machine, true);
}

// Checks of more than single results. Each gets a bench with its program loaded and
// writes its findings.

// 7.7.1: from the end of one LDS to the end of the other SEI 1, NOP 1, entry 4, JMP 3,
// PUSH 2, LDS 2. Entry 5 with a return address of three bytes (ATmega2560 7.8.1).
static bool check_interrupt_entry(struct bench *bench) {
    const bool done = run_for(bench, 100);
    const unsigned cycles = (result(bench, 1) - result(bench, 0)) & 0xFF;
    const unsigned expected = bench->machine.kind == &machine_atmega2560 ? 14 : 13;
    found(bench, "%u cycles from SEI into the handler (%u)", cycles, expected);
    return done && cycles == expected;
}

// 20.4: a start bit, 8 of data, a stop bit; 32 cycles each at 500 kbaud.
static bool check_uart_byte_time(struct bench *bench) {
    const bool done = run_for(bench, 100);
    bool good = done && bench->bytes == 6;
    uint64_t worst = 320;
    for (unsigned i = 1; i < bench->bytes; i++) {
        const uint64_t time = bench->byte_cycles[i] - bench->byte_cycles[i - 1];
        good = good && time == 320;
        worst = time != 320 ? time : worst;
    }
    found(bench, "%u bytes, %u cycles each (6, 320)", bench->bytes, (unsigned)worst);
    return good;
}

// 100 ms of polling by a program that runs at full speed: below half a second even on
// a busy computer; simavr sleeps at each of 30000 looks.
static bool check_uart_polling(struct bench *bench) {
    const double from = wall_s();
    const bool done = run_for(bench, 1000);
    const double took = wall_s() - from;
    found(bench, "30000 looks took %.2f s (below 0.75)", took);
    return done && took < 0.75;
}

static bool check_sleep(struct bench *bench) {
    const double from = wall_s();
    const bool done = run_for(bench, 3000);
    const double took = wall_s() - from;
    const double slept = (double)bench->machine.asleep / MACHINE_HZ;
    found(bench, "%.2f s of sleep took %.2f s (2.1 in less than 1)", slept, took);
    return done && slept > 2.0 && took < 1.0;
}

static bool check_timer_preload(struct bench *bench) {
    const bool done = run_for(bench, 100);
    found(bench, "0x%04x, running 0x%04x; 0x%02x, stopped 0x%02x, again 0x%02x",
          result(bench, 0), result(bench, 1), result(bench, 2), result(bench, 3),
          result(bench, 4));
    return done && result(bench, 0) == 0x1234 &&
           is_in(result(bench, 1), 0x1235, 0x123C) &&
           is_in(result(bench, 2), 0x43, 0x4A) &&
           is_in(result(bench, 3), result(bench, 2) + 1, result(bench, 2) + 12) &&
           is_in(result(bench, 4), result(bench, 3) + 1, result(bench, 3) + 8);
}

// 11.8, 11.9.2: 16 ms. Interrupts alone: every time-out, or none while they are off.
// Both: an interrupt, then the reset. WDRF keeps WDE set, whatever is written, also
// over an external reset.
static bool check_watchdog_modes(struct bench *bench) {
    run_to_signal(bench, 1);
    const uint64_t from = machine_now(&bench->machine);
    run_to_signal(bench, 2);
    const uint64_t took = machine_now(&bench->machine) - from;
    machine_reset(&bench->machine, MACHINE_EXTERNAL);
    const bool done = run_for(bench, 100);
    static const unsigned expected[] = {2, 0xC0, 0x08, 0x08, 0x08, 0x0A, 0x08, 0};
    bool good = done && is_in(took, 2 * 256000 - 500, 2 * 256000 + 500);
    for (unsigned i = 0; i < sizeof expected / sizeof *expected; i++) {
        good = good && result(bench, i) == expected[i];
    }
    found(bench,
          "%u interrupts, WDTCSR 0x%02x 0x%02x, reset after %u cycles, 0x%02x 0x%02x, "
          "MCUSR 0x%02x, 0x%02x 0x%02x (2 c0 08 512000 08 08 0a 08 00)",
          result(bench, 0), result(bench, 1), result(bench, 2), (unsigned)took,
          result(bench, 3), result(bench, 4), result(bench, 5), result(bench, 6),
          result(bench, 7));
    return good;
}

// 11.9.1: causes add up until software clears them, power-on stands alone.
static bool check_reset_cause(struct bench *bench) {
    const bool first = run_for(bench, 100);
    machine_reset(&bench->machine, MACHINE_EXTERNAL);
    const bool second = run_for(bench, 100);
    machine_reset(&bench->machine, MACHINE_BROWN_OUT);
    // A brown-out loses SRAM, the program's number too: look at the register.
    const unsigned third = bench->machine.avr->data[REG_MCUSR];
    found(bench, "causes then 0x%02x (0x07)", third);
    return first && second && third == 0x07;
}

static bool check_floating_input(struct bench *bench) {
    const bool done = run_for(bench, 100);
    bool differs = false;
    for (unsigned i = 1; i < 8; i++) {
        differs = differs || result(bench, i) != result(bench, 0);
    }
    found(bench, "readings %u %u %u ... %s", result(bench, 0), result(bench, 1),
          result(bench, 2), differs ? "differ" : "are all the same");
    return done && differs;
}

// What a cut in the middle of the falling half leaves of a byte from 0xff to 0x5a: no
// bit falls that shall stay up, and not all have fallen that shall.
static bool check_power_cut(struct bench *bench) {
    while (machine_run(&bench->machine, machine_now(&bench->machine) + 64) &&
           !bench->machine.eeprom.is_busy) {
    }
    (void)machine_run(&bench->machine, machine_now(&bench->machine) + 40800);
    machine_cut_eeprom(&bench->machine);
    const uint8_t left = bench->machine.eeprom.bytes[5];
    found(bench, "0x%02x of 0xff -> 0x5a (holds all of 0x5a, is not 0x5a)", left);
    return (left & 0x5A) == 0x5A && left != 0x5A;
}

// A result of a program, and from what to what it may be.
struct expected {
    const char *what;
    unsigned index, low, high;
};

static const struct check {
    const char *name;
    enum probe probe;
    int fix;  // the correction it proves; -1: none, simavr has it right or has it not
    bool (*run)(struct bench *bench);      // null: prepare, run, compare
    void (*prepare)(struct bench *bench);  // may be null
    struct expected expected[7];           // ends with a null
} checks[] = {
    // Data sheet 22.5.2: 9 bits of 16 + 2 TWBR cycles; up to 64 more until the handler
    // has read the timer.
    {"twi_byte_time", PROBE_TWI_FAST, FIX_TWI_BYTE_TIME,
     .expected = {{"cycles a byte", 2, 360, 424}, {"and", 4, 360, 424}}},
    {"twi_byte_time at 100 kHz", PROBE_TWI_SLOW, FIX_TWI_BYTE_TIME,
     .expected = {{"cycles a byte", 2, 1440, 1504}, {"and", 4, 1440, 1504}}},
    // Table 22-2.
    {"twi_address_status", PROBE_TWI_FAST, FIX_TWI_ADDRESS_STATUS,
     .expected = {{"START", 1, 0x08, 0x08},
                  {"address", 3, 0x18, 0x18},
                  {"byte", 5, 0x28, 0x28}}},
    // 22.9.2: TWINT is cleared by writing a one to it.
    {"twi_flag", PROBE_TWI_FLAG, FIX_TWI_FLAG,
     .expected = {{"TWINT after START", 0, 1, 1},
                  {"at once after go", 1, 0, 0},
                  {"later", 2, 1, 1}}},
    // 22.9.2, TWSTA: a START waits for a free bus.
    {"twi_bus_held", PROBE_TWI_BUS_HELD, FIX_TWI_BUS_HELD, .prepare = hold_sda,
     .expected = {{"TWINT 1 ms after START", 0, 0, 0}}},
    {"bus_lines", PROBE_BUS_LINES, FIX_BUS_LINES, .prepare = hold_sda_for_five_clocks,
     .expected = {{"lines", 0, LINES_SCL, LINES_SCL},
                  {"free after pulses", 1, 5, 5},
                  {"SCL pulled", 2, 0, 0},
                  {"then", 3, LINES_SDA | LINES_SCL, LINES_SDA | LINES_SCL}}},
    {"interrupt_entry", PROBE_INTERRUPT_ENTRY, FIX_INTERRUPT_ENTRY,
     .run = check_interrupt_entry},
    // 7.7: flags are remembered while the enable bit is 0.
    {"interrupt_flags", PROBE_INTERRUPT_FLAGS, FIX_INTERRUPT_FLAGS,
     .expected = {{"flag", 0, 1, 1}, {"handled", 1, 1, 1}, {"flag", 2, 0, 0}}},
    // 13.2.3: EIFR, cleared by a one.
    {"external_flag", PROBE_EXTERNAL_FLAG, FIX_EXTERNAL_FLAG,
     .expected = {{"flag", 0, 0, 0}, {"handled", 1, 0, 0}}},
    {"uart_byte_time", PROBE_UART_SEND, FIX_UART_BYTE_TIME,
     .run = check_uart_byte_time},
    // 20.6.1: the first byte goes to the shift register, the second waits in the
    // buffer, the third waits for the first to be out.
    {"uart_double_buffer", PROBE_UART_DOUBLE_BUFFER, FIX_UART_DOUBLE_BUFFER,
     .expected = {{"ready after", 0, 0, 39}, {"", 1, 270, 340}, {"", 2, 290, 340}}},
    {"uart_baud_order", PROBE_UART_BAUD_ORDER, FIX_UART_BAUD_ORDER,
     .run = check_uart_byte_time},
    {"uart_polling", PROBE_UART_POLLING, FIX_UART_POLLING, .run = check_uart_polling},
    {"uart_receive", PROBE_UART_RECEIVE, -1, .prepare = send_six_bytes,
     .expected = {{"cycles a byte", 0, 300, 340},
                  {"overrun", 1, 1, 1},
                  {"kept", 2, 0x42, 0x42},
                  {"", 3, 0x43, 0x43},
                  {"", 4, 0x44, 0x44},
                  {"no more", 5, 0xFFFF, 0xFFFF}}},
    {"sleep", PROBE_SLEEP, FIX_SLEEP, .run = check_sleep},
    // Table 8-1: 3.4 ms, in ticks of 0.5 us.
    {"eeprom_time", PROBE_EEPROM_TIME, FIX_EEPROM_TIME,
     .expected = {{"ticks busy", 0, 6800, 6810},
                  {"then", 1, 0x5A, 0x5A},
                  {"next to it", 2, 0xFF, 0xFF}}},
    {"eeprom_ready", PROBE_EEPROM_READY, FIX_EEPROM_READY,
     .expected = {{"interrupts from an idle EEPROM", 0, 1, 1}}},
    {"power_cut", PROBE_EEPROM_TIME, -1, .run = check_power_cut},
    {"timer_preload", PROBE_TIMER_PRELOAD, FIX_TIMER_PRELOAD,
     .run = check_timer_preload},
    {"timer_compare", PROBE_TIMER_COMPARE, -1,
     .expected = {{"TCNT1 over two writes to OCR1", 0, 8, 24}}},
    {"watchdog_reset", PROBE_WATCHDOG_RESET, FIX_WATCHDOG_RESET,
     .expected = {{"set up", 0, 1, 1},
                  {"cause", 1, MACHINE_WATCHDOG, MACHINE_WATCHDOG},
                  {"edges of the sensor afterwards", 2, 9, 11}}},
    {"watchdog_modes", PROBE_WATCHDOG_MODES, FIX_WATCHDOG_MODES,
     .run = check_watchdog_modes},
    {"reset_cause", PROBE_RESET_CAUSE, FIX_RESET_CAUSE, .run = check_reset_cause},
    {"floating_input", PROBE_ANALOG, FIX_FLOATING_INPUT, .run = check_floating_input},
    // 1.1 V of 5 V in 10 bits, 24.7: 225.28.
    {"supply", PROBE_ANALOG, -1, .expected = {{"bandgap", 8, 225, 225}}},
    {"button", PROBE_BUTTON, -1, .prepare = press,
     .expected = {{"D3", 0, 1, 1}, {"pressed", 1, 0, 0}}},
};

// Prepares and runs the program, and compares its results.
static bool run_and_compare(struct bench *bench, const struct check *check) {
    if (check->prepare != NULL) {
        check->prepare(bench);
    }
    bool good = run_for(bench, 200);
    size_t used = 0;
    for (const struct expected *each = check->expected; each->what != NULL; each++) {
        const unsigned value = result(bench, each->index);
        good = good && is_in(value, each->low, each->high);
        used += (size_t)snprintf(bench->found + used, sizeof bench->found - used,
                                 "%s%s %u (%u to %u)", used > 0 ? ", " : "", each->what,
                                 value, each->low, each->high);
    }
    return good;
}

// The corrections to leave out together to show the defect: simavr's own interfaces
// rely on its own queue of interrupts.
static uint32_t left_out(enum machine_fix fix) {
    const uint32_t interfaces =
        (1U << FIX_TWI_BYTE_TIME) | (1U << FIX_TWI_ADDRESS_STATUS) |
        (1U << FIX_TWI_FLAG) | (1U << FIX_UART_BYTE_TIME) |
        (1U << FIX_UART_DOUBLE_BUFFER) | (1U << FIX_UART_BAUD_ORDER);
    const uint32_t bit = 1U << fix;
    return (bit & interfaces) != 0 ? bit | (1U << FIX_INTERRUPT_FLAGS) : bit;
}

static bool run_check(const struct processor *processor, const struct check *check,
                      uint32_t without, char *text, size_t room) {
    static struct bench bench;
    set_up(&bench, processor, check->probe, without);
    const bool passes =
        check->run != NULL ? check->run(&bench) : run_and_compare(&bench, check);
    (void)snprintf(text, room, "%s", bench.found);
    tear_down(&bench);
    return passes;
}

static bool tell(const struct processor *processor, const struct check *check,
                 bool is_good, const char *how, const char *text) {
    (void)printf("%s %s%s, %s: %s\n", is_good ? "PASS" : "FAIL", check->name, how,
                 processor->kind->mcu, text);
    (void)fflush(stdout);
    return is_good;
}

static bool runs(const struct processor *processor, const struct check *check) {
    char text[200];
    const bool passes = run_check(processor, check, 0, text, sizeof text);
    return tell(processor, check, passes, "", text);
}

// With its correction left out, on the first processor: libsimavr's code is the same
// for both.
static bool notices(const struct check *check) {
    char text[200];
    const bool passes = run_check(
        processors, check, left_out((enum machine_fix)check->fix), text, sizeof text);
    return tell(processors, check, !passes, " notices its absence", text);
}

static int run_without(const char *without) {
    bool is_known = false;
    bool all_pass = true;
    for (size_t i = 0; i < sizeof checks / sizeof *checks; i++) {
        const struct check *check = &checks[i];
        if (check->fix < 0 || strcmp(machine_fix_names[check->fix], without) != 0) {
            continue;
        }
        char text[200];
        is_known = true;
        const bool passes =
            run_check(processors, check, left_out((enum machine_fix)check->fix), text,
                      sizeof text);
        all_pass = tell(processors, check, passes, ", left out", text) && all_pass;
    }
    if (is_known) {
        return all_pass ? 0 : 1;
    }
    (void)fprintf(stderr, "nano: no correction is called %s; there are:", without);
    for (int i = 0; i < FIX_COUNT; i++) {
        (void)fprintf(stderr, " %s", machine_fix_names[i]);
    }
    (void)fputs("\n", stderr);
    return 2;
}

int selftest_run(const char *without) {
    if (without != NULL) {
        return run_without(without);
    }
    bool all_pass = true;
    for (size_t i = 0; i < sizeof checks / sizeof *checks; i++) {
        for (size_t j = 0; j < PROCESSORS; j++) {
            all_pass = runs(&processors[j], &checks[i]) && all_pass;
        }
        all_pass = (checks[i].fix < 0 || notices(&checks[i])) && all_pass;
    }
    return all_pass ? 0 : 1;
}
