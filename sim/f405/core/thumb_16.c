// SPDX-License-Identifier: MIT
// The instructions of 16 bits (ARM, chapter A5.2); see thumb.c.
#include "thumb_step.h"

enum {
    WFI = 0xBF30,
    NOP = 0xBF00,
};

static enum outcome shift_immediate(struct step *s, unsigned word) {
    struct f405_registers *x = s->x;
    bool carry = x->c;
    const uint32_t result = shift_by(x->r[field(word, 3, 3)], field(word, 11, 2),
                                     field(word, 6, 5), &carry);
    x->r[word & 7] = result;
    if (s->sets) {
        set_nz(x, result);
        x->c = carry;
    }
    return DONE;
}

static enum outcome add_subtract(struct step *s, unsigned word) {
    struct f405_registers *x = s->x;
    const unsigned last = field(word, 6, 3);
    const uint32_t b = field(word, 10, 1) != 0 ? last : x->r[last];
    const bool is_minus = field(word, 9, 1) != 0;
    x->r[word & 7] =
        add(x, x->r[field(word, 3, 3)], is_minus ? ~b : b, is_minus, s->sets);
    return DONE;
}

static enum outcome immediate_8(struct step *s, unsigned word) {
    struct f405_registers *x = s->x;
    const unsigned reg = field(word, 8, 3);
    const uint32_t value = word & 0xFF;
    switch (field(word, 11, 2)) {
    case 0:  // MOV
        x->r[reg] = value;
        if (s->sets) {
            set_nz(x, value);
        }
        break;
    case 1:  // CMP
        (void)add(x, x->r[reg], ~value, 1, true);
        break;
    case 2:
        x->r[reg] = add(x, x->r[reg], value, 0, s->sets);
        break;
    default:
        x->r[reg] = add(x, x->r[reg], ~value, 1, s->sets);
        break;
    }
    return DONE;
}

static void logic(struct step *s, unsigned reg, uint32_t result) {
    s->x->r[reg] = result;
    if (s->sets) {
        set_nz(s->x, result);
    }
}

static void shift_register(struct step *s, unsigned reg, enum shift kind, uint32_t by) {
    bool carry = s->x->c;
    logic(s, reg, shift(s->x->r[reg], kind, by & 0xFF, &carry));
    s->x->c = s->sets ? carry : s->x->c;
}

static enum outcome data_16(struct step *s, unsigned word) {
    struct f405_registers *x = s->x;
    const unsigned d = word & 7;
    const uint32_t a = x->r[d];
    const uint32_t b = x->r[field(word, 3, 3)];
    switch (field(word, 6, 4)) {
    case 0:
        logic(s, d, a & b);
        break;
    case 1:
        logic(s, d, a ^ b);
        break;
    case 2:
        shift_register(s, d, LSL, b);
        break;
    case 3:
        shift_register(s, d, LSR, b);
        break;
    case 4:
        shift_register(s, d, ASR, b);
        break;
    case 5:
        x->r[d] = add(x, a, b, x->c, s->sets);
        break;
    case 6:
        x->r[d] = add(x, a, ~b, x->c, s->sets);
        break;
    case 7:
        shift_register(s, d, ROR, b);
        break;
    case 8:  // TST
        set_nz(x, a & b);
        break;
    case 9:  // RSB of 0
        x->r[d] = add(x, 0, ~b, 1, s->sets);
        break;
    case 10:  // CMP
        (void)add(x, a, ~b, 1, true);
        break;
    case 11:  // CMN
        (void)add(x, a, b, 0, true);
        break;
    case 12:
        logic(s, d, a | b);
        break;
    case 13:
        logic(s, d, a * b);
        break;
    case 14:
        logic(s, d, a & ~b);
        break;
    default:
        logic(s, d, ~b);
        break;
    }
    return DONE;
}

