// SPDX-License-Identifier: MIT
// The instructions of 32 bits that load and store, and moves of the FPU's registers
// (ARM, chapters A5.3 and A6); see thumb.c. `a` is the first half, `b` the second.
#include "thumb_step.h"

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

// VLDR, VSTR, VLDM, VSTM, VPUSH, VPOP of single and double registers, and VMOV between
// a core register and a single one, once the FPU is in use: the first use is left to
// libunicorn. A double is two singles, the lower half first.
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

enum outcome thumb_memory_32(struct step *s, unsigned a, unsigned b) {
    const unsigned operation = field(a, 4, 7);
    if (field(a, 11, 2) != 1) {
        return single_32(s, a, b);
    }
    if ((operation & 0x64) == 0x00) {
        return many_32(s, a, b);
    }
    return (operation & 0x64) == 0x04 ? two_32(s, a, b) : move_fpu(s, a, b);
}
