// SPDX-License-Identifier: MIT
// libunicorn behind the virtual Cortex-M4: its callbacks while it executes one
// instruction, and why it has stopped; see engine.h.
#include "engine.h"

#include "f405/f405.h"

enum {
    // Instructions that the hook has to recognize (ARM, chapters A5 and A7).
    CPS = 0xB660,
    CPS_MASK = 0xFFE8,
    WFE = 0xBF20,
    SEV = 0xBF40,
    MSR = 0xF380,
    MSR_MASK = 0xFFE0,
    DIVIDE = 0xFB90,  // SDIV; UDIV has bit 5 set
    DIVIDE_MASK = 0xFFD0,
    COPROCESSOR = 0xEC00,
    // Exception numbers that libunicorn passes to the interrupt hook (QEMU's
    // target/arm/cpu.h).
    TRAP_SVC = 2,
    TRAP_BREAKPOINT = 7,
    TRAP_RETURN = 8,
    TRAP_INVALID_STATE = 18,
    // PM, "Configurable fault status register".
    STATUS_FETCH = 1 << 0,       // IACCVIOL
    STATUS_FETCH_BUS = 1 << 8,   // IBUSERR
    STATUS_PRECISE = 1 << 9,     // PRECISERR
    STATUS_IMPRECISE = 1 << 10,  // IMPRECISERR
    STATUS_BFAR = 1 << 15,       // BFARVALID
    STATUS_UNDEFINED = 1 << 16,  // UNDEFINSTR
    STATUS_STATE = 1 << 17,      // INVSTATE
    STATUS_NO_FPU = 1 << 19,     // NOCP
    STATUS_DIVISION = 1 << 25,   // DIVBYZERO
    DEBUG_EVENT = 1U << 31,      // of HFSR
    CCR_DIVISION_TRAP = 1 << 4,
    FPU_ACCESS = 0xF << 20,  // of CPACR
};

struct window_port {
    struct f405 *m;
    uint32_t base;
};
static struct window_port window_ports[BUS_WINDOWS];

static uint64_t on_read(uc_engine *uc, uint64_t offset, unsigned size, void *user) {
    (void)uc;
    const struct window_port *port = user;
    uint32_t value = 0;
    (void)f405_bus_read(port->m, port->base + (uint32_t)offset, size, &value);
    return value;
}

static void on_write(uc_engine *uc, uint64_t offset, unsigned size, uint64_t value,
                     void *user) {
    (void)uc;
    const struct window_port *port = user;
    (void)f405_bus_write(port->m, port->base + (uint32_t)offset, size, (uint32_t)value);
}

static bool on_invalid(uc_engine *uc, uc_mem_type type, uint64_t address, int size,
                       int64_t value, void *user) {
    (void)uc;
    struct f405 *m = user;
    m->fault_address = (uint32_t)address;
    if (type == UC_MEM_WRITE_PROT && f405_is_flash((uint32_t)address)) {
        flash_store(m, (uint32_t)address, (unsigned)size, (uint32_t)value);
        return true;
    }
    if (type == UC_MEM_WRITE_UNMAPPED || type == UC_MEM_WRITE_PROT) {
        m->fault = FAULT_STORE;
    } else if (type == UC_MEM_READ_UNMAPPED || type == UC_MEM_READ_PROT) {
        m->fault = FAULT_LOAD;
    }
    return false;
}

static bool on_undefined(uc_engine *uc, void *user) {
    (void)uc;
    (void)user;
    return false;
}

static void on_trap(uc_engine *uc, uint32_t number, void *user) {
    struct f405 *m = user;
    m->trap = (int)number;
    (void)uc_emu_stop(uc);
}

static bool is_fpu_instruction(const uint8_t *code) {
    const unsigned first = code[0] | (code[1] << 8);
    const unsigned coprocessor = code[3] & 0x0F;
    return (first & COPROCESSOR) == COPROCESSOR &&
           (coprocessor == 10 || coprocessor == 11);
}

static bool divides_by_zero(const struct f405 *m, const uint8_t *code) {
    const unsigned first = code[0] | (code[1] << 8);
    if ((first & DIVIDE_MASK) != DIVIDE || (code[2] & 0xF0) != 0xF0) {
        return false;
    }
    const unsigned divisor = code[2] & 0x0F;
    return divisor < 13 && f405_get(m, UC_ARM_REG_R0 + (int)divisor) == 0;
}

