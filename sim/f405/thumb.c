// SPDX-License-Identifier: MIT
// The instructions that firmware is made of, run here: those of the integer core, moves
// of the FPU's registers, loads and stores that reach memory or a register of a
// peripheral. Whatever is rarer, or ends in a fault, is left as it was found, for
// libunicorn (ARM, chapters A5 to A7; names of the encodings as there).
#include <string.h>

#include "f405.h"

// How an instruction ended. UNKNOWN: it has not begun.
enum outcome {
    DONE = THUMB_STOPPED,
    UNKNOWN = THUMB_UNKNOWN,
    ASLEEP = THUMB_ASLEEP,
    RETURNS = THUMB_RETURNS,
};

enum {
    SP = 13,
    LR = 14,
    PC = 15,
    SATURATED = 1 << 27,  // Q
    EXC_RETURN = 0xFF,    // its top byte
    FPU_ACTIVE = 1 << 2,  // of CONTROL
    FPU_ACCESS = 0xF << 20,
    UNALIGNED_TRAP = 1 << 3,  // of CCR
    SYSM_IPSR = 5,
    SYSM_PRIMASK = 16,
    WFI = 0xBF30,
    NOP = 0xBF00,
};

enum shift { LSL, LSR, ASR, ROR };

// An instruction under way. `at` is its address; `next` where it leads.
struct step {
    struct f405 *m;
    struct f405_registers *x;
    uint32_t at, next;
    bool sets;  // flags, where the encoding leaves that to the IT block
};

static uint32_t field(uint32_t word, unsigned from, unsigned bits) {
    return (word >> from) & ((UINT32_C(1) << bits) - 1);
}

// The compiler's own is a call where the processor has no instruction for it.
static unsigned ones(uint32_t bits) {
    bits -= bits >> 1 & 0x5555;
    bits = (bits & 0x3333) + (bits >> 2 & 0x3333);
    bits = (bits + (bits >> 4)) & 0x0F0F;
    return (bits + (bits >> 8)) & 0x1F;
}

static uint32_t extend(uint32_t value, unsigned bits) {
    const uint32_t sign = UINT32_C(1) << (bits - 1);
    return ((value & ((sign << 1) - 1)) ^ sign) - sign;
}

static uint32_t rotate(uint32_t value, unsigned by) {
    return by == 0 ? value : (value >> by) | (value << (32 - by));
}

// PC as an operand is two instructions ahead.
static uint32_t get(const struct step *s, unsigned reg) {
    return reg == PC ? s->at + 4 : s->x->r[reg];
}

static void set(struct step *s, unsigned reg, uint32_t value) {
    s->x->r[reg] = reg == SP ? value & ~UINT32_C(3) : value;
}

static bool is_bad(unsigned reg) {
    return reg == SP || reg == PC;
}

static bool passes(const struct f405_registers *x, unsigned condition) {
    bool is_true = true;
    switch (condition >> 1) {
    case 0:
        is_true = x->z;
        break;
    case 1:
        is_true = x->c;
        break;
    case 2:
        is_true = x->n;
        break;
    case 3:
        is_true = x->v;
        break;
    case 4:
        is_true = x->c && !x->z;
        break;
    case 5:
        is_true = x->n == x->v;
        break;
    case 6:
        is_true = !x->z && x->n == x->v;
        break;
    default:
        return true;
    }
    return is_true != (condition & 1);
}

// Arithmetic

static void set_nz(struct f405_registers *x, uint32_t result) {
    x->n = (result >> 31) != 0;
    x->z = result == 0;
}

static uint32_t add(struct f405_registers *x, uint32_t a, uint32_t b, uint32_t carry,
                    bool sets) {
    const uint64_t sum = (uint64_t)a + b + carry;
    const uint32_t result = (uint32_t)sum;
    if (sets) {
        set_nz(x, result);
        x->c = (sum >> 32) != 0;
        x->v = (((a ^ result) & (b ^ result)) >> 31) != 0;
    }
    return result;
}

// By 0 to 255; 0 leaves value and carry.
static uint32_t shift(uint32_t value, enum shift kind, unsigned by, bool *carry) {
    if (by == 0) {
        return value;
    }
    const uint32_t sign = (value >> 31) != 0 ? UINT32_MAX : 0;
    switch (kind) {
    case LSL:
        *carry = by <= 32 && ((value >> (32 - by)) & 1) != 0;
        return by < 32 ? value << by : 0;
    case LSR:
        *carry = by <= 32 && ((value >> (by - 1)) & 1) != 0;
        return by < 32 ? value >> by : 0;
    case ASR:
        *carry = by < 32 ? ((value >> (by - 1)) & 1) != 0 : sign != 0;
        return by < 32 ? (value >> by) | (sign << (32 - by)) : sign;
    default:
        value = rotate(value, by % 32);
        *carry = (value >> 31) != 0;
        return value;
    }
}

