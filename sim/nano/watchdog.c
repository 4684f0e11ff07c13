// SPDX-License-Identifier: MIT
// The watchdog and the reset flags (data sheet 11.8, 11.9): reset, interrupt, or first
// the one and then the other; the timed sequence; WDRF, which keeps the watchdog on.
// Replaces simavr's, which gives one interrupt and then none, lets go of the watchdog
// at an external reset, and has MCUSR written to any value.
#include <simavr/avr_watchdog.h>

#include "machine.h"

enum {
    WDIF = 1 << 7,
    WDIE = 1 << 6,
    WDCE = 1 << 4,
    WDE = 1 << 3,
    WDP = 0x27,
    CHANGE_CYCLES = 4,        // WDCE holds, 11.9.2
    SHORTEST_CYCLES = 256000  // 2048 of its own oscillator, 128 kHz: 16 ms
};

static uint64_t period(uint8_t control) {
    const unsigned prescaler = (control & 7U) | ((control & 0x20U) >> 2);
    return (uint64_t)SHORTEST_CYCLES << (prescaler < 9 ? prescaler : 9);
}

static avr_cycle_count_t on_timeout(avr_t *avr, avr_cycle_count_t when, void *param);

// Waits for the next time-out. Its counter runs on where only the time is changed, so a
// shorter one may be over.
static void schedule(struct machine *machine) {
    avr_t *avr = machine->avr;
    const uint8_t control = avr->data[REG_WDTCSR];
    avr_cycle_timer_cancel(avr, on_timeout, machine);
    if ((control & (WDE | WDIE)) == 0) {
        return;
    }
    const uint64_t time = period(control);
    const uint64_t gone = avr->cycle - machine->watchdog.started;
    avr_cycle_timer_register(avr, time - gone % time, on_timeout, machine);
}

static avr_cycle_count_t on_timeout(avr_t *avr, avr_cycle_count_t when, void *param) {
    struct machine *machine = param;
    uint8_t *control = &avr->data[REG_WDTCSR];
    // With both, the reset comes if the interrupt has not been served in time.
    if ((*control & WDE) && (!(*control & WDIE) || (*control & WDIF))) {
        machine->watchdog.wants_reset = true;
        avr->run_cycle_count = 1;
        return 0;
    }
    *control |= WDIF;
    machine_poll_interrupts(machine);
    return when + period(*control);
}

static void write_wdtcsr(avr_t *avr, avr_io_addr_t address, uint8_t value,
                         void *param) {
    struct machine *machine = param;
    struct machine_watchdog *watchdog = &machine->watchdog;
    const uint8_t old = avr->data[address];
    const bool may_change = (old & WDCE) && avr->cycle <= watchdog->changeable_until;
    uint8_t now = (uint8_t)((old & WDIF & ~value) | (value & WDIE));
    if (may_change) {
        now |= value & (WDE | WDP);
    } else {
        now |= (uint8_t)((old & (WDE | WDP)) | (value & WDE));
    }
    if (avr->data[REG_MCUSR] & MACHINE_WATCHDOG) {
        now |= WDE;
    }
    if ((value & WDCE) && (value & WDE)) {
        now |= WDCE;
        watchdog->changeable_until = avr->cycle + CHANGE_CYCLES;
    }
    avr->data[address] = now;
    if ((old & (WDE | WDIE)) == 0) {
        watchdog->started = avr->cycle;  // stood still
    }
    schedule(machine);
    machine_poll_interrupts(machine);
}

static uint8_t read_wdtcsr(avr_t *avr, avr_io_addr_t address, void *param) {
    const struct machine *machine = param;
    if (avr->cycle > machine->watchdog.changeable_until) {
        avr->data[address] &= (uint8_t)~WDCE;
    }
    return avr->data[address];
}

// Flags are only cleared, by a zero.
static void write_mcusr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)param;
    avr->data[address] &= value;
}

// The instruction WDR reaches all of simavr's interfaces, the last registered first.
static int on_ioctl(avr_io_t *io, uint32_t control, void *param) {
    (void)param;
    if (control != AVR_IOCTL_WATCHDOG_RESET) {
        return -1;
    }
    struct machine_watchdog *watchdog = (struct machine_watchdog *)io;
    watchdog->started = io->avr->cycle;
    schedule(watchdog->machine);
    return 0;
}

void watchdog_served(struct machine *machine, int vector) {
    uint8_t *control = &machine->avr->data[REG_WDTCSR];
    if (vector != machine->kind->watchdog_vector ||
        !machine_fixes(machine, FIX_WATCHDOG_MODES)) {
        return;
    }
    // simavr has just cleared WDIE in either mode.
    if (*control & WDE) {
        *control &= (uint8_t)~WDIE;
    } else {
        *control |= WDIE;
    }
}

void watchdog_init(struct machine *machine) {
    if (!machine_fixes(machine, FIX_WATCHDOG_MODES)) {
        return;
    }
    struct machine_watchdog *watchdog = &machine->watchdog;
    watchdog->machine = machine;
    watchdog->io.kind = "watchdog of ours";
    watchdog->io.ioctl = on_ioctl;
    avr_register_io(machine->avr, &watchdog->io);
    machine_take(machine, REG_WDTCSR, write_wdtcsr, read_wdtcsr, NULL);
    machine_take(machine, REG_MCUSR, write_mcusr, NULL, NULL);
}

void watchdog_reset(struct machine *machine) {
    if (!machine_fixes(machine, FIX_WATCHDOG_MODES)) {
        return;
    }
    avr_t *avr = machine->avr;
    machine->watchdog.wants_reset = false;
    machine->watchdog.changeable_until = 0;
    machine->watchdog.started = avr->cycle;
    avr->data[REG_WDTCSR] = (avr->data[REG_MCUSR] & MACHINE_WATCHDOG) ? WDE : 0;
    schedule(machine);
}