static void look_at_long(struct f405 *m, const uint8_t *code) {
    const unsigned first = code[0] | (code[1] << 8);
    if ((first & MSR_MASK) == MSR && m->is_blocked) {
        m->attention = 2;
    } else if ((m->core.cpacr & FPU_ACCESS) != FPU_ACCESS && is_fpu_instruction(code)) {
        m->fault = FAULT_NO_FPU;
    } else if ((m->core.ccr & CCR_DIVISION_TRAP) != 0 && divides_by_zero(m, code)) {
        m->fault = FAULT_DIVISION;
    }
}

static void look_at_short(struct f405 *m, const uint8_t *code) {
    const unsigned word = code[0] | (code[1] << 8);
    if (word == WFE) {
        m->is_waiting = true;
    } else if (word == SEV) {
        m->core.has_event = true;
    } else if ((word & CPS_MASK) == CPS && m->is_blocked) {
        // The manual promises an effect no earlier (ARM, "MSR, CPS: visibility"; PM,
        // "ISB").
        m->attention = 2;
    }
}

// Called before the one instruction that libunicorn executes for us, and before the
// next.
static void on_instruction(uc_engine *uc, uint64_t address, uint32_t size, void *user) {
    struct f405 *m = user;
    m->pc = (uint32_t)address;
    if (m->flash_control.store_count > 0) {
        flash_settle(m);
    }
    if (m->has_stepped) {
        m->is_stopped = true;
        (void)uc_emu_stop(uc);
        return;
    }
    m->has_stepped = true;
    const uint8_t *code = f405_memory(m, m->pc, 2);
    if (size == 4) {
        if (code != NULL) {
            look_at_long(m, code);
        }
        if (m->fault != FAULT_NONE) {
            (void)uc_emu_stop(uc);
            return;
        }
    } else if (code != NULL) {
        look_at_short(m, code);
        if (m->is_waiting) {
            m->cycle++;
            (void)uc_emu_stop(uc);
            return;
        }
    }
    m->cycle++;
}

static void serve_fault(struct f405 *m) {
    struct f405_core *core = &m->core;
    const uint32_t pc = m->pc;
    switch (m->fault) {
    case FAULT_LOAD:
        core->bfar = m->fault_address;
        core_fault(m, EXCEPTION_BUS_FAULT, STATUS_PRECISE | STATUS_BFAR);
        break;
    case FAULT_STORE: {
        // A store is buffered: the core is past it when the bus reports the error.
        const uint8_t *code = f405_memory(m, pc, 2);
        m->pc = pc + (code != NULL && code[1] >= 0xE8 ? 4 : 2);
        core_fault(m, EXCEPTION_BUS_FAULT, STATUS_IMPRECISE);
        break;
    }
    case FAULT_NO_FPU:
        core_fault(m, EXCEPTION_USAGE_FAULT, STATUS_NO_FPU);
        break;
    case FAULT_DIVISION:
        core_fault(m, EXCEPTION_USAGE_FAULT, STATUS_DIVISION);
        break;
    case FAULT_NONE:
        break;
    }
    m->fault = FAULT_NONE;
}

static void serve_trap(struct f405 *m) {
    const int trap = m->trap;
    m->trap = -1;
    switch (trap) {
    case TRAP_SVC:
        core_service_call(m);
        break;
    case TRAP_RETURN:
        core_return(m, m->pc | 1);
        break;
    case TRAP_BREAKPOINT:
        m->core.hfsr |= DEBUG_EVENT;
        core_fault(m, EXCEPTION_HARD_FAULT, 0);
        break;
    case TRAP_INVALID_STATE:
        core_fault(m, EXCEPTION_USAGE_FAULT, STATUS_STATE);
        break;
    default:
        f405_end(m, "gets an exception that is not modelled (%d),", trap);
        break;
    }
}

static uint32_t their_pc(const struct f405 *m) {
    uint32_t pc = 0;
    (void)uc_reg_read(m->uc, UC_ARM_REG_PC, &pc);
    return pc;
}

void engine_serve_stop(struct f405 *m, uc_err error) {
    const uint32_t at = m->pc;
    m->pc = their_pc(m);
    if (m->flash_control.store_count > 0) {
        flash_settle(m);
    }
    if (m->fault != FAULT_NONE) {
        m->pc = at;
        serve_fault(m);
    } else if (m->trap >= 0) {
        serve_trap(m);
    } else if (error == UC_ERR_INSN_INVALID) {
        m->pc = at;
        core_fault(m, EXCEPTION_USAGE_FAULT, STATUS_UNDEFINED);
    } else if (error == UC_ERR_FETCH_UNMAPPED || error == UC_ERR_FETCH_PROT) {
        // Never to be executed are the peripherals and all above (PM, "Memory
        // regions").
        const bool is_never = m->pc >= 0x40000000;
        core_fault(m, is_never ? EXCEPTION_MEMORY_FAULT : EXCEPTION_BUS_FAULT,
                   is_never ? STATUS_FETCH : STATUS_FETCH_BUS);
    } else if (error != UC_ERR_OK) {
        f405_end(m, "makes libunicorn say: %s,", uc_strerror(error));
    } else if (m->is_waiting) {
        m->pc = at + 2;  // WFE has not been executed
        (void)core_sleep(m);
    } else {
        (void)core_sleep(m);  // WFI.W
    }
}

