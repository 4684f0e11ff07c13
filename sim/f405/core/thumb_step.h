// SPDX-License-Identifier: MIT
// Shared by the files of thumb: an instruction under way, arithmetic with flags,
// shifts, loads and stores (ARM, chapters A5 to A7). Inline, because they are the
// emulator's innermost loop.
#ifndef SIM_F405_CORE_THUMB_STEP_H
#define SIM_F405_CORE_THUMB_STEP_H

#include <string.h>

#include "f405/f405.h"

// How an instruction ended. UNKNOWN: it has changed nothing and is left to libunicorn.
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
};

enum shift { LSL, LSR, ASR, ROR };

// An instruction under way. `at` is its address, `next` the address of the next one.
struct step {
    struct f405 *m;
    struct f405_registers *x;
    uint32_t at, next;
    bool sets;  // flags, in encodings that set them outside of IT blocks only
};

static inline uint32_t field(uint32_t word, unsigned from, unsigned bits) {
    return (word >> from) & ((UINT32_C(1) << bits) - 1);
}

// Set bits of 16. The compiler's builtin is a call where the processor has no
// instruction for it.
static inline unsigned ones(uint32_t bits) {
    bits -= bits >> 1 & 0x5555;
    bits = (bits & 0x3333) + (bits >> 2 & 0x3333);
    bits = (bits + (bits >> 4)) & 0x0F0F;
    return (bits + (bits >> 8)) & 0x1F;
}

static inline uint32_t extend(uint32_t value, unsigned bits) {
    const uint32_t sign = UINT32_C(1) << (bits - 1);
    return ((value & ((sign << 1) - 1)) ^ sign) - sign;
}

static inline uint32_t rotate(uint32_t value, unsigned by) {
    return by == 0 ? value : (value >> by) | (value << (32 - by));
}

static inline uint32_t reversed_halves(uint32_t value) {
    return (value >> 8 & 0x00FF00FF) | (value << 8 & 0xFF00FF00);
}

// PC as an operand is two instructions ahead.
static inline uint32_t get(const struct step *s, unsigned reg) {
    return reg == PC ? s->at + 4 : s->x->r[reg];
}

static inline void set(struct step *s, unsigned reg, uint32_t value) {
    s->x->r[reg] = reg == SP ? value & ~UINT32_C(3) : value;
}

static inline bool is_bad(unsigned reg) {
    return reg == SP || reg == PC;
}

static inline bool passes(const struct f405_registers *x, unsigned condition) {
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

static inline void set_nz(struct f405_registers *x, uint32_t result) {
    x->n = (result >> 31) != 0;
    x->z = result == 0;
}

static inline uint32_t add(struct f405_registers *x, uint32_t a, uint32_t b,
                           uint32_t carry, bool sets) {
    const uint64_t sum = (uint64_t)a + b + carry;
    const uint32_t result = (uint32_t)sum;
    if (sets) {
        set_nz(x, result);
        x->c = (sum >> 32) != 0;
        x->v = (((a ^ result) & (b ^ result)) >> 31) != 0;
    }
    return result;
}

// Shifts by 0 to 255; 0 leaves value and carry unchanged.
static inline uint32_t shift(uint32_t value, enum shift kind, unsigned by,
                             bool *carry) {
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

// Shifts by an amount encoded in an instruction: 0 means 32, and for ROR it means RRX
// (ARM, DecodeImmShift).
static inline uint32_t shift_by(uint32_t value, enum shift kind, unsigned by,
                                bool *carry) {
    if (by == 0 && kind == ROR) {
        const uint32_t top = *carry ? UINT32_C(1) << 31 : 0;
        *carry = (value & 1) != 0;
        return (value >> 1) | top;
    }
    return shift(value, kind, by == 0 && kind != LSL ? 32 : by, carry);
}

static inline uint32_t saturate(struct f405_registers *x, int64_t value, int64_t least,
                                int64_t most) {
    if (value < least || value > most) {
        x->rest |= SATURATED;
        value = value < least ? least : most;
    }
    return (uint32_t)value;
}

// Memory

// RAM first: most accesses go there.
static inline uint8_t *data_at(struct f405 *m, uint32_t address, unsigned size) {
    return address - F405_RAM <= F405_RAM_SIZE - size ? m->ram + (address - F405_RAM)
                                                      : f405_memory(m, address, size);
}

static inline bool load(const struct step *s, uint32_t address, unsigned size,
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

static inline bool store(const struct step *s, uint32_t address, unsigned size,
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

// Several words at once: in memory only, and aligned.
static inline uint8_t *words(const struct step *s, uint32_t address, unsigned count,
                             bool is_store) {
    if ((address & 3) != 0 || (is_store && f405_is_flash(address))) {
        return NULL;
    }
    return data_at(s->m, address, 4 * count);
}

// Branches

// A jump by BX or by a load into PC: leaves an exception, or stays in Thumb state.
static inline enum outcome jump(struct step *s, uint32_t target) {
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

static inline bool can_jump(const struct step *s, uint32_t target) {
    return (target & 1) != 0 ||
           (target >> 24 == EXC_RETURN && (s->x->rest & 0x1FF) != 0);
}

// Shared by both widths

enum { IS_LOAD = 1, IS_SIGNED = 2 };

static inline enum outcome transfer(struct step *s, unsigned reg, uint32_t address,
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

static inline enum outcome store_many(struct step *s, uint32_t address, unsigned list) {
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

// With PC among them it also jumps, after `base` has been written back.
static inline enum outcome load_many(struct step *s, uint32_t address, unsigned list,
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

// Writes PRIMASK. Where an exception waits for it to be cleared, the manual promises
// the exception no earlier than two instructions later (ARM, "MSR, CPS: visibility";
// PM, "ISB").
static inline enum outcome mask(struct step *s, bool is_masked) {
    if ((s->x->control & 1) != 0) {
        return UNKNOWN;  // not privileged
    }
    if (s->m->is_blocked) {
        s->m->attention = 2;
    }
    s->x->primask = is_masked;
    return DONE;
}

// By width and group; `a` is the first half of an instruction of 32 bits, `b` the
// second.
enum outcome thumb_do_16(struct step *s, unsigned word);
enum outcome thumb_data_32(struct step *s, unsigned a, unsigned b);
enum outcome thumb_memory_32(struct step *s, unsigned a, unsigned b);

#endif
