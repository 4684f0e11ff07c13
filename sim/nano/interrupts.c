// SPDX-License-Identifier: MIT
// Interrupts: a vector is served while its flag and its enable bit
// are set, whichever came first (data sheet 7.7). simavr only remembers what was raised
// while enabled.
#include "machine.h"

enum {
    VECTOR_INT0 = 1,
    EECR_EEPE = 1 << 1,
};

static bool is_bit_set(const avr_t *avr, avr_regbit_t bit) {
    return bit.reg != 0 && ((avr->data[bit.reg] >> bit.bit) & bit.mask) != 0;
}

// An external interrupt by level (data sheet 13.2.1): pending as long as the pin is
// low.
static bool is_by_level(const avr_t *avr, int number) {
    const uint8_t control = avr->data[number < 4 ? REG_EICRA : REG_EICRB];
    return (control & (3 << (2 * (number % 4)))) == 0;
}

// The pin of an external interrupt, as a mask in the port of D2 and D3; 0 for another.
static uint8_t pin_of(const struct machine_kind *kind, int vector) {
    const int number = vector - VECTOR_INT0;
    return (uint8_t)(number == kind->ready_interrupt    ? 1U << kind->ready_bit
                     : number == kind->button_interrupt ? 1U << kind->button_bit
                                                        : 0U);
}

static avr_int_vector_t *pending_interrupt(const struct machine *machine) {
    const struct machine_kind *kind = machine->kind;
    for (int i = 0; i < kind->vectors; i++) {
        avr_int_vector_t *vector = machine->vectors[i];
        if (vector == NULL || !is_bit_set(machine->avr, vector->enable)) {
            continue;
        }
        const uint8_t pin = pin_of(kind, i);
        if (pin != 0 && is_by_level(machine->avr, i - VECTOR_INT0)) {
            if ((machine->avr->data[kind->pins] & pin) == 0) {
                return vector;
            }
        } else if (vector->raised.reg != 0) {
            if (is_bit_set(machine->avr, vector->raised)) {
                return vector;
            }
        } else if (i == kind->eeprom_vector &&
                   machine_fixes(machine, FIX_EEPROM_READY)) {
            // Pending as long as no write is under way (data sheet 8.6.3).
            if ((machine->avr->data[REG_EECR] & EECR_EEPE) == 0) {
                return vector;
            }
        } else if (vector->pending) {
            return vector;
        }
    }
    return NULL;
}

void machine_poll_interrupts(struct machine *machine) {
    avr_t *avr = machine->avr;
    if (!machine_fixes(machine, FIX_INTERRUPT_FLAGS)) {
        return;
    }
    if (avr->interrupt_state == 0 && avr->sreg[S_I] &&
        pending_interrupt(machine) != NULL) {
        avr->interrupt_state = 1;  // ends the burst of instructions after this one
    }
}

void machine_stall(struct machine *machine, unsigned cycles) {
    avr_t *avr = machine->avr;
    avr->cycle += cycles;
    avr->run_cycle_count =
        avr->run_cycle_count > cycles ? avr->run_cycle_count - cycles : 1;
}

static void push_byte(const struct machine *machine, uint8_t byte) {
    avr_t *avr = machine->avr;
    const uint16_t sp = (uint16_t)(avr->data[R_SPL] | (avr->data[R_SPH] << 8));
    if (sp >= machine->kind->sram_start && sp <= machine->kind->sram_end) {
        avr->data[sp] = byte;
    }
    avr->data[R_SPL] = (uint8_t)((sp - 1) & 0xFF);
    avr->data[R_SPH] = (uint8_t)((sp - 1) >> 8);
}

static void note_stack(struct machine *machine) {
    const uint16_t sp = machine_sp(machine);
    const struct machine_kind *kind = machine->kind;
    if (sp >= kind->sram_start && sp <= kind->sram_end) {
        const uint16_t depth = (uint16_t)(kind->sram_end - sp);
        if (depth > machine->stack.deepest) {
            machine->stack.deepest = depth;
        }
    }
}