bool engine_step(struct f405 *m, uc_err *error) {
    const uint32_t at = m->pc;
    registers_lend(m);
    m->is_lent = true;
    m->has_stepped = m->is_stopped = false;
    *error = uc_emu_start(m->uc, m->pc | 1, 0, 0, 0);
    m->is_lent = false;
#if UC_API_MAJOR > 2 || (UC_API_MAJOR == 2 && UC_API_MINOR >= 1)
    // libunicorn remembers that a store to that page was allowed and would not ask
    // again. Before 2.1 this call drops all translated code instead and takes long.
    if (m->flash_control.has_stored) {
        (void)uc_ctl_flush_tlb(m->uc);
    }
#endif
    m->flash_control.has_stored = false;
    registers_take_back(m);
    if (*error == UC_ERR_OK && m->fault == FAULT_NONE) {
        m->registers.it = thumb_advance(m->registers.it);
    }
    const bool is_done =
        *error == UC_ERR_OK && m->fault == FAULT_NONE && m->trap < 0 && m->is_stopped;
    if (m->has_stepped && m->watch.on_instruction != NULL) {
        m->watch.on_instruction(m->watch.context, at, m->pc);
    }
    m->is_stopped = false;
    return is_done;
}

static bool map_memory(struct f405 *m) {
    uc_engine *uc = m->uc;
    const uint32_t code = UC_PROT_READ | UC_PROT_EXEC;
    const uint32_t data = UC_PROT_READ | UC_PROT_WRITE;
    bool good =
        uc_mem_map_ptr(uc, F405_FLASH, F405_FLASH_SIZE, code, m->flash) == UC_ERR_OK &&
        uc_mem_map_ptr(uc, 0, F405_FLASH_SIZE, code, m->flash) == UC_ERR_OK &&
        uc_mem_map_ptr(uc, F405_RAM, F405_RAM_SIZE, UC_PROT_ALL, m->ram) == UC_ERR_OK &&
        uc_mem_map_ptr(uc, F405_CCM, F405_CCM_SIZE, data, m->ccm) == UC_ERR_OK &&
        uc_mem_map_ptr(uc, F405_SYSTEM, F405_SYSTEM_SIZE, UC_PROT_READ, m->system) ==
            UC_ERR_OK;
    for (unsigned i = 0; good && i < BUS_WINDOWS; i++) {
        window_ports[i] = (struct window_port){m, bus_windows[i].base};
        good = uc_mmio_map(uc, bus_windows[i].base, bus_windows[i].size, on_read,
                           &window_ports[i], on_write, &window_ports[i]) == UC_ERR_OK;
    }
    return good;
}

// libunicorn takes any callback as void *; C has no direct conversion from a function
// pointer.
static bool add_hook(struct f405 *m, int type, void *callback) {
    uc_hook hook = 0;
    return uc_hook_add(m->uc, &hook, type, callback, m, 1, 0) == UC_ERR_OK;
}

static bool add_hooks(struct f405 *m) {
    return add_hook(m, UC_HOOK_CODE, (void *)(uintptr_t)on_instruction) &&
           add_hook(m, UC_HOOK_INTR, (void *)(uintptr_t)on_trap) &&
           add_hook(m, UC_HOOK_MEM_INVALID, (void *)(uintptr_t)on_invalid) &&
           add_hook(m, UC_HOOK_INSN_INVALID, (void *)(uintptr_t)on_undefined);
}

bool engine_open(struct f405 *m) {
    if (uc_open(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS, &m->uc) != UC_ERR_OK ||
        uc_ctl_set_cpu_model(m->uc, UC_CPU_ARM_CORTEX_M4) != UC_ERR_OK ||
        uc_ctl_exits_enable(m->uc) != UC_ERR_OK || !map_memory(m) || !add_hooks(m)) {
        return false;
    }
    registers_take_back(m);
    return true;
}

void engine_close(struct f405 *m) {
    if (m->uc != NULL) {
        (void)uc_close(m->uc);
    }
}