// An amount in an instruction: 0 stands for 32, and of ROR for RRX (ARM,
// DecodeImmShift).
static uint32_t shift_by(uint32_t value, enum shift kind, unsigned by, bool *carry) {
    if (by == 0 && kind == ROR) {
        const uint32_t top = *carry ? UINT32_C(1) << 31 : 0;
        *carry = (value & 1) != 0;
        return (value >> 1) | top;
    }
    return shift(value, kind, by == 0 && kind != LSL ? 32 : by, carry);
}

static uint32_t saturate(struct f405_registers *x, int64_t value, int64_t least,
                         int64_t most) {
    if (value < least || value > most) {
        x->rest |= SATURATED;
        value = value < least ? least : most;
    }
    return (uint32_t)value;
}

// Memory

// RAM first, where most is.
static uint8_t *data_at(struct f405 *m, uint32_t address, unsigned size) {
    return address - F405_RAM <= F405_RAM_SIZE - size ? m->ram + (address - F405_RAM)
                                                      : f405_memory(m, address, size);
}

static bool load(const struct step *s, uint32_t address, unsigned size,
                 uint32_t *value) {
    struct f405 *m = s->m;
    const uint8_t *memory = data_at(m, address, size);
    if (memory != NULL) {
        *value = 0;
        memcpy(value, memory, size);
        return true;
    }
    return (address & (size - 1)) == 0 && f405_bus_read(m, address, size, value);
}

static bool store(const struct step *s, uint32_t address, unsigned size,
                  uint32_t value) {
    struct f405 *m = s->m;
    uint8_t *memory = data_at(m, address, size);
    if (memory != NULL) {
        if (f405_is_flash(address)) {
            return false;
        }
        memcpy(memory, &value, size);
        return true;
    }
    return (address & (size - 1)) == 0 && f405_bus_write(m, address, size, value);
}

// Several words at once: memory alone, and aligned.
static uint8_t *words(const struct step *s, uint32_t address, unsigned count,
                      bool is_store) {
    if ((address & 3) != 0 || (is_store && f405_is_flash(address))) {
        return NULL;
    }
    return data_at(s->m, address, 4 * count);
}

// Branches

// By BX, or by a load into PC: leaves an exception, or stays in Thumb state.
static enum outcome jump(struct step *s, uint32_t target) {
    if (target >> 24 == EXC_RETURN && (s->x->rest & 0x1FF) != 0) {
        s->next = target & ~UINT32_C(1);
        return RETURNS;
    }
    if ((target & 1) == 0) {
        return UNKNOWN;
    }
    s->next = target & ~UINT32_C(1);
    return DONE;
}

static bool can_jump(const struct step *s, uint32_t target) {
    return (target & 1) != 0 ||
           (target >> 24 == EXC_RETURN && (s->x->rest & 0x1FF) != 0);
}

// Shared by both widths

enum { IS_LOAD = 1, IS_SIGNED = 2 };

static enum outcome transfer(struct step *s, unsigned reg, uint32_t address,
                             unsigned size, unsigned how) {
    uint32_t value = 0;
    if ((address & (size - 1)) != 0 && (s->m->core.ccr & UNALIGNED_TRAP) != 0) {
        return UNKNOWN;
    }
    if ((how & IS_LOAD) == 0) {
        return store(s, address, size, s->x->r[reg]) ? DONE : UNKNOWN;
    }
    if (!load(s, address, size, &value)) {
        return UNKNOWN;
    }
    if ((how & IS_SIGNED) != 0) {
        value = extend(value, 8 * size);
    }
    set(s, reg, value);
    return DONE;
}

static enum outcome store_many(struct step *s, uint32_t address, unsigned list) {
    const unsigned count = ones(list);
    uint8_t *memory = words(s, address, count, true);
    if (memory == NULL) {
        return UNKNOWN;
    }
    for (; list != 0; list &= list - 1) {
        memcpy(memory, &s->x->r[__builtin_ctz(list)], 4);
        memory += 4;
    }
    return DONE;
}

