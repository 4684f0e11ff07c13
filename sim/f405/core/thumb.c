// SPDX-License-Identifier: MIT
// Executes the common instructions: those of the integer core, moves of the FPU's
// registers, loads and stores to memory and to registers of peripherals. A rarer
// instruction, or one that ends in a fault, changes nothing here and is left to
// libunicorn (ARM, chapters A5 to A7; names of the encodings as there).
#include "thumb_step.h"

// Loads and stores, or all else (ARM, table A5-9).
static enum outcome do_32(struct step *s, unsigned a, unsigned b) {
    const unsigned operation = field(a, 4, 7);
    const unsigned group = field(a, 11, 2);
    const bool is_memory = group == 1   ? (operation & 0x60) != 0x20
                           : group == 3 ? (operation & 0x60) == 0x00
                                        : false;
    return is_memory ? thumb_memory_32(s, a, b) : thumb_data_32(s, a, b);
}

// The next state of an IT block (ARM, ITSTATE).
uint8_t thumb_advance(uint8_t it) {
    return (it & 7) == 0 ? 0 : (uint8_t)((it & 0xE0) | (it << 1 & 0x1F));
}

static bool is_due(struct f405 *m) {
    if (m->attention != 0) {
        m->attention--;
        m->is_stopped = m->attention == 0;
    }
    return m->cycle >= m->limit_cycle || m->is_stopped ||
           (m->flash_control.is_busy && f405_is_flash(m->pc));
}

// The code at an address: flash first. Code can't run from the CCM.
static const uint8_t *code_at(struct f405 *m, uint32_t pc) {
    if (pc - F405_FLASH <= F405_FLASH_SIZE - 4) {
        return m->flash + (pc - F405_FLASH);
    }
    return pc - F405_CCM < F405_CCM_SIZE ? NULL : f405_memory(m, pc, 4);
}

enum thumb thumb_run(struct f405 *m) {
    struct f405_registers *x = &m->registers;
    for (;;) {
        if (x->it == 0 && is_due(m)) {  // an IT block is never interrupted
            m->is_stopped = true;
            return THUMB_STOPPED;
        }
        const uint8_t *code = code_at(m, m->pc);
        if (code == NULL) {
            return THUMB_UNKNOWN;
        }
        const unsigned a = code[0] | (code[1] << 8);
        const unsigned b = code[2] | (code[3] << 8);
        const uint32_t length = a >= 0xE800 ? 4 : 2;
        const uint8_t it = x->it;
        struct step s = {m, x, m->pc, m->pc + length, it == 0};
        if (it != 0) {
            if ((a & 0xFF00) == 0xBE00) {
                return THUMB_UNKNOWN;  // BKPT ignores the condition
            }
            x->it = thumb_advance(it);
            if (!passes(x, it >> 4)) {
                m->pc = s.next;  // takes no cycle, as libunicorn counts
                continue;
            }
        }
        m->cycle++;  // a clock that it reads shows its end
        const enum outcome outcome = length == 4 ? do_32(&s, a, b) : thumb_do_16(&s, a);
        if (outcome == UNKNOWN) {
            m->cycle--;
            x->it = it;
            return THUMB_UNKNOWN;
        }
        m->pc = s.next;
        if (m->watch.on_instruction != NULL) {
            m->watch.on_instruction(m->watch.context, s.at, s.next);
        }
        if (outcome != DONE) {
            return (enum thumb)outcome;
        }
    }
}
