// SPDX-License-Identifier: MIT
// The registers of the core (ARM, part B; PM, "Core peripherals"): those of the NVIC
// and the system control block, and where those of the DWT and the DBGMCU are.
#include "f405/f405.h"

enum {
    // Units of core_read().
    UNIT_SCS = 0,
    UNIT_DWT = 1,
    // Registers: 0xE000E000 +
    ICTR = 0x004,
    ACTLR = 0x008,
    STK_CTRL = 0x010,
    STK_CALIB = 0x01C,
    NVIC_ISER = 0x100,
    NVIC_ICER = 0x180,
    NVIC_ISPR = 0x200,
    NVIC_ICPR = 0x280,
    NVIC_IABR = 0x300,
    NVIC_IPR = 0x400,
    CPUID = 0xD00,
    ICSR = 0xD04,
    VTOR = 0xD08,
    AIRCR = 0xD0C,
    SCR = 0xD10,
    CCR = 0xD14,
    SHPR1 = 0xD18,
    SHPR3 = 0xD20,
    SHCSR = 0xD24,
    CFSR = 0xD28,
    HFSR = 0xD2C,
    DFSR = 0xD30,
    MMFAR = 0xD34,
    BFAR = 0xD38,
    AFSR = 0xD3C,
    CPACR = 0xD88,
    MPU_TYPE = 0xD90,
    DHCSR = 0xDF0,
    DEMCR = 0xDFC,
    STIR = 0xF00,
    FPCCR = 0xF34,
    FPCAR = 0xF38,
    FPDSCR = 0xF3C,
    MVFR0 = 0xF40,
    MVFR1 = 0xF44,
    FPCCR_AUTOMATIC = 1U << 31,  // ASPEN
};

static uint32_t read_bits(const bool *bits, uint32_t at) {
    uint32_t word = 0;
    for (unsigned i = 0; i < 32; i++) {
        const unsigned line = 8 * at + i;
        if (line < IRQ_LINES && bits[EXCEPTION_IRQ + line]) {
            word |= UINT32_C(1) << i;
        }
    }
    return word;
}

static void write_bits(bool *bits, uint32_t at, uint32_t word, bool value) {
    for (unsigned i = 0; i < 32; i++) {
        const unsigned line = 8 * at + i;
        if (line < IRQ_LINES && ((word >> i) & 1) != 0) {
            bits[EXCEPTION_IRQ + line] = value;
        }
    }
}

static uint32_t read_priorities(const struct f405 *m, unsigned first) {
    uint32_t word = 0;
    for (unsigned i = 0; i < 4; i++) {
        if (first + i < EXCEPTIONS) {
            word |= (uint32_t)m->core.priority[first + i] << (8 * i);
        }
    }
    return word;
}

static void write_priorities(struct f405 *m, unsigned first, uint32_t word) {
    for (unsigned i = 0; i < 4; i++) {
        const bool is_fixed = first + i <= EXCEPTION_HARD_FAULT;
        if (first + i < EXCEPTIONS && !is_fixed) {
            m->core.priority[first + i] =
                (uint8_t)((word >> (8 * i)) & CORE_PRIORITY_MASK);
        }
    }
}

static uint32_t read_icsr(const struct f405 *m) {
    const struct f405_core *core = &m->core;
    unsigned lines = 0;
    unsigned active = 0;
    for (unsigned i = EXCEPTION_NMI; i < EXCEPTIONS; i++) {
        lines |= i >= EXCEPTION_IRQ && core->pending[i] ? 1U : 0U;
        active += core->active[i] ? 1U : 0U;
    }
    return (f405_get(m, UC_ARM_REG_IPSR) & 0x1FF) | (active <= 1 ? 1U << 11 : 0U) |
           (core_find_pending(m) << 12) | (lines << 22) |
           (core->pending[EXCEPTION_SYSTICK] ? 1U << 26 : 0U) |
           (core->pending[EXCEPTION_PENDSV] ? 1U << 28 : 0U) |
           (core->pending[EXCEPTION_NMI] ? 1U << 31 : 0U);
}

static uint32_t read_shcsr(const struct f405 *m) {
    static const struct {
        uint8_t exception, active, pending;
    } bits[] = {
        {EXCEPTION_MEMORY_FAULT, 0, 13}, {EXCEPTION_BUS_FAULT, 1, 14},
        {EXCEPTION_USAGE_FAULT, 3, 12},  {EXCEPTION_SVC, 7, 15},
        {EXCEPTION_PENDSV, 10, 31},      {EXCEPTION_SYSTICK, 11, 31},
    };
    uint32_t value = m->core.shcsr;
    for (size_t i = 0; i < sizeof bits / sizeof *bits; i++) {
        value |= m->core.active[bits[i].exception] ? UINT32_C(1) << bits[i].active : 0;
        if (bits[i].pending != 31 && m->core.pending[bits[i].exception]) {
            value |= UINT32_C(1) << bits[i].pending;
        }
    }
    return value;
}

