// SPDX-License-Identifier: MIT
// The EEPROM (data sheet 8.4, 8.6), with the time that a write takes and what a power
// cut leaves of a byte half written. Replaces simavr's, which writes at once.
#include "machine.h"

enum {
    EERE = 1 << 0,
    EEPE = 1 << 1,
    EEMPE = 1 << 2,
    EERIE = 1 << 3,
    EEPM = 0x30,
    EEPM_ERASE = 0x10,
    EEPM_WRITE = 0x20,
    // Data sheet 8.6.3, table 8-1: erase and write in one, or one of them.
    BOTH_CYCLES = 54400,    // 3.4 ms
    SINGLE_CYCLES = 28800,  // 1.8 ms
    MASTER_CYCLES = 4,      // EEMPE holds
    READ_STALL = 4,         // 8.6.3
    WRITE_STALL = 2,
};

static bool is_own(const struct machine *machine) {
    return machine_fixes(machine, FIX_EEPROM_TIME) &&
           machine_fixes(machine, FIX_EEPROM_READY);
}

static avr_cycle_count_t on_master_end(avr_t *avr, avr_cycle_count_t when,
                                       void *param) {
    (void)when;
    (void)param;
    avr->data[REG_EECR] &= (uint8_t)~EEMPE;
    return 0;
}

static avr_cycle_count_t on_written(avr_t *avr, avr_cycle_count_t when, void *param) {
    (void)when;
    struct machine *machine = param;
    machine->eeprom.bytes[machine->eeprom.address] = machine->eeprom.value;
    machine->eeprom.is_busy = false;
    avr->data[REG_EECR] &= (uint8_t)~EEPE;
    machine_poll_interrupts(machine);
    return 0;
}

static uint16_t address_of(const struct machine *machine) {
    const avr_t *avr = machine->avr;
    return (uint16_t)((avr->data[REG_EEARL] | (avr->data[REG_EEARH] << 8)) &
                      (machine->kind->eeprom_size - 1));
}

static void begin_write(struct machine *machine) {
    avr_t *avr = machine->avr;
    struct machine_eeprom *eeprom = &machine->eeprom;
    const uint8_t mode = avr->data[REG_EECR] & EEPM;
    const uint8_t data = avr->data[REG_EEDR];
    eeprom->address = address_of(machine);
    eeprom->before = eeprom->bytes[eeprom->address];
    // Erasing sets bits, writing clears them.
    eeprom->value = data;
    if (mode == EEPM_ERASE) {
        eeprom->value = 0xFF;
    } else if (mode == EEPM_WRITE) {
        eeprom->value = eeprom->before & data;
    }
    const unsigned time = mode == 0 ? BOTH_CYCLES : SINGLE_CYCLES;
    eeprom->is_busy = true;
    eeprom->started = avr->cycle;
    eeprom->done = avr->cycle + time;
    eeprom->writes++;
    avr->data[REG_EECR] |= EEPE;
    avr_cycle_timer_register(avr, time, on_written, machine);
    machine_stall(machine, WRITE_STALL);
    if (machine->on_eeprom_write != NULL) {
        machine->on_eeprom_write(machine->context, eeprom->writes);
    }
}

static void write_eecr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    struct machine_eeprom *eeprom = &machine->eeprom;
    const uint8_t old = avr->data[address];
    // EEPM can't be changed during a write.
    uint8_t now = (uint8_t)((eeprom->is_busy ? old & EEPM : value & EEPM) |
                            (value & EERIE) | (old & (EEMPE | EEPE)));
    avr->data[address] = now;
    const bool programs = (value & EEPE) != 0 && (old & EEPE) == 0;
    if (programs && (old & EEMPE)) {
        avr_cycle_timer_cancel(avr, on_master_end, machine);
        avr->data[address] &= (uint8_t)~EEMPE;
        begin_write(machine);
    } else if (value & EEMPE) {
        avr->data[address] |= EEMPE;
        avr_cycle_timer_register(avr, MASTER_CYCLES + 1, on_master_end, machine);
    }
    if (value & EERE) {
        if (eeprom->is_busy) {
            machine_complain(machine, "EEPROM read during a write");
        } else {
            avr->data[REG_EEDR] = eeprom->bytes[address_of(machine)];
            machine_stall(machine, READ_STALL);
        }
    }
    machine_poll_interrupts(machine);
}

void machine_cut_eeprom(struct machine *machine) {
    struct machine_eeprom *eeprom = &machine->eeprom;
    if (!eeprom->is_busy) {
        return;
    }
    // In the first half of a write bits rise to one, in the second they fall to the
    // value, each at a moment of its own.
    const uint64_t half = (eeprom->done - eeprom->started) / 2;
    uint64_t gone = machine_now(machine) - eeprom->started;
    const bool erases = gone < half;
    gone -= erases ? 0 : half;
    uint8_t *cell = &eeprom->bytes[eeprom->address];
    *cell = erases ? eeprom->before : 0xFF;
    const uint8_t target = erases ? 0xFF : eeprom->value;
    for (int bit = 0; bit < 8; bit++) {
        if (machine_random(machine) % half < gone) {
            *cell = (uint8_t)((*cell & ~(1 << bit)) | (target & (1 << bit)));
        }
    }
    eeprom->is_busy = false;
}

void eeprom_init(struct machine *machine) {
    if (is_own(machine)) {
        machine_take(machine, REG_EECR, write_eecr, NULL, NULL);
    }
}

// A write continues through a reset (data sheet 8.4.1).
void eeprom_reset(struct machine *machine) {
    struct machine_eeprom *eeprom = &machine->eeprom;
    if (!is_own(machine) || !eeprom->is_busy) {
        return;
    }
    avr_t *avr = machine->avr;
    avr->data[REG_EECR] |= EEPE;
    const uint64_t left = eeprom->done > avr->cycle ? eeprom->done - avr->cycle : 1;
    avr_cycle_timer_register(avr, left, on_written, machine);
}
