// SPDX-License-Identifier: MIT
// The main loop, sleep, resets and pins; see machine.h.
#include "machine.h"

#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// Exported by libsimavr, but in no installed header: runs instructions until a cycle
// timer or an interrupt is due, and returns the next program counter.
extern avr_flashaddr_t avr_run_one(avr_t *avr);

enum {
    SMCR_SE = 1 << 0,
    SMCR_SM = 0x0E,
    RUN_LIMIT = 16000,  // cycles until machine_run() looks at its events again: 1 ms
    SUPPLY_MV = 5000,
};

const char *const machine_fix_names[FIX_COUNT] = {
    [FIX_TWI_BYTE_TIME] = "twi_byte_time",
    [FIX_TWI_ADDRESS_STATUS] = "twi_address_status",
    [FIX_TWI_FLAG] = "twi_flag",
    [FIX_TWI_BUS_HELD] = "twi_bus_held",
    [FIX_BUS_LINES] = "bus_lines",
    [FIX_INTERRUPT_ENTRY] = "interrupt_entry",
    [FIX_INTERRUPT_FLAGS] = "interrupt_flags",
    [FIX_EXTERNAL_FLAG] = "external_flag",
    [FIX_UART_BYTE_TIME] = "uart_byte_time",
    [FIX_UART_DOUBLE_BUFFER] = "uart_double_buffer",
    [FIX_UART_BAUD_ORDER] = "uart_baud_order",
    [FIX_UART_POLLING] = "uart_polling",
    [FIX_SLEEP] = "sleep",
    [FIX_EEPROM_TIME] = "eeprom_time",
    [FIX_EEPROM_READY] = "eeprom_ready",
    [FIX_TIMER_PRELOAD] = "timer_preload",
    [FIX_WATCHDOG_RESET] = "watchdog_reset",
    [FIX_WATCHDOG_MODES] = "watchdog_modes",
    [FIX_RESET_CAUSE] = "reset_cause",
    [FIX_FLOATING_INPUT] = "floating_input",
};

bool machine_fixes(const struct machine *machine, enum machine_fix fix) {
    return (machine->without & (1U << fix)) == 0;
}

void machine_complain(struct machine *machine, const char *what) {
    if (machine->complaint == NULL) {
        machine->complaint = what;
    }
}

uint64_t machine_now(const struct machine *machine) {
    return machine->avr->cycle;
}

// 62.5 ns a cycle, rounded down.
uint64_t machine_ns(uint64_t cycle) {
    return cycle * 125 / 2;
}

// The first cycle at or after that time.
static uint64_t cycle_at(uint64_t ns) {
    return ns / 125 * 2 + (ns % 125 * 2 + 124) / 125;
}

uint32_t machine_pc(const struct machine *machine) {
    return machine->avr->pc;
}

uint16_t machine_sp(const struct machine *machine) {
    const uint8_t *data = machine->avr->data;
    return (uint16_t)(data[R_SPL] | (data[R_SPH] << 8));
}

// xorshift64*, Vigna 2016: noise that is the same for the same seed.
uint32_t machine_random(struct machine *machine) {
    uint64_t x = machine->seed;
    x ^= x >> 12;
    x ^= x << 25;
    x ^= x >> 27;
    machine->seed = x;
    return (uint32_t)((x * UINT64_C(0x2545F4914F6CDD1D)) >> 32);
}

void machine_take(struct machine *machine, uint16_t address, avr_io_write_t write,
                  avr_io_read_t read, struct machine_hook *hook) {
    const size_t io = AVR_DATA_TO_IO(address);
    struct avr_t *avr = machine->avr;
    if (hook != NULL) {
        hook->write = avr->io[io].w.c;
        hook->write_param = avr->io[io].w.param;
        hook->read = avr->io[io].r.c;
        hook->read_param = avr->io[io].r.param;
    }
    if (write != NULL) {
        avr->io[io].w.c = write;
        avr->io[io].w.param = machine;
    }
    if (read != NULL) {
        avr->io[io].r.c = read;
        avr->io[io].r.param = machine;
    }
}

// D2 and D3

static uint8_t levels_of(const struct machine *machine) {
    const struct machine_kind *kind = machine->kind;
    const bool has_ready = machine->ready_is_high && !machine->is_unwired;
    return (uint8_t)((has_ready ? 1U << kind->ready_bit : 0U) |
                     (machine->button_is_down ? 0U : 1U << kind->button_bit));
}