// True where the address is one of the NVIC's, or of the priorities beside it.
static bool read_nvic(const struct f405 *m, uint32_t at, uint32_t *value) {
    const struct f405_core *core = &m->core;
    if (at >= NVIC_ISER && at < NVIC_ISER + 0x40) {
        *value = read_bits(core->enabled, at - NVIC_ISER);
    } else if (at >= NVIC_ICER && at < NVIC_ICER + 0x40) {
        *value = read_bits(core->enabled, at - NVIC_ICER);
    } else if (at >= NVIC_ISPR && at < NVIC_ISPR + 0x40) {
        *value = read_bits(core->pending, at - NVIC_ISPR);
    } else if (at >= NVIC_ICPR && at < NVIC_ICPR + 0x40) {
        *value = read_bits(core->pending, at - NVIC_ICPR);
    } else if (at >= NVIC_IABR && at < NVIC_IABR + 0x40) {
        *value = read_bits(core->active, at - NVIC_IABR);
    } else if (at >= NVIC_IPR && at < NVIC_IPR + 0xF0) {
        *value = read_priorities(m, EXCEPTION_IRQ + (at - NVIC_IPR));
    } else if (at >= SHPR1 && at <= SHPR3) {
        *value = read_priorities(m, 4 + (at - SHPR1));
    } else {
        return false;
    }
    return true;
}

// The FPU's registers and the one that gives access to it. An address that is none of
// them is not modelled.
static uint32_t read_fpu(struct f405 *m, uint32_t at) {
    const struct f405_core *core = &m->core;
    switch (at) {
    case CPACR:
        return core->cpacr;
    case FPCCR:
        return core->fpccr;
    case FPCAR:
        return core->fpcar;
    case FPDSCR:
        return core->fpdscr;
    case MVFR0:
        return 0x10110021;
    case MVFR1:
        return 0x11000011;
    default:
        f405_end(m, "reads 0x%08x, which is not modelled,", 0xE000E000U + at);
        return 0;
    }
}

static uint32_t read_scs(struct f405 *m, uint32_t at) {
    const struct f405_core *core = &m->core;
    uint32_t value = 0;
    if (read_nvic(m, at, &value)) {
        return value;
    }
    if (at >= STK_CTRL && at <= STK_CALIB) {
        return systick_read(m, at - STK_CTRL);
    }
    switch (at) {
    case ICTR:
        return 2;
    case ACTLR:
    case AFSR:
    case DHCSR:  // no debugger
        return 0;
    case CPUID:
        return 0x410FC241;
    case ICSR:
        return read_icsr(m);
    case VTOR:
        return core->vtor;
    case AIRCR:
        return 0xFA050000 | core->aircr;
    case SCR:
        return core->scr;
    case CCR:
        return core->ccr;
    case SHCSR:
        return read_shcsr(m);
    case CFSR:
        return core->cfsr;
    case HFSR:
        return core->hfsr;
    case DFSR:
        return core->dfsr;
    case MMFAR:
        return core->mmfar;
    case BFAR:
        return core->bfar;
    case MPU_TYPE:
        return 0x800;
    case DEMCR:
        return core->demcr;
    default:
        return read_fpu(m, at);
    }
}

static void write_icsr(struct f405 *m, uint32_t value) {
    struct f405_core *core = &m->core;
    if ((value & (1U << 31)) != 0) {
        core_pend(m, EXCEPTION_NMI);
    }
    if ((value & (1U << 28)) != 0) {
        core_pend(m, EXCEPTION_PENDSV);
    } else if ((value & (1U << 27)) != 0) {
        core->pending[EXCEPTION_PENDSV] = false;
    }
    if ((value & (1U << 26)) != 0) {
        core_pend(m, EXCEPTION_SYSTICK);
    } else if ((value & (1U << 25)) != 0) {
        core->pending[EXCEPTION_SYSTICK] = false;
    }
}

static void write_aircr(struct f405 *m, uint32_t value) {
    if ((value >> 16) != 0x05FA) {
        f405_complain(m, "AIRCR written without its key");
        return;
    }
    m->core.aircr = value & 0x700;
    if ((value & 1) != 0) {
        f405_not_modelled(m, "VECTRESET");
    }
    if ((value & 4) != 0) {
        f405_reset(m, F405_RESET_SOFTWARE);
    }
}

