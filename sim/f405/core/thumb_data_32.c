// SPDX-License-Identifier: MIT
// The instructions of 32 bits that work on registers: arithmetic and logic, products,
// bit fields, branches, system registers (ARM, chapter A5.3); see thumb.c. `a` is the
// first half, `b` the second.
#include "thumb_step.h"

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

// Whether the operation exists, and without a result where the destination is PC.
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
        return UNKNOWN;  // SSAT16, USAT16
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

// SXTAH, UXTAH, SXTAB, UXTAB; without the first operand SXTH and its like.
static enum outcome extend_and_add(struct step *s, unsigned a, unsigned b) {
    struct f405_registers *x = s->x;
    const unsigned n = a & 15;
    const unsigned d = field(b, 8, 4);
    const uint32_t turned = rotate(x->r[b & 15], 8 * field(b, 4, 2));
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
        return extend_and_add(s, a, b);
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

// SDIV, UDIV. A division by zero, which may be set to trap, is left to libunicorn.
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

enum outcome thumb_data_32(struct step *s, unsigned a, unsigned b) {
    const unsigned operation = field(a, 4, 7);
    switch (field(a, 11, 2)) {
    case 1:
        return shifted_register(s, a, b);
    case 2:
        if ((b & 0x8000) != 0) {
            return branch_far(s, a, b);
        }
        return (operation & 0x20) == 0 ? modified_immediate(s, a, b)
                                       : plain_immediate(s, a, b);
    default:
        if ((operation & 0x70) == 0x20) {
            return register_32(s, a, b);
        }
        if ((operation & 0x78) == 0x30) {
            return multiply(s, a, b);
        }
        return (operation & 0x78) == 0x38 ? multiply_long(s, a, b) : UNKNOWN;
    }
}