// ADD, CMP, MOV with any register; BX, BLX.
static enum outcome special(struct step *s, unsigned word) {
    const unsigned from = field(word, 3, 4);
    const unsigned to = (word & 7) | field(word, 7, 1) << 3;
    const uint32_t value = get(s, from);
    enum outcome outcome = DONE;
    switch (field(word, 8, 2)) {
    case 0:
    case 2: {
        const uint32_t result = field(word, 9, 1) != 0 ? value : get(s, to) + value;
        if (to == PC) {
            s->next = result & ~UINT32_C(1);
        } else {
            set(s, to, result);
        }
        break;
    }
    case 1:
        if (is_bad(to) && to == PC) {
            return UNKNOWN;
        }
        (void)add(s->x, get(s, to), ~value, 1, true);
        break;
    default:
        if ((word & 7) != 0 || from == PC) {
            return UNKNOWN;
        }
        if (field(word, 7, 1) == 0) {
            return jump(s, value);
        }
        if ((value & 1) == 0) {
            return UNKNOWN;
        }
        outcome = jump(s, value);
        s->x->r[LR] = (s->at + 2) | 1;
        break;
    }
    return outcome;
}

static enum outcome transfer_register(struct step *s, unsigned word) {
    static const struct {
        uint8_t size, how;
    } kinds[8] = {{4, 0},       {2, 0},       {1, 0},       {1, IS_LOAD | IS_SIGNED},
                  {4, IS_LOAD}, {2, IS_LOAD}, {1, IS_LOAD}, {2, IS_LOAD | IS_SIGNED}};
    const unsigned kind = field(word, 9, 3);
    const uint32_t address = s->x->r[field(word, 3, 3)] + s->x->r[field(word, 6, 3)];
    return transfer(s, word & 7, address, kinds[kind].size, kinds[kind].how);
}

static enum outcome transfer_immediate(struct step *s, unsigned word, unsigned size) {
    const uint32_t address = s->x->r[field(word, 3, 3)] + field(word, 6, 5) * size;
    return transfer(s, word & 7, address, size, field(word, 11, 1));
}

static enum outcome push(struct step *s, unsigned word) {
    const unsigned list = (word & 0xFF) | field(word, 8, 1) << LR;
    const uint32_t address = s->x->r[SP] - 4 * ones(list);
    const enum outcome outcome = list == 0 ? UNKNOWN : store_many(s, address, list);
    if (outcome == DONE) {
        s->x->r[SP] = address;
    }
    return outcome;
}

static enum outcome pop(struct step *s, unsigned word) {
    const unsigned list = (word & 0xFF) | field(word, 8, 1) << PC;
    const uint32_t address = s->x->r[SP];
    if (list == 0) {
        return UNKNOWN;
    }
    return load_many(s, address, list, SP, address + 4 * ones(list));
}

// STM, LDM; a loaded base is not written back.
static enum outcome transfer_many(struct step *s, unsigned word) {
    const unsigned base = field(word, 8, 3);
    const unsigned list = word & 0xFF;
    const uint32_t address = s->x->r[base];
    const uint32_t after = address + 4 * ones(list);
    if (list == 0) {
        return UNKNOWN;
    }
    if (field(word, 11, 1) != 0) {
        return load_many(s, address, list, base, after);
    }
    if (((list >> base) & 1) != 0) {
        return UNKNOWN;
    }
    const enum outcome outcome = store_many(s, address, list);
    if (outcome == DONE) {
        s->x->r[base] = after;
    }
    return outcome;
}

static enum outcome extend_16(struct step *s, unsigned word) {
    const uint32_t value = s->x->r[field(word, 3, 3)];
    uint32_t *to = &s->x->r[word & 7];
    switch (field(word, 6, 2)) {
    case 0:
        *to = extend(value, 16);
        break;
    case 1:
        *to = extend(value, 8);
        break;
    case 2:
        *to = value & 0xFFFF;
        break;
    default:
        *to = value & 0xFF;
        break;
    }
    return DONE;
}