static uint8_t wired_mask(const struct machine_kind *kind) {
    return (uint8_t)((1U << kind->ready_bit) | (1U << kind->button_bit));
}

static void follow_pin(struct machine *machine, unsigned bit) {
    avr_t *avr = machine->avr;
    const uint8_t port = machine->kind->pin_port;
    avr_ioport_external_t external = {
        .name = port & 0x7FU,
        .mask = wired_mask(machine->kind),
        .value = levels_of(machine),
    };
    avr_ioctl(avr, (uint32_t)AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
    avr_raise_irq(avr_io_getirq(avr, (uint32_t)AVR_IOCTL_IOPORT_GETIRQ(port), (int)bit),
                  (levels_of(machine) >> bit) & 1U);
    machine_poll_interrupts(machine);
}

// The levels that are driven from outside; for an output, what the pin drives itself.
static uint8_t read_pins(avr_t *avr, avr_io_addr_t address, void *param) {
    struct machine *machine = param;
    const uint8_t value = machine->pins.read(avr, address, machine->pins.read_param);
    const uint8_t outputs = avr->data[address + 1];  // DDRx
    const uint8_t inputs = wired_mask(machine->kind) & (uint8_t)~outputs;
    avr->data[address] = (uint8_t)((value & ~inputs) | (levels_of(machine) & inputs));
    return avr->data[address];
}

void machine_press(struct machine *machine, bool is_down) {
    machine->button_is_down = is_down;
    follow_pin(machine, machine->kind->button_bit);
}

// The sensor

static avr_cycle_count_t on_module_event(avr_t *avr, avr_cycle_count_t when,
                                         void *param) {
    (void)avr;
    struct machine *machine = param;
    module_advance(machine->module, machine_ns(when));
    const bool is_high = module_pin_is_high(machine->module);
    if (is_high != machine->ready_is_high) {
        machine->ready_is_high = is_high;
        if (is_high && machine->on_data_ready != NULL) {
            machine->on_data_ready(machine->context);
        }
        follow_pin(machine, machine->kind->ready_bit);
    }
    const uint64_t next = module_next_event(machine->module);
    if (next == UINT64_MAX) {
        return 0;
    }
    const uint64_t at = cycle_at(next);
    return at > when ? at : when + 1;
}

void machine_follow_module(struct machine *machine) {
    avr_t *avr = machine->avr;
    if (machine->module == NULL) {
        return;
    }
    const uint64_t next = on_module_event(avr, avr->cycle, machine);
    avr_cycle_timer_cancel(avr, on_module_event, machine);
    if (next != 0) {
        avr_cycle_timer_register(avr, next - avr->cycle, on_module_event, machine);
    }
}

// A7 is not connected, so the converter reads noise there.
static void on_conversion(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    struct machine *machine = param;
    if (machine_fixes(machine, FIX_FLOATING_INPUT)) {
        avr_raise_irq(avr_io_getirq(machine->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC7),
                      machine_random(machine) % SUPPLY_MV);
    }
}

static void write_mark(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    avr->data[address] = value;
    if (machine->on_mark != NULL) {
        machine->on_mark(machine->context, avr->cycle, value);
    }
}

// Reset

static void after_reset(struct machine *machine, uint8_t cause) {
    avr_t *avr = machine->avr;
    avr->run_cycle_limit = RUN_LIMIT;
    avr->run_cycle_count = 1;
    if (machine_fixes(machine, FIX_RESET_CAUSE)) {
        avr->data[REG_MCUSR] = cause;
    }
    watchdog_reset(machine);
    timers_reset(machine);
    // simavr would look at a low pin in every cycle.
    for (uint8_t i = 0; i < machine->kind->external_interrupts; i++) {
        avr_extint_set_strict_lvl_trig(avr, i, 0);
    }
    twi_reset(machine);
    lines_reset(machine);
    uart_reset(machine);
    eeprom_reset(machine);
    follow_pin(machine, machine->kind->ready_bit);
    follow_pin(machine, machine->kind->button_bit);
    if (machine_fixes(machine, FIX_WATCHDOG_RESET)) {
        machine_follow_module(machine);
    }
}

static void paint_stack(struct machine *machine) {
    const unsigned from = machine->stack.heap_start;
    memset(machine->avr->data + from, MACHINE_PAINT,
           machine->kind->sram_end + 1 - from);
}

void machine_reset(struct machine *machine, enum machine_reset cause) {
    avr_t *avr = machine->avr;
    const uint8_t causes = avr->data[REG_MCUSR];
    (void)machine_stack_deepest(machine);
    if (cause == MACHINE_BROWN_OUT) {
        // SRAM has lost its hold, the sensor its supply, an EEPROM write its power.
        machine_cut_eeprom(machine);
        for (unsigned i = 0; i < machine->stack.heap_start; i++) {
            avr->data[i] = (uint8_t)machine_random(machine);
        }
        paint_stack(machine);
        module_power_cycle(machine->module, machine_ns(avr->cycle));
    }
    avr_reset(avr);
    machine->resets++;
    if (machine->on_reset != NULL) {
        machine->on_reset(machine->context, cause);
    }
    // Flags of earlier resets stay until software clears them (data sheet 11.9.1).
    after_reset(machine, (uint8_t)(causes | cause));
}

// simavr's watchdog asks for a reset by putting its own function in avr->run.
static void reset_by_watchdog(struct machine *machine) {
    avr_t *avr = machine->avr;
    const uint8_t causes = avr->data[REG_MCUSR];
    (void)machine_stack_deepest(machine);
    if (machine->watchdog.wants_reset) {
        avr_reset(avr);
    } else {
        avr->run(avr);
    }
    machine->resets++;
    if (machine->on_reset != NULL) {
        machine->on_reset(machine->context, MACHINE_WATCHDOG);
    }
    after_reset(machine, (uint8_t)(causes | MACHINE_WATCHDOG));
}

// Life

static void keep_quiet(avr_t *avr, const int level, const char *format, va_list list) {
    (void)avr;
    if (level <= LOG_ERROR) {
        (void)vfprintf(stderr, format, list);
    }
}

// simavr's UART prints to the console and sleeps when polled, both unasked.
static void quiet_uart(struct machine *machine) {
    avr_t *avr = machine->avr;
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    if (machine_fixes(machine, FIX_UART_POLLING)) {
        flags &= ~(uint32_t)AVR_UART_FLAG_POLL_SLEEP;
    }
    flags &= ~(uint32_t)AVR_UART_FLAG_STDIO;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
}

bool machine_init(struct machine *machine, const struct machine_kind *kind,
                  struct module *module, uint64_t seed, uint32_t without) {
    avr_global_logger_set(keep_quiet);
    avr_t *avr = avr_make_mcu_by_name(kind->mcu);
    if (avr == NULL) {
        return false;
    }
    memset(machine, 0, sizeof *machine);
    machine->kind = kind;
    machine->avr = avr;
    machine->module = module;
    machine->without = without;
    machine->seed = seed * UINT64_C(0x9E3779B97F4A7C15) + UINT64_C(0x6A09E667F3BCC909);
    machine->clock_start = MACHINE_NEVER;
    machine->stack.heap_start = kind->sram_start;
    avr_init(avr);
    avr->log = LOG_ERROR;
    avr->frequency = MACHINE_HZ;
    avr->vcc = avr->avcc = avr->aref = SUPPLY_MV;
    memset(avr->data, MACHINE_REGISTERS, 32);
    paint_stack(machine);
    memset(machine->eeprom.bytes, 0xFF, sizeof machine->eeprom.bytes);

    quiet_uart(machine);
    timers_init(machine);
    machine_take(machine, REG_GPIOR0, write_mark, NULL, NULL);
    machine_take(machine, kind->pins, NULL, read_pins, &machine->pins);
    interrupts_init(machine);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_conversion,
        machine);
    twi_init(machine);
    lines_init(machine);
    uart_init(machine);
    eeprom_init(machine);
    watchdog_init(machine);
    after_reset(machine, MACHINE_POWER_ON);
    machine_follow_module(machine);
    return true;
}

