// SPDX-License-Identifier: MIT
// Calls, returns and interrupts of the processor; see follow.h.
#include "follow.h"

// CALL, ICALL, EICALL, RCALL (instruction set manual, DS40002198). RCALL to the next
// instruction makes room on the stack, and nothing else.
static bool is_call(uint16_t opcode, uint32_t at, uint32_t next) {
    return (opcode & 0xFE0E) == 0x940E || opcode == 0x9509 || opcode == 0x9519 ||
           ((opcode & 0xF000) == 0xD000 && next != at + 2);
}

static bool is_return(uint16_t opcode) {
    return opcode == 0x9508 || opcode == 0x9518;  // RET, RETI
}

static uint16_t opcode_at(const struct machine *machine, uint32_t address) {
    const uint8_t *flash = machine->avr->flash + address % machine->kind->flash_size;
    return (uint16_t)(flash[0] | (flash[1] << 8));
}

struct profile_time follow_time(const struct machine *machine) {
    return (struct profile_time){machine_now(machine), machine->asleep};
}

static void on_instruction(void *context, uint32_t at, uint32_t next) {
    const struct follow *follow = context;
    const uint16_t opcode = opcode_at(follow->machine, at);
    const uint16_t sp = machine_sp(follow->machine);
    profile_instruction(follow->profile, at, follow_time(follow->machine));
    if (is_call(opcode, at, next)) {
        const struct profile_call call = {
            .from = at,
            .entry = next,
            .sp = (uint32_t)sp + follow->machine->kind->return_bytes,
        };
        profile_call(follow->profile, call);
    } else if (is_return(opcode)) {
        profile_return_above(follow->profile, sp);
    }
}

// The handler that a vector's JMP or RJMP leads to.
static uint32_t handler_of(const struct machine *machine, uint32_t vector) {
    const uint16_t opcode = opcode_at(machine, vector);
    if ((opcode & 0xFE0E) == 0x940C) {
        return 2U * opcode_at(machine, vector + 2) % machine->kind->flash_size;
    }
    if ((opcode & 0xF000) == 0xC000) {
        const uint32_t offset = (opcode & 0x0FFFU) ^ 0x0800;
        return (vector + 2 + 2 * (offset - 0x0800)) % machine->kind->flash_size;
    }
    return vector;
}

static void on_interrupt(void *context, uint32_t from, uint32_t vector) {
    const struct follow *follow = context;
    const struct profile_call call = {
        .from = from,
        .entry = handler_of(follow->machine, vector),
        .sp =
            (uint32_t)machine_sp(follow->machine) + follow->machine->kind->return_bytes,
    };
    profile_interrupt(follow->profile, call, follow_time(follow->machine));
}

void follow_begin(struct follow *follow) {
    // The vector table's jumps count for the handlers.
    for (uint32_t i = 0; i < follow->machine->kind->vectors; i++) {
        profile_same(follow->profile, 4 * i, handler_of(follow->machine, 4 * i));
    }
    follow->machine->watch =
        (struct machine_watch){follow, on_instruction, on_interrupt};
}
