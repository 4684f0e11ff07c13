// SPDX-License-Identifier: MIT
// The registers of the virtual Cortex-M4 and their exchange with libunicorn; see
// registers.h.
#include "f405/f405.h"

enum { XPSR_IT = 0x0600FC00 };

static uint32_t xpsr_of(const struct f405_registers *x) {
    return x->rest | (uint32_t)x->n << 31 | (uint32_t)x->z << 30 |
           (uint32_t)x->c << 29 | (uint32_t)x->v << 28 | (x->it & 3U) << 25 |
           (x->it >> 2U) << 10;
}

static void set_xpsr(struct f405_registers *x, uint32_t value) {
    x->n = (value >> 31 & 1) != 0;
    x->z = (value >> 30 & 1) != 0;
    x->c = (value >> 29 & 1) != 0;
    x->v = (value >> 28 & 1) != 0;
    x->it = (uint8_t)((value >> 25 & 3) | (value >> 10 & 0x3F) << 2);
    x->rest = value & 0x0FFFFFFF & ~(uint32_t)XPSR_IT;
}

// Null: XPSR, or none.
static uint32_t *place_of(struct f405_registers *x, int reg) {
    if (reg >= UC_ARM_REG_R0 && reg <= UC_ARM_REG_R12) {
        return &x->r[reg - UC_ARM_REG_R0];
    }
    if (reg >= UC_ARM_REG_S0 && reg <= UC_ARM_REG_S31) {
        return &x->s[reg - UC_ARM_REG_S0];
    }
    switch (reg) {
    case UC_ARM_REG_SP:
        return &x->r[13];
    case UC_ARM_REG_LR:
        return &x->r[14];
    case UC_ARM_REG_PRIMASK:
        return &x->primask;
    case UC_ARM_REG_FAULTMASK:
        return &x->faultmask;
    case UC_ARM_REG_BASEPRI:
        return &x->basepri;
    case UC_ARM_REG_CONTROL:
        return &x->control;
    case UC_ARM_REG_FPSCR:
        return &x->fpscr;
    default:
        return NULL;
    }
}

static uint32_t ask(const struct f405 *m, int reg) {
    uint32_t value = 0;
    (void)uc_reg_read(m->uc, reg, &value);
    return value;
}

uint32_t f405_get(const struct f405 *m, int reg) {
    if (m->is_lent) {
        return ask(m, reg);
    }
    struct f405_registers *x = (struct f405_registers *)&m->registers;
    if (reg == UC_ARM_REG_XPSR) {
        return xpsr_of(x);
    }
    if (reg == UC_ARM_REG_IPSR) {
        return x->rest & 0x1FF;
    }
    if (reg == UC_ARM_REG_PC) {
        return m->pc;
    }
    return *place_of(x, reg);
}

void f405_set(struct f405 *m, int reg, uint32_t value) {
    if (reg == UC_ARM_REG_XPSR) {
        set_xpsr(&m->registers, value);
    } else {
        *place_of(&m->registers, reg) = value;
    }
}

// In the order in which they are lent: SP depends on the mode, so it comes after that.
static const int lendable[] = {
    UC_ARM_REG_PRIMASK, UC_ARM_REG_FAULTMASK, UC_ARM_REG_BASEPRI, UC_ARM_REG_CONTROL,
    UC_ARM_REG_XPSR,    UC_ARM_REG_SP,        UC_ARM_REG_LR,      UC_ARM_REG_FPSCR,
};
enum { LENDABLE = sizeof lendable / sizeof *lendable };

static void lend(struct f405 *m, int reg) {
    struct f405_registers *x = &m->registers;
    const bool is_xpsr = reg == UC_ARM_REG_XPSR;
    // IT blocks are handled here: libunicorn gets their instructions one by one.
    const uint32_t value =
        is_xpsr ? xpsr_of(x) & ~(uint32_t)XPSR_IT : *place_of(x, reg);
    const uint32_t theirs = is_xpsr ? xpsr_of(&m->lent) : *place_of(&m->lent, reg);
    if (value != theirs) {
        (void)uc_reg_write(m->uc, reg, &value);
    }
}

static void take_back(struct f405 *m, int reg) {
    if (reg == UC_ARM_REG_XPSR) {
        const uint8_t it = m->registers.it;
        set_xpsr(&m->registers, ask(m, reg) & ~(uint32_t)XPSR_IT);
        m->registers.it = it;
    } else {
        *place_of(&m->registers, reg) = ask(m, reg);
    }
}

static void for_each_register(struct f405 *m, void (*do_it)(struct f405 *m, int reg)) {
    for (int i = 0; i < LENDABLE; i++) {
        do_it(m, lendable[i]);
    }
    for (int i = 0; i <= 12; i++) {
        do_it(m, UC_ARM_REG_R0 + i);
    }
    for (int i = 0; i < 32; i++) {
        do_it(m, UC_ARM_REG_S0 + i);
    }
}

uint32_t f405_sp(const struct f405 *m) {
    return f405_get(m, UC_ARM_REG_SP);
}

void registers_lend(struct f405 *m) {
    for_each_register(m, lend);
}

void registers_take_back(struct f405 *m) {
    for_each_register(m, take_back);
    m->lent = m->registers;
}