void interrupts_serve(struct machine *machine) {
    avr_t *avr = machine->avr;
    avr->interrupts.pending.read = avr->interrupts.pending.write;  // simavr's own queue
    if (avr->state == cpu_Sleeping && avr->sreg[S_I] &&
        pending_interrupt(machine) != NULL) {
        avr->state = cpu_Running;
        avr->interrupt_state = 1;
        if (machine_fixes(machine, FIX_INTERRUPT_ENTRY)) {
            machine_stall(machine, machine->kind->interrupt_cycles);
        }
    }
    if (!avr->sreg[S_I] || avr->interrupt_state == 0 || avr->state != cpu_Running) {
        return;
    }
    avr_int_vector_t *vector = pending_interrupt(machine);
    if (avr->interrupt_state < 0) {  // I has just been set: one instruction more
        avr->interrupt_state = vector != NULL ? 1 : 0;
        return;
    }
    if (vector == NULL) {
        avr->interrupt_state = 0;
        return;
    }
    const avr_flashaddr_t from = avr->pc;
    for (uint8_t i = 0; i < machine->kind->return_bytes; i++) {
        push_byte(machine, (uint8_t)(from >> 1 >> (8 * i)));
    }
    note_stack(machine);
    avr->sreg[S_I] = 0;
    avr->interrupt_state = 0;
    avr->pc = (avr_flashaddr_t)vector->vector * avr->vector_size;
    avr_clear_interrupt(avr, vector);
    watchdog_served(machine, vector->vector);
    if (machine_fixes(machine, FIX_INTERRUPT_ENTRY)) {
        machine_stall(machine, machine->kind->interrupt_cycles);
    }
    if (machine->watch.on_interrupt != NULL) {
        machine->watch.on_interrupt(machine->watch.context, from, avr->pc);
    }
}

// A mask register: an interrupt whose flag is already set may come at once.
static void write_mask(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    avr->data[address] = value;
    machine_poll_interrupts(param);
}

// EIFR: writing a one clears the flag (data sheet 13.2.3); simavr does not do that.
static void write_eifr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    for (int i = 0; i < machine->kind->external_interrupts; i++) {
        if ((value & (1 << i)) && machine->vectors[VECTOR_INT0 + i] != NULL) {
            avr->data[address] &= (uint8_t) ~(1 << i);
            avr_clear_interrupt(avr, machine->vectors[VECTOR_INT0 + i]);
        }
    }
}

// EICRA, EICRB: a level sets no flag (data sheet 13.2.3), so none is left when the mode
// changes.
static void write_eicr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    for (int i = 0; i < machine->kind->external_interrupts; i++) {
        if (is_by_level(avr, i) && machine->vectors[VECTOR_INT0 + i] != NULL) {
            avr_clear_interrupt(avr, machine->vectors[VECTOR_INT0 + i]);
        }
    }
    avr->data[address] = value;
    machine_poll_interrupts(machine);
}

void interrupts_init(struct machine *machine) {
    avr_t *avr = machine->avr;
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        if (vector->vector < machine->kind->vectors) {
            machine->vectors[vector->vector] = vector;
        }
    }
    if (machine_fixes(machine, FIX_INTERRUPT_FLAGS)) {
        machine_take(machine, REG_EIMSK, write_mask, NULL, NULL);
        machine_take(machine, REG_PCICR, write_mask, NULL, NULL);
        for (uint16_t mask = REG_TIMSK0; mask < machine->kind->timer_masks_end;
             mask++) {
            machine_take(machine, mask, write_mask, NULL, NULL);
        }
    }
    if (machine_fixes(machine, FIX_EXTERNAL_FLAG)) {
        machine_take(machine, REG_EIFR, write_eifr, NULL, NULL);
        machine_take(machine, REG_EICRA, write_eicr, NULL, NULL);
        if (machine->kind->external_interrupts > 4) {
            machine_take(machine, REG_EICRB, write_eicr, NULL, NULL);
        }
    }
}
