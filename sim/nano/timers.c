// SPDX-License-Identifier: MIT
// Timers: simavr forgets what was written to TCNT while the clock
// was stopped (data sheet 15, 16, 18).
#include <stdlib.h>

#include "machine.h"

enum { CLOCK_SELECT = 0x07 };

static struct machine_timer *find_timer(struct machine *machine, uint16_t address) {
    for (int i = 0; i < 3; i++) {
        struct machine_timer *timer = &machine->timers[i];
        if (timer->control == address || timer->count == address) {
            return timer;
        }
    }
    abort();  // hooked registers are all in the table
}

static void put_count(avr_t *avr, const struct machine_timer *timer) {
    avr->data[timer->count] = (uint8_t)(timer->held & 0xFF);
    if (timer->count_high != 0) {
        avr->data[timer->count_high] = (uint8_t)(timer->held >> 8);
    }
}

static uint16_t get_count(const avr_t *avr, const struct machine_timer *timer) {
    const uint16_t high = timer->count_high != 0 ? avr->data[timer->count_high] : 0;
    return (uint16_t)(avr->data[timer->count] | (high << 8));
}

static void write_count(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    struct machine_timer *timer = find_timer(machine, address);
    if ((avr->data[timer->control] & CLOCK_SELECT) == 0) {
        avr->data[address] = value;
        timer->held = get_count(avr, timer);
        return;
    }
    timer->count_hook.write(avr, address, value, timer->count_hook.write_param);
}

static uint8_t read_count(avr_t *avr, avr_io_addr_t address, void *param) {
    struct machine *machine = param;
    struct machine_timer *timer = find_timer(machine, address);
    if ((avr->data[timer->control] & CLOCK_SELECT) == 0) {
        put_count(avr, timer);
        return avr->data[address];
    }
    return timer->count_hook.read(avr, address, timer->count_hook.read_param);
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value,
                          void *param) {
    struct machine *machine = param;
    struct machine_timer *timer = find_timer(machine, address);
    const bool was_running = (avr->data[address] & CLOCK_SELECT) != 0;
    const bool is_running = (value & CLOCK_SELECT) != 0;
    // A bootloader may use the timer, too.
    const bool is_firmware = machine->boot_start == 0 || avr->pc < machine->boot_start;
    if (address == REG_TCCR1B && is_running && is_firmware) {
        machine->clock_restart = avr->cycle;
        if (machine->clock_start == MACHINE_NEVER) {
            machine->clock_start = avr->cycle;
        }
    }
    if (!machine_fixes(machine, FIX_TIMER_PRELOAD)) {
        timer->control_hook.write(avr, address, value, timer->control_hook.write_param);
        return;
    }
    if (was_running && !is_running) {
        (void)timer->count_hook.read(avr, timer->count, timer->count_hook.read_param);
        timer->held = get_count(avr, timer);
    }
    timer->control_hook.write(avr, address, value, timer->control_hook.write_param);
    if (!was_running && is_running && timer->held != 0) {
        put_count(avr, timer);
        timer->count_hook.write(avr, timer->count, avr->data[timer->count],
                                timer->count_hook.write_param);
    }
}

void timers_init(struct machine *machine) {
    static const uint16_t registers[3][3] = {
        {REG_TCCR0B, REG_TCNT0, 0},
        {REG_TCCR1B, REG_TCNT1L, REG_TCNT1H},
        {REG_TCCR2B, REG_TCNT2, 0},
    };
    const bool is_fixed = machine_fixes(machine, FIX_TIMER_PRELOAD);
    for (int i = 0; i < 3; i++) {
        struct machine_timer *timer = &machine->timers[i];
        *timer = (struct machine_timer){.control = registers[i][0],
                                        .count = registers[i][1],
                                        .count_high = registers[i][2]};
        machine_take(machine, timer->control, write_control, NULL,
                     &timer->control_hook);
        machine_take(machine, timer->count, is_fixed ? write_count : NULL,
                     is_fixed ? read_count : NULL, &timer->count_hook);
    }
}

void timers_reset(struct machine *machine) {
    for (int i = 0; i < 3; i++) {
        machine->timers[i].held = 0;
    }
}
