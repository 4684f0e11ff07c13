// SPDX-License-Identifier: MIT
// Interrupts of the virtual Nano: a vector is served while its flag and its enable bit
// are set, whichever came first (data sheet 7.7). simavr only remembers what was raised
// while enabled.
#include "machine.h"

enum {
    VECTOR_INT0 = 1,
    VECTOR_INT1 = 2,
    VECTOR_EE_READY = 22,
    EECR_EEPE = 1 << 1,
    WAKE_UP_CYCLES = 4,  // data sheet 7.7.1: four more out of sleep
};

static bool is_bit_set(const avr_t *avr, avr_regbit_t bit) {
    return bit.reg != 0 && ((avr->data[bit.reg] >> bit.bit) & bit.mask) != 0;
}

// INT0 and INT1 by level (data sheet 13.2.1): pending as long as the pin is low.
static bool is_by_level(const avr_t *avr, int vector) {
    return (avr->data[REG_EICRA] & (3 << (2 * (vector - VECTOR_INT0)))) == 0;
}

static avr_int_vector_t *pending_interrupt(const struct machine *machine) {
    for (int i = 0; i < MACHINE_VECTORS; i++) {
        avr_int_vector_t *vector = machine->vectors[i];
        if (vector == NULL || !is_bit_set(machine->avr, vector->enable)) {
            continue;
        }
        if ((i == VECTOR_INT0 || i == VECTOR_INT1) && is_by_level(machine->avr, i)) {
            const int pin = i == VECTOR_INT0 ? MACHINE_PIN_INT0 : MACHINE_PIN_BUTTON;
            if ((machine->avr->data[REG_PIND] & (1 << pin)) == 0) {
                return vector;
            }
        } else if (vector->raised.reg != 0) {
            if (is_bit_set(machine->avr, vector->raised)) {
                return vector;
            }
        } else if (i == VECTOR_EE_READY && machine_fixes(machine, FIX_EEPROM_READY)) {
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

static void push_byte(avr_t *avr, uint8_t byte) {
    const uint16_t sp = (uint16_t)(avr->data[R_SPL] | (avr->data[R_SPH] << 8));
    if (sp >= MACHINE_SRAM_START && sp <= avr->ramend) {
        avr->data[sp] = byte;
    }
    avr->data[R_SPL] = (uint8_t)((sp - 1) & 0xFF);
    avr->data[R_SPH] = (uint8_t)((sp - 1) >> 8);
}

static void note_stack(struct machine *machine) {
    const uint16_t sp = machine_sp(machine);
    if (sp >= MACHINE_SRAM_START && sp <= MACHINE_SRAM_END) {
        const uint16_t depth = (uint16_t)(MACHINE_SRAM_END - sp);
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
            machine_stall(machine, WAKE_UP_CYCLES);
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
    const uint32_t return_word = from >> 1;
    push_byte(avr, (uint8_t)(return_word & 0xFF));
    push_byte(avr, (uint8_t)(return_word >> 8));
    note_stack(machine);
    avr->sreg[S_I] = 0;
    avr->interrupt_state = 0;
    avr->pc = (avr_flashaddr_t)vector->vector * avr->vector_size;
    avr_clear_interrupt(avr, vector);
    watchdog_served(machine, vector->vector);
    if (machine_fixes(machine, FIX_INTERRUPT_ENTRY)) {
        machine_stall(machine, MACHINE_INTERRUPT_CYCLES);
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
    for (int i = 1; i <= 2; i++) {
        if ((value & (1 << (i - 1))) && machine->vectors[i] != NULL) {
            avr->data[address] &= (uint8_t) ~(1 << (i - 1));
            avr_clear_interrupt(avr, machine->vectors[i]);
        }
    }
}

// EICRA: a level sets no flag (data sheet 13.2.3), so none is left when the mode
// changes.
static void write_eicra(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    for (int i = VECTOR_INT0; i <= VECTOR_INT1; i++) {
        if (is_by_level(avr, i) && machine->vectors[i] != NULL) {
            avr_clear_interrupt(avr, machine->vectors[i]);
        }
    }
    avr->data[address] = value;
    machine_poll_interrupts(machine);
}

void interrupts_init(struct machine *machine) {
    avr_t *avr = machine->avr;
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        if (vector->vector < MACHINE_VECTORS) {
            machine->vectors[vector->vector] = vector;
        }
    }
    if (machine_fixes(machine, FIX_INTERRUPT_FLAGS)) {
        machine_take(machine, REG_EIMSK, write_mask, NULL, NULL);
        machine_take(machine, REG_PCICR, write_mask, NULL, NULL);
        for (uint16_t mask = REG_TIMSK0; mask <= REG_TIMSK2; mask++) {
            machine_take(machine, mask, write_mask, NULL, NULL);
        }
    }
    if (machine_fixes(machine, FIX_EXTERNAL_FLAG)) {
        machine_take(machine, REG_EIFR, write_eifr, NULL, NULL);
        machine_take(machine, REG_EICRA, write_eicra, NULL, NULL);
    }
}