// True where the address is one of the NVIC's.
static bool write_nvic(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_core *core = &m->core;
    if (at >= NVIC_ISER && at < NVIC_ISER + 0x40) {
        write_bits(core->enabled, at - NVIC_ISER, value, true);
    } else if (at >= NVIC_ICER && at < NVIC_ICER + 0x40) {
        write_bits(core->enabled, at - NVIC_ICER, value, false);
    } else if (at >= NVIC_ISPR && at < NVIC_ISPR + 0x40) {
        write_bits(core->pending, at - NVIC_ISPR, value, true);
    } else if (at >= NVIC_ICPR && at < NVIC_ICPR + 0x40) {
        write_bits(core->pending, at - NVIC_ICPR, value, false);
        for (unsigned i = EXCEPTION_IRQ; i < EXCEPTIONS; i++) {
            core->pending[i] |= core->level[i] && !core->active[i];
        }
    } else if (at >= NVIC_IPR && at < NVIC_IPR + 0xF0) {
        write_priorities(m, EXCEPTION_IRQ + (at - NVIC_IPR), value);
    } else if (at >= SHPR1 && at <= SHPR3) {
        write_priorities(m, 4 + (at - SHPR1), value);
    } else if (at == STIR) {
        if ((value & 0x1FF) < IRQ_LINES) {
            core->pending[EXCEPTION_IRQ + (value & 0x1FF)] = true;
        }
    } else {
        return false;
    }
    return true;
}

static void write_fpu(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_core *core = &m->core;
    switch (at) {
    case CPACR:
        core->cpacr = value & 0x00F00000;
        break;
    case FPCCR:
        core->fpccr = value & 0xC0000000;
        if ((value & FPCCR_AUTOMATIC) == 0) {
            f405_not_modelled(m, "FPU registers that are not saved");
        }
        break;
    case FPCAR:
        core->fpcar = value & ~UINT32_C(7);
        break;
    case FPDSCR:
        core->fpdscr = value & 0x07C00000;
        if (core->fpdscr != 0) {
            f405_not_modelled(m, "another FPU mode by default");
        }
        break;
    default:
        f405_end(m, "writes 0x%08x, which is not modelled,", 0xE000E000U + at);
        break;
    }
}

// The cycle counter stands while its enable bit, TRCENA, is off.
static void write_demcr(struct f405 *m, uint32_t value) {
    const uint32_t count = cycle_counter_read(m);
    m->core.demcr = value & 0x01000000;
    cycle_counter_write(m, count);
}

static void write_scs(struct f405 *m, uint32_t at, uint32_t value) {
    struct f405_core *core = &m->core;
    f405_attend(m);
    if (write_nvic(m, at, value)) {
        return;
    }
    if (at >= STK_CTRL && at < STK_CALIB) {
        systick_write(m, at - STK_CTRL, value);
        return;
    }
    switch (at) {
    case ACTLR:
        break;  // timing only
    case ICSR:
        write_icsr(m, value);
        break;
    case VTOR:
        core->vtor = value & 0x3FFFFE00;  // PM: 98 exceptions, so 512 bytes
        break;
    case AIRCR:
        write_aircr(m, value);
        break;
    case SCR:
        core->scr = value & 0x16;
        break;
    case CCR:
        core->ccr = value & 0x31B;
        if ((value & (1U << 3)) != 0) {
            f405_not_modelled(m, "UNALIGN_TRP");
        }
        break;
    case SHCSR:
        core->shcsr = value & 0x70000;
        break;
    case CFSR:
        core->cfsr &= ~value;
        break;
    case HFSR:
        core->hfsr &= ~value;
        break;
    case DFSR:
        core->dfsr &= ~value;
        break;
    case MMFAR:
        core->mmfar = value;
        break;
    case BFAR:
        core->bfar = value;
        break;
    case DEMCR:
        write_demcr(m, value);
        break;
    default:
        write_fpu(m, at, value);
        break;
    }
}

uint32_t core_read(struct f405 *m, unsigned unit, uint32_t at) {
    if (unit == UNIT_SCS) {
        return read_scs(m, at);
    }
    if (unit == UNIT_DWT && at == 0) {
        return 0x40000000 | m->core.dwt_control;
    }
    if (unit == UNIT_DWT && at == 4) {
        return cycle_counter_read(m);
    }
    if (unit != UNIT_DWT && at == 0) {
        return 0x10076413;  // RM, "DBGMCU_IDCODE": revision 1
    }
    if (unit != UNIT_DWT && at <= 12) {
        return m->core.debug;
    }
    f405_end(m, "reads a register of %s that is not modelled,",
             unit == UNIT_DWT ? "the DWT" : "DBGMCU");
    return 0;
}

void core_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    if (unit == UNIT_SCS) {
        write_scs(m, at, value);
    } else if (unit == UNIT_DWT && at == 0) {
        const uint32_t count = cycle_counter_read(m);
        m->core.dwt_control = value & 1;
        cycle_counter_write(m, count);
    } else if (unit == UNIT_DWT && at == 4) {
        cycle_counter_write(m, value);
    } else {
        f405_end(m, "writes a register of %s that is not modelled,",
                 unit == UNIT_DWT ? "the DWT" : "DBGMCU");
    }
}