void machine_free(struct machine *machine) {
    uart_free(machine);
    avr_terminate(machine->avr);
    free(machine->avr);
    machine->avr = NULL;
}

void machine_load(struct machine *machine, const uint8_t *code, size_t size,
                  uint32_t address) {
    avr_t *avr = machine->avr;
    memcpy(avr->flash + address, code, size);
    avr->codeend = (uint32_t)(address + size);
}

void machine_set_boot_start(struct machine *machine, uint32_t address) {
    machine->boot_start = address;
    machine->avr->reset_pc = address;
    machine->avr->pc = address;
}

static void sleep_for(struct machine *machine, avr_cycle_count_t cycles) {
    avr_t *avr = machine->avr;
    const uint8_t control = avr->data[REG_SMCR];
    if ((control & SMCR_SE) == 0) {  // data sheet 10.11.1: SLEEP does nothing then
        avr->state = cpu_Running;
        return;
    }
    if ((control & SMCR_SM) != 0) {
        machine_complain(machine, "a sleep mode that stops the clocks: only idle is "
                                  "modelled");
    }
    if (!avr->sreg[S_I]) {
        machine->is_stuck = true;
        return;
    }
    if (!machine_fixes(machine, FIX_SLEEP)) {
        avr_callback_sleep_raw(avr, cycles);
    }
    if (avr->cycle + cycles > machine->until) {
        cycles = machine->until > avr->cycle ? machine->until - avr->cycle : 0;
    }
    avr->cycle += cycles;
    machine->asleep += cycles;
}