// With PC among them it also jumps, once `base` is what it becomes.
static enum outcome load_many(struct step *s, uint32_t address, unsigned list,
                              unsigned base, uint32_t base_after) {
    const unsigned count = ones(list);
    const uint8_t *memory = words(s, address, count, false);
    uint32_t target = 1;
    if (memory == NULL) {
        return UNKNOWN;
    }
    if ((list >> PC) != 0) {
        memcpy(&target, memory + (size_t)4 * (count - 1), 4);
        if (!can_jump(s, target)) {
            return UNKNOWN;
        }
    }
    set(s, base, base_after);
    for (unsigned left = list & 0x7FFF; left != 0; left &= left - 1) {
        uint32_t value = 0;
        memcpy(&value, memory, 4);
        set(s, (unsigned)__builtin_ctz(left), value);
        memory += 4;
    }
    return (list >> PC) != 0 ? jump(s, target) : DONE;
}

// 16 bits

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

// Any register; and BX, BLX.
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

static uint32_t reversed_halves(uint32_t value) {
    return (value >> 8 & 0x00FF00FF) | (value << 8 & 0xFF00FF00);
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

// A mask that falls where an exception waits: the manual promises no earlier than two
// instructions on (ARM, "MSR, CPS: visibility"; PM, "ISB").
static enum outcome mask(struct step *s, bool is_masked) {
    if ((s->x->control & 1) != 0) {
        return UNKNOWN;  // not privileged
    }
    if (s->m->is_blocked) {
        s->m->attention = 2;
    }
    s->x->primask = is_masked;
    return DONE;
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

static enum outcome do_16(struct step *s, unsigned word) {
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

// 32 bits: a is the first half, b the second.

// AND, BIC, ORR, ORN, EOR, ADD, ADC, SBC, SUB, RSB and what they are without a result
// (TST, TEQ, CMN, CMP) or without a first operand (MOV, MVN).
static enum outcome operate(struct step *s, unsigned a, unsigned b, uint32_t value,
                            bool carry) {
    struct f405_registers *x = s->x;
    const unsigned operation = field(a, 5, 4);
    const bool sets = field(a, 4, 1) != 0;
    const unsigned n = a & 15;
    const unsigned d = field(b, 8, 4);
    const bool is_sum = operation >= 8;
    const bool has_result = d != PC || !sets;
    const bool is_stack = n == SP && (operation == 8 || operation == 13);
    if ((d == SP && !is_stack) || (d == PC && !sets) || (n == SP && !is_stack) ||
        (n == PC && operation != 2 && operation != 3)) {
        return UNKNOWN;
    }
    const uint32_t first = n == PC ? 0 : x->r[n];
    uint32_t result = 0;
    switch (operation) {
    case 0:
        result = first & value;
        break;
    case 1:
        result = first & ~value;
        break;
    case 2:
        result = first | value;
        break;
    case 3:
        result = n == PC ? ~value : first | ~value;
        break;
    case 4:
        result = first ^ value;
        break;
    case 8:
        result = add(x, first, value, 0, sets);
        break;
    case 10:
        result = add(x, first, value, x->c, sets);
        break;
    case 11:
        result = add(x, first, ~value, x->c, sets);
        break;
    case 13:
        result = add(x, first, ~value, 1, sets);
        break;
    case 14:
        result = add(x, ~first, value, 1, sets);
        break;
    default:
        return UNKNOWN;
    }
    if (!is_sum && sets) {
        set_nz(x, result);
        x->c = carry;
    }
    if (has_result) {
        set(s, d, result);
    }
    return DONE;
}

// Whether there is one, and its result may be missing.
static bool is_operation(unsigned a, unsigned b) {
    const unsigned known = 0x6D1F;
    const unsigned operation = field(a, 5, 4);
    const bool can_lack =
        operation == 0 || operation == 4 || operation == 8 || operation == 13;
    return ((known >> operation) & 1) != 0 && (field(b, 8, 4) != PC || can_lack);
}

static enum outcome shifted_register(struct step *s, unsigned a, unsigned b) {
    bool carry = s->x->c;
    if (!is_operation(a, b) || is_bad(b & 15) || field(b, 15, 1) != 0) {
        return UNKNOWN;
    }
    const unsigned by = field(b, 12, 3) << 2 | field(b, 6, 2);
    const uint32_t value = shift_by(s->x->r[b & 15], field(b, 4, 2), by, &carry);
    return operate(s, a, b, value, carry);
}

static unsigned immediate_12(unsigned a, unsigned b) {
    return field(a, 10, 1) << 11 | field(b, 12, 3) << 8 | (b & 0xFF);
}

// ARM, ThumbExpandImm_C.
static enum outcome modified_immediate(struct step *s, unsigned a, unsigned b) {
    const unsigned coded = immediate_12(a, b);
    const uint32_t byte = coded & 0xFF;
    bool carry = s->x->c;
    uint32_t value = byte;
    if (!is_operation(a, b)) {
        return UNKNOWN;
    }
    if (coded >> 10 != 0) {
        value = rotate(0x80 | (coded & 0x7F), coded >> 7);
        carry = (value >> 31) != 0;
    } else if (coded >> 8 == 1) {
        value = byte << 16 | byte;
    } else if (coded >> 8 == 2) {
        value = byte << 24 | byte << 8;
    } else if (coded >> 8 == 3) {
        value = byte * UINT32_C(0x01010101);
    }
    return operate(s, a, b, value, carry);
}

static enum outcome bit_field(struct step *s, unsigned operation, unsigned n,
                              unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned d = field(b, 8, 4);
    const unsigned from = field(b, 12, 3) << 2 | field(b, 6, 2);
    const unsigned last = b & 31;
    const bool is_insert = operation == 0x16;
    const unsigned width = is_insert ? last + 1 - from : last + 1;
    if (n == SP || (n == PC && !is_insert) || (b & 0x8020) != 0 ||
        (is_insert ? last < from : from + width > 32)) {
        return UNKNOWN;
    }
    const uint32_t ones = width == 32 ? UINT32_MAX : (UINT32_C(1) << width) - 1;
    if (is_insert) {  // BFI; BFC
        const uint32_t value = n == PC ? 0 : x->r[n];
        x->r[d] = (x->r[d] & ~(ones << from)) | (value & ones) << from;
    } else {  // UBFX, SBFX
        const uint32_t value = x->r[n] >> from & ones;
        x->r[d] = operation == 0x1C ? value : extend(value, width);
    }
    return DONE;
}

static enum outcome saturate_to(struct step *s, unsigned operation, unsigned n,
                                unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned by = field(b, 12, 3) << 2 | field(b, 6, 2);
    const bool is_right = (operation & 2) != 0;
    const unsigned to = b & 31;
    bool carry = false;
    if (is_bad(n) || (is_right && by == 0) || (b & 0x8020) != 0) {
        return UNKNOWN;  // of both halves
    }
    const int32_t value = (int32_t)shift(x->r[n], is_right ? ASR : LSL, by, &carry);
    const int64_t one = 1;
    x->r[field(b, 8, 4)] = (operation & 8) != 0
                               ? saturate(x, value, 0, (one << to) - 1)
                               : saturate(x, value, -(one << to), (one << to) - 1);
    return DONE;
}

static enum outcome plain_immediate(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned operation = field(a, 4, 5);
    const unsigned n = a & 15;
    const unsigned d = field(b, 8, 4);
    const uint32_t low = immediate_12(a, b);
    const uint32_t base = n == PC ? (s->at + 4) & ~UINT32_C(3) : x->r[n & 15];
    if (d == PC || (d == SP && (n != SP || (operation != 0 && operation != 10)))) {
        return UNKNOWN;
    }
    switch (operation) {
    case 0x00:
        set(s, d, base + low);
        return DONE;
    case 0x0A:
        set(s, d, base - low);
        return DONE;
    case 0x04:  // MOVW
        x->r[d] = (uint32_t)n << 12 | low;
        return DONE;
    case 0x0C:  // MOVT
        x->r[d] = (x->r[d] & 0xFFFF) | ((uint32_t)n << 12 | low) << 16;
        return DONE;
    case 0x10:
    case 0x12:
    case 0x18:
    case 0x1A:
        return saturate_to(s, operation, n, b);
    case 0x14:
    case 0x16:
    case 0x1C:
        return bit_field(s, operation, n, b);
    default:
        return UNKNOWN;
    }
}

static enum outcome system_register(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned d = field(b, 8, 4);
    if ((a & 0xFFE0) == 0xF380 && a != 0xF38F && b == (0x8800 | SYSM_PRIMASK) &&
        !is_bad(a & 15)) {
        return mask(s, (x->r[a & 15] & 1) != 0);
    }
    if (a == 0xF3EF && (b & 0xF000) == 0x8000 && !is_bad(d)) {
        if ((b & 0xFF) == SYSM_PRIMASK && (x->control & 1) == 0) {
            x->r[d] = x->primask;
            return DONE;
        }
        if ((b & 0xFF) == SYSM_IPSR) {
            x->r[d] = x->rest & 0x1FF;
            return DONE;
        }
    }
    const bool is_barrier = a == 0xF3BF && (b & 0xFF00) == 0x8F00 &&
                            (b & 0xF0) >= 0x40 && (b & 0xF0) <= 0x60;
    const bool is_nop = a == 0xF3AF && b == 0x8000;
    return is_barrier || is_nop ? DONE : UNKNOWN;
}

// ARM, B.W and BL: the two J bits count as their opposite where S is set.
static uint32_t far_offset(unsigned a, unsigned b) {
    const uint32_t s = field(a, 10, 1);
    const uint32_t i1 = (field(b, 13, 1) ^ s) ^ 1;
    const uint32_t i2 = (field(b, 11, 1) ^ s) ^ 1;
    return extend(s << 24 | i1 << 23 | i2 << 22 | (a & 0x3FF) << 12 | (b & 0x7FF) << 1,
                  25);
}

static enum outcome branch_far(struct step *s, unsigned a, unsigned b) {
    switch (b & 0xD000) {
    case 0x8000: {
        const unsigned condition = field(a, 6, 4);
        if (condition >= 14) {
            return system_register(s, a, b);
        }
        if (passes(s->x, condition)) {
            s->next =
                s->at + 4 +
                extend(field(a, 10, 1) << 20 | field(b, 11, 1) << 19 |
                           field(b, 13, 1) << 18 | (a & 0x3F) << 12 | (b & 0x7FF) << 1,
                       21);
        }
        return DONE;
    }
    case 0x9000:
        s->next = s->at + 4 + far_offset(a, b);
        return DONE;
    case 0xD000:
        s->x->r[LR] = (s->at + 4) | 1;
        s->next = s->at + 4 + far_offset(a, b);
        return DONE;
    default:
        return UNKNOWN;
    }
}

// Bits of the first half of what moves words: P before or after, U up, W write back.
enum { BACK = 1 << 5, UP = 1 << 7, BEFORE = 1 << 8 };

static enum outcome many_32(struct step *s, unsigned a, unsigned b) {
    const unsigned base = a & 15;
    const unsigned list = b;
    const unsigned count = ones(list);
    const bool is_load = field(a, 4, 1) != 0;
    const bool is_down = (a & BEFORE) != 0;
    const bool goes_back = (a & BACK) != 0;
    if (is_down == ((a & UP) != 0) || base == PC || count < 2 ||
        ((list >> SP) & 1) != 0 || (!is_load && (list >> PC) != 0) ||
        (goes_back && ((list >> base) & 1) != 0) || (list >> LR) == 3) {
        return UNKNOWN;
    }
    const uint32_t value = s->x->r[base];
    const uint32_t far = is_down ? value - 4 * count : value + 4 * count;
    const uint32_t address = is_down ? far : value;
    if (is_load) {
        return load_many(s, address, list, base, goes_back ? far : value);
    }
    const enum outcome outcome = store_many(s, address, list);
    if (outcome == DONE && goes_back) {
        set(s, base, far);
    }
    return outcome;
}

// TBB, TBH.
static enum outcome table_branch(struct step *s, unsigned a, unsigned b) {
    const unsigned n = a & 15;
    uint32_t value = 0;
    if ((a & 0xFFF0) != 0xE8D0 || (b & 0xFFE0) != 0xF000 || n == SP || is_bad(b & 15)) {
        return UNKNOWN;
    }
    const bool is_half = field(b, 4, 1) != 0;
    const uint32_t index = s->x->r[b & 15];
    const uint32_t address = get(s, n) + (is_half ? index << 1 : index);
    if (f405_memory(s->m, address, 2) == NULL ||
        !load(s, address, is_half ? 2 : 1, &value)) {
        return UNKNOWN;
    }
    s->next = s->at + 4 + 2 * value;
    return DONE;
}

// LDRD, STRD.
static enum outcome two_32(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned n = a & 15;
    const unsigned first = field(b, 12, 4);
    const unsigned second = field(b, 8, 4);
    const bool is_load = field(a, 4, 1) != 0;
    const bool goes_back = (a & BACK) != 0;
    if ((a & (BEFORE | BACK)) == 0) {
        return table_branch(s, a, b);
    }
    if (is_bad(first) || is_bad(second) || (is_load && first == second) ||
        (goes_back && (n == PC || n == first || n == second)) ||
        (n == PC && !is_load)) {
        return UNKNOWN;
    }
    const uint32_t base = n == PC ? (s->at + 4) & ~UINT32_C(3) : x->r[n];
    const uint32_t offset = (b & 0xFF) * 4;
    const uint32_t far = (a & UP) != 0 ? base + offset : base - offset;
    const uint32_t address = (a & BEFORE) != 0 ? far : base;
    uint8_t *memory = words(s, address, 2, !is_load);
    if (memory == NULL) {
        return UNKNOWN;
    }
    if (is_load) {
        memcpy(&x->r[first], memory, 4);
        memcpy(&x->r[second], memory + 4, 4);
    } else {
        memcpy(memory, &x->r[first], 4);
        memcpy(memory + 4, &x->r[second], 4);
    }
    if (goes_back) {
        set(s, n, far);
    }
    return DONE;
}

// LDR into PC.
static enum outcome load_pc(struct step *s, uint32_t address) {
    const uint8_t *memory = words(s, address, 1, false);
    uint32_t target = 0;
    if (memory == NULL) {
        return UNKNOWN;
    }
    memcpy(&target, memory, 4);
    return jump(s, target);
}

// One byte, half or word; the base is written back once it is done.
static enum outcome single_32(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned n = a & 15;
    const unsigned t = field(b, 12, 4);
    const unsigned size = 1U << field(a, 5, 2);
    const unsigned how = field(a, 4, 1) | field(a, 8, 1) << 1;
    if (size == 8 || (how & (IS_LOAD | IS_SIGNED)) == IS_SIGNED ||
        (size == 4 && (how & IS_SIGNED) != 0) || (n == PC && (how & IS_LOAD) == 0) ||
        (t == SP && size != 4) || (t == PC && (size != 4 || (how & IS_LOAD) == 0))) {
        return UNKNOWN;
    }
    uint32_t address = n == PC ? (s->at + 4) & ~UINT32_C(3) : x->r[n];
    uint32_t after = address;
    if (n == PC) {
        const uint32_t offset = b & 0xFFF;
        address += field(a, 7, 1) != 0 ? offset : -offset;
    } else if (field(a, 7, 1) != 0) {
        address += b & 0xFFF;
    } else if (field(b, 11, 1) == 0) {
        if (field(b, 6, 5) != 0 || is_bad(b & 15)) {
            return UNKNOWN;
        }
        address += x->r[b & 15] << field(b, 4, 2);
    } else {
        const unsigned mode = field(b, 8, 3);  // P, U, W
        const uint32_t offset = b & 0xFF;
        const uint32_t far = (mode & 2) != 0 ? address + offset : address - offset;
        const bool goes_back = (mode & 1) != 0;
        if (mode == 0 || mode == 2 || mode == 6 || (goes_back && n == t)) {
            return UNKNOWN;
        }
        after = goes_back ? far : address;
        address = (mode & 4) != 0 ? far : address;
    }
    const enum outcome outcome =
        t == PC ? load_pc(s, address) : transfer(s, t, address, size, how);
    if (outcome != UNKNOWN && n != PC && after != x->r[n] && t != n) {
        set(s, n, after);
    }
    return outcome;
}

// Shifts by a register, SXTAH and its like, CLZ, RBIT, REV.
static enum outcome register_32(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned n = a & 15;
    const unsigned d = field(b, 8, 4);
    const unsigned last = b & 15;
    if ((b & 0xF000) != 0xF000 || is_bad(d) || is_bad(last) || n == SP) {
        return UNKNOWN;
    }
    const uint32_t value = x->r[last];
    if ((a & 0x80) == 0 && (b & 0xF0) == 0) {
        bool carry = x->c;
        if (n == PC) {
            return UNKNOWN;
        }
        const uint32_t result = shift(x->r[n], field(a, 5, 2), value & 0xFF, &carry);
        if (field(a, 4, 1) != 0) {
            set_nz(x, result);
            x->c = carry;
        }
        x->r[d] = result;
        return DONE;
    }
    if ((a & 0x80) == 0 && (b & 0xC0) == 0x80) {
        const uint32_t turned = rotate(value, 8 * field(b, 4, 2));
        const uint32_t base = n == PC ? 0 : x->r[n];
        switch (field(a, 4, 3)) {
        case 0:
            x->r[d] = base + extend(turned, 16);
            return DONE;
        case 1:
            x->r[d] = base + (turned & 0xFFFF);
            return DONE;
        case 4:
            x->r[d] = base + extend(turned, 8);
            return DONE;
        case 5:
            x->r[d] = base + (turned & 0xFF);
            return DONE;
        default:
            return UNKNOWN;
        }
    }
    if (n != last) {
        return UNKNOWN;
    }
    switch ((a & 0xF0) << 4 | (b & 0xF0)) {
    case 0x980:
        x->r[d] = __builtin_bswap32(value);
        return DONE;
    case 0x990:
        x->r[d] = reversed_halves(value);
        return DONE;
    case 0x9B0:
        x->r[d] = extend(reversed_halves(value), 16);
        return DONE;
    case 0xB80:
        x->r[d] = value == 0 ? 32 : (uint32_t)__builtin_clz(value);
        return DONE;
    default:
        return UNKNOWN;
    }
}

static int32_t half(uint32_t value, unsigned is_top) {
    return (int16_t)(is_top != 0 ? value >> 16 : value);
}

static enum outcome multiply(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned n = a & 15;
    const unsigned added = field(b, 12, 4);
    const unsigned d = field(b, 8, 4);
    const unsigned last = b & 15;
    if (is_bad(n) || is_bad(d) || is_bad(last) || added == SP) {
        return UNKNOWN;
    }
    const uint32_t base = added == PC ? 0 : x->r[added];
    switch ((a & 0xF0) | field(b, 4, 4)) {
    case 0x00:
        x->r[d] = base + x->r[n] * x->r[last];
        return DONE;
    case 0x01:
        if (added == PC) {
            return UNKNOWN;
        }
        x->r[d] = base - x->r[n] * x->r[last];
        return DONE;
    case 0x10:  // SMLABB to SMLATT
    case 0x11:
    case 0x12:
    case 0x13: {
        const int32_t product =
            half(x->r[n], field(b, 5, 1)) * half(x->r[last], field(b, 4, 1));
        const int64_t sum = (int64_t)product + (int32_t)base;
        x->rest |= sum == (int32_t)sum ? 0 : SATURATED;
        x->r[d] = (uint32_t)sum;
        return DONE;
    }
    default:
        return UNKNOWN;
    }
}

// A trap that the division by zero may be set to is libunicorn's.
static enum outcome divide(struct step *s, unsigned n, unsigned d, unsigned last,
                           bool is_signed) {
    struct f405_registers *x = s->x;
    const uint32_t above = x->r[n];
    const uint32_t below = x->r[last];
    if (below == 0) {
        return UNKNOWN;
    }
    x->r[d] = is_signed ? (uint32_t)((int64_t)(int32_t)above / (int32_t)below)
                        : above / below;
    return DONE;
}

static enum outcome multiply_long(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned n = a & 15;
    const unsigned low = field(b, 12, 4);
    const unsigned high = field(b, 8, 4);
    const unsigned last = b & 15;
    if (is_bad(n) || is_bad(high) || is_bad(last)) {
        return UNKNOWN;
    }
    const unsigned kind = (a & 0x70) | field(b, 4, 4);
    if (kind == 0x1F || kind == 0x3F) {
        return low == PC ? divide(s, n, high, last, kind == 0x1F) : UNKNOWN;
    }
    if (is_bad(low) || low == high) {
        return UNKNOWN;
    }
    const uint64_t signed_product =
        (uint64_t)((int64_t)(int32_t)x->r[n] * (int32_t)x->r[last]);
    const uint64_t product = (uint64_t)x->r[n] * x->r[last];
    const uint64_t base = (uint64_t)x->r[high] << 32 | x->r[low];
    uint64_t result = 0;
    switch (kind) {
    case 0x00:
        result = signed_product;
        break;
    case 0x20:
        result = product;
        break;
    case 0x40:
        result = base + signed_product;
        break;
    case 0x60:
        result = base + product;
        break;
    case 0x66:  // UMAAL
        result = product + x->r[low] + x->r[high];
        break;
    default:
        return UNKNOWN;
    }
    x->r[low] = (uint32_t)result;
    x->r[high] = (uint32_t)(result >> 32);
    return DONE;
}

// VLDR, VSTR, VLDM, VSTM, VPUSH, VPOP of single and double registers, and VMOV between
// the core's and one of them, where the FPU is in use: else it has to be taken into use
// first. A double is two singles, the lower half first.
static enum outcome move_fpu(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const bool is_double = (b & 0x0F00) == 0x0B00;
    const unsigned n = a & 15;
    if ((s->m->core.cpacr & FPU_ACCESS) != FPU_ACCESS ||
        (x->control & FPU_ACTIVE) == 0 || ((b & 0x0E00) != 0x0A00)) {
        return UNKNOWN;
    }
    if ((a & 0xFFE0) == 0xEE00 && (b & 0x0F7F) == 0x0A10) {  // VMOV
        const unsigned reg = n << 1 | field(b, 7, 1);
        const unsigned t = field(b, 12, 4);
        if (is_bad(t)) {
            return UNKNOWN;
        }
        if ((a & 0x10) != 0) {
            x->r[t] = x->s[reg];
        } else {
            x->s[reg] = x->r[t];
        }
        return DONE;
    }
    if ((a & 0xFE00) != 0xEC00) {
        return UNKNOWN;
    }
    const bool is_single = (a & (BEFORE | BACK)) == BEFORE;  // VLDR, VSTR
    const bool is_down = (a & UP) == 0;
    const bool goes_back = (a & BACK) != 0;
    const bool is_load = (a & 0x10) != 0;
    const unsigned top = field(a, 6, 1);
    const unsigned first =
        is_double ? (top << 4 | field(b, 12, 4)) * 2 : field(b, 12, 4) << 1 | top;
    const unsigned count = is_single ? 1U + is_double : b & 0xFF;
    if ((!is_single && ((a & BEFORE) != 0) != is_down) ||
        (!is_single && !goes_back && is_down) || count == 0 || first + count > 32 ||
        (is_double && !is_single && (count & 1) != 0) ||
        (n == PC && (!is_single || !is_load))) {
        return UNKNOWN;
    }
    const uint32_t base = n == PC ? (s->at + 4) & ~UINT32_C(3) : x->r[n];
    const uint32_t offset = (b & 0xFF) * 4;
    const uint32_t far = is_down ? base - offset : base + offset;
    const uint32_t address = is_single || is_down ? far : base;
    uint8_t *memory = words(s, address, count, !is_load);
    if (memory == NULL) {
        return UNKNOWN;
    }
    if (is_load) {
        memcpy(&x->s[first], memory, (size_t)4 * count);
    } else {
        memcpy(memory, &x->s[first], (size_t)4 * count);
    }
    if (goes_back) {
        set(s, n, far);
    }
    return DONE;
}

static enum outcome do_32(struct step *s, unsigned a, unsigned b) {
    const unsigned operation = field(a, 4, 7);
    switch (field(a, 11, 2)) {
    case 1:
        if ((operation & 0x64) == 0x00) {
            return many_32(s, a, b);
        }
        if ((operation & 0x64) == 0x04) {
            return two_32(s, a, b);
        }
        return (operation & 0x60) == 0x20 ? shifted_register(s, a, b)
                                          : move_fpu(s, a, b);
    case 2:
        if ((b & 0x8000) != 0) {
            return branch_far(s, a, b);
        }
        return (operation & 0x20) == 0 ? modified_immediate(s, a, b)
                                       : plain_immediate(s, a, b);
    default:
        if ((operation & 0x60) == 0x00) {
            return single_32(s, a, b);
        }
        if ((operation & 0x70) == 0x20) {
            return register_32(s, a, b);
        }
        if ((operation & 0x78) == 0x30) {
            return multiply(s, a, b);
        }
        return (operation & 0x78) == 0x38 ? multiply_long(s, a, b) : UNKNOWN;
    }
}

// A block of conditional instructions (ARM, ITSTATE).
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

// Flash first. The CCM can't be executed.
static const uint8_t *code_at(struct f405 *m, uint32_t pc) {
    if (pc - F405_FLASH <= F405_FLASH_SIZE - 4) {
        return m->flash + (pc - F405_FLASH);
    }
    return pc - F405_CCM < F405_CCM_SIZE ? NULL : f405_memory(m, pc, 4);
}

enum thumb thumb_run(struct f405 *m) {
    struct f405_registers *x = &m->registers;
    for (;;) {
        if (x->it == 0 && is_due(m)) {  // an IT block is never broken off
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
                return THUMB_UNKNOWN;  // BKPT asks for no condition
            }
            x->it = thumb_advance(it);
            if (!passes(x, it >> 4)) {
                m->pc = s.next;  // no cycle: as libunicorn counts
                continue;
            }
        }
        m->cycle++;  // what it reads of a clock is of its end
        const enum outcome outcome = length == 4 ? do_32(&s, a, b) : do_16(&s, a);
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