static enum outcome reverse_16(struct step *s, unsigned word) {
    const uint32_t value = s->x->r[field(word, 3, 3)];
    uint32_t *to = &s->x->r[word & 7];
    switch (field(word, 6, 2)) {
    case 0:
        *to = __builtin_bswap32(value);
        return DONE;
    case 1:
        *to = reversed_halves(value);
        return DONE;
    case 3:
        *to = extend(reversed_halves(value), 16);
        return DONE;
    default:
        return UNKNOWN;
    }
}

static enum outcome hint(struct step *s, unsigned word) {
    if ((word & 0x0F) != 0) {
        s->x->it = (uint8_t)(word & 0xFF);
        return DONE;
    }
    return word == NOP ? DONE : word == WFI ? ASLEEP : UNKNOWN;
}

static enum outcome miscellaneous(struct step *s, unsigned word) {
    struct f405_registers *x = s->x;
    if ((word & 0xF500) == 0xB100) {  // CBZ, CBNZ
        const bool is_zero = x->r[word & 7] == 0;
        if (is_zero != (field(word, 11, 1) != 0)) {
            s->next = s->at + 4 + (field(word, 3, 5) << 1) + (field(word, 9, 1) << 6);
        }
        return DONE;
    }
    switch (field(word, 8, 4)) {
    case 0x0: {
        const uint32_t by = (word & 0x7F) * 4;
        x->r[SP] += field(word, 7, 1) != 0 ? -by : by;
        return DONE;
    }
    case 0x2:
        return extend_16(s, word);
    case 0x4:
    case 0x5:
        return push(s, word);
    case 0x6:
        return word == 0xB662 || word == 0xB672 ? mask(s, word == 0xB672) : UNKNOWN;
    case 0xA:
        return reverse_16(s, word);
    case 0xC:
    case 0xD:
        return pop(s, word);
    case 0xF:
        return hint(s, word);
    default:
        return UNKNOWN;
    }
}

static enum outcome branch_if(struct step *s, unsigned word) {
    const unsigned condition = field(word, 8, 4);
    if (condition >= 14) {
        return UNKNOWN;  // UDF, SVC
    }
    if (passes(s->x, condition)) {
        s->next = s->at + 4 + (extend(word, 8) << 1);
    }
    return DONE;
}

enum outcome thumb_do_16(struct step *s, unsigned word) {
    struct f405_registers *x = s->x;
    switch (word >> 11) {
    case 0x00:
    case 0x01:
    case 0x02:
        return shift_immediate(s, word);
    case 0x03:
        return add_subtract(s, word);
    case 0x04:
    case 0x05:
    case 0x06:
    case 0x07:
        return immediate_8(s, word);
    case 0x08:
        return field(word, 10, 1) != 0 ? special(s, word) : data_16(s, word);
    case 0x09:
        return transfer(s, field(word, 8, 3),
                        ((s->at + 4) & ~UINT32_C(3)) + (word & 0xFF) * 4, 4, IS_LOAD);
    case 0x0A:
    case 0x0B:
        return transfer_register(s, word);
    case 0x0C:
    case 0x0D:
        return transfer_immediate(s, word, 4);
    case 0x0E:
    case 0x0F:
        return transfer_immediate(s, word, 1);
    case 0x10:
    case 0x11:
        return transfer_immediate(s, word, 2);
    case 0x12:
    case 0x13:
        return transfer(s, field(word, 8, 3), x->r[SP] + (word & 0xFF) * 4, 4,
                        field(word, 11, 1));
    case 0x14:
        x->r[field(word, 8, 3)] = ((s->at + 4) & ~UINT32_C(3)) + (word & 0xFF) * 4;
        return DONE;
    case 0x15:
        x->r[field(word, 8, 3)] = x->r[SP] + (word & 0xFF) * 4;
        return DONE;
    case 0x16:
    case 0x17:
        return miscellaneous(s, word);
    case 0x18:
    case 0x19:
        return transfer_many(s, word);
    case 0x1A:
    case 0x1B:
        return branch_if(s, word);
    default:
        s->next = s->at + 4 + (extend(word, 11) << 1);
        return DONE;
    }
}