// Runs up to the next timer of simavr or the next interrupt.
static void step(struct machine *machine) {
    avr_t *avr = machine->avr;
    if (avr->run != avr_callback_run_raw || machine->watchdog.wants_reset) {
        reset_by_watchdog(machine);
        return;
    }
    avr_flashaddr_t next = avr->pc;
    if (avr->state == cpu_Running) {
        next = avr_run_one(avr);
        if (machine->watch.on_instruction != NULL) {
            machine->watch.on_instruction(machine->watch.context, avr->pc, next);
        }
    }
    const avr_cycle_count_t until_timer = avr_cycle_timer_process(avr);
    avr->pc = next;
    if (avr->state == cpu_Sleeping) {
        if (machine_fixes(machine, FIX_INTERRUPT_FLAGS)) {
            interrupts_serve(machine);
        }
        if (avr->state == cpu_Sleeping) {
            sleep_for(machine, until_timer);
        }
        if (avr->state == cpu_Sleeping) {
            return;  // the timer that ends it runs first
        }
    }
    if (!machine_fixes(machine, FIX_INTERRUPT_FLAGS)) {
        const avr_flashaddr_t before = avr->pc;
        avr_service_interrupts(avr);
        if (avr->pc != before && machine_fixes(machine, FIX_INTERRUPT_ENTRY)) {
            machine_stall(machine, machine->kind->interrupt_cycles);
        }
        return;
    }
    interrupts_serve(machine);
}

bool machine_run(struct machine *machine, uint64_t until_cycle) {
    avr_t *avr = machine->avr;
    machine->until = until_cycle;
    // A watcher needs the instructions one by one.
    const uint64_t most = machine->watch.on_instruction != NULL ? 1 : RUN_LIMIT;
    while (avr->cycle < machine->until) {
        const uint64_t left = machine->until - avr->cycle;
        avr->run_cycle_limit = left < most ? left : most;
        if (avr->run_cycle_count > avr->run_cycle_limit) {
            avr->run_cycle_count = avr->run_cycle_limit;
        }
        step(machine);
        if (avr->state == cpu_Crashed || avr->state == cpu_Done || machine->is_stuck) {
            return false;
        }
    }
    return true;
}

void machine_pause(struct machine *machine, uint64_t at_cycle) {
    if (at_cycle < machine->until) {
        machine->until = at_cycle;
        machine->avr->run_cycle_count = 1;  // ends the burst of instructions
    }
}

// The unused part of SRAM between variables and stack is one run of equal bytes: our
// paint, or the firmware's own where it paints too. The first byte that differs belongs
// to the stack.
uint16_t machine_stack_deepest(struct machine *machine) {
    const uint8_t *data = machine->avr->data;
    unsigned at = machine->stack.heap_start;
    const uint8_t paint = data[at];
    while (at <= machine->kind->sram_end && data[at] == paint) {
        at++;
    }
    const uint16_t depth = (uint16_t)(machine->kind->sram_end + 1 - at);
    if (depth > machine->stack.deepest) {
        machine->stack.deepest = depth;
    }
    return machine->stack.deepest;
}
