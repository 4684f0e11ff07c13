// SPDX-License-Identifier: MIT
// The loop of the virtual STM32F405: time, memory, the map of its peripherals, resets,
// and libunicorn, which runs the instructions.
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "f405.h"

enum {
    // Instructions that the hook has to know (ARM, chapters A5 and A7).
    CPS = 0xB660,
    CPS_MASK = 0xFFE8,
    XPSR_IT = 0x0600FC00,
    WFE = 0xBF20,
    SEV = 0xBF40,
    MSR = 0xF380,
    MSR_MASK = 0xFFE0,
    DIVIDE = 0xFB90,  // SDIV; UDIV has bit 5 set
    DIVIDE_MASK = 0xFFD0,
    COPROCESSOR = 0xEC00,
    // What the interrupt hook is told (QEMU's target/arm/cpu.h).
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

// What there is on the buses (RM, "Memory map"; the core's own: PM, "Core
// peripherals").
enum access { ACCESS_WORDS, ACCESS_APB, ACCESS_AHB };
enum { NO_CLOCK = 255, AHB1 = 0, APB1 = 4, APB2 = 5 };

static void exti_reset_unit(struct f405 *m, unsigned unit) {
    (void)unit;
    exti_reset(m);
}

static void syscfg_reset_unit(struct f405 *m, unsigned unit) {
    (void)unit;
    syscfg_reset(m);
}

static void flash_reset_unit(struct f405 *m, unsigned unit) {
    (void)unit;
    flash_reset(m);
}

static const struct block {
    const char *name;
    uint32_t base, size;
    uint8_t bus, bit;  // of its clock and its reset in the RCC
    enum access access;
    uint8_t unit;
    uint32_t (*read)(struct f405 *m, unsigned unit, uint32_t at);
    void (*write)(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);
    void (*reset)(struct f405 *m, unsigned unit);
} blocks[] = {
    {"TIM2", 0x40000000, 0x400, APB1, 0, ACCESS_APB, 0, timer_read, timer_write,
     timer_reset},
    {"TIM3", 0x40000400, 0x400, APB1, 1, ACCESS_APB, 1, timer_read, timer_write,
     timer_reset},
    {"TIM4", 0x40000800, 0x400, APB1, 2, ACCESS_APB, 2, timer_read, timer_write,
     timer_reset},
    {"TIM5", 0x40000C00, 0x400, APB1, 3, ACCESS_APB, 3, timer_read, timer_write,
     timer_reset},
    {"IWDG", 0x40003000, 0x400, NO_CLOCK, 0, ACCESS_APB, 0, iwdg_read, iwdg_write,
     iwdg_reset},
    {"USART2", 0x40004400, 0x400, APB1, 17, ACCESS_APB, 0, usart_read, usart_write,
     usart_reset},
    {"I2C1", 0x40005400, 0x400, APB1, 21, ACCESS_APB, 0, i2c_read, i2c_write,
     i2c_reset},
    {"PWR", 0x40007000, 0x400, APB1, 28, ACCESS_APB, 0, pwr_read, pwr_write, NULL},
    {"ADC", 0x40012000, 0x400, APB2, 8, ACCESS_WORDS, 0, adc_read, adc_write,
     adc_reset},
    {"SPI1", 0x40013000, 0x400, APB2, 12, ACCESS_APB, 0, spi_read, spi_write,
     spi_reset},
    {"SYSCFG", 0x40013800, 0x400, APB2, 14, ACCESS_APB, 0, syscfg_read, syscfg_write,
     syscfg_reset_unit},
    {"EXTI", 0x40013C00, 0x400, NO_CLOCK, 0, ACCESS_APB, 0, exti_read, exti_write,
     exti_reset_unit},
    {"GPIOA", 0x40020000, 0x400, AHB1, 0, ACCESS_AHB, PORT_A, pins_read, pins_write,
     pins_reset},
    {"GPIOB", 0x40020400, 0x400, AHB1, 1, ACCESS_AHB, PORT_B, pins_read, pins_write,
     pins_reset},
    {"GPIOC", 0x40020800, 0x400, AHB1, 2, ACCESS_AHB, PORT_C, pins_read, pins_write,
     pins_reset},
    {"GPIOD", 0x40020C00, 0x400, AHB1, 3, ACCESS_AHB, PORT_D, pins_read, pins_write,
     pins_reset},
    {"GPIOH", 0x40021C00, 0x400, AHB1, 7, ACCESS_AHB, PORT_H, pins_read, pins_write,
     pins_reset},
    {"RCC", 0x40023800, 0x400, NO_CLOCK, 0, ACCESS_AHB, 0, rcc_read, rcc_write, NULL},
    {"FLASH", 0x40023C00, 0x400, NO_CLOCK, 0, ACCESS_WORDS, 0, flash_read, flash_write,
     flash_reset_unit},
    {"DMA1", 0x40026000, 0x400, AHB1, 21, ACCESS_WORDS, 0, dma_read, dma_write,
     dma_reset},
    {"DMA2", 0x40026400, 0x400, AHB1, 22, ACCESS_WORDS, 1, dma_read, dma_write,
     dma_reset},
    {"DWT", 0xE0001000, 0x1000, NO_CLOCK, 0, ACCESS_WORDS, 1, core_read, core_write,
     NULL},
    {"SCS", 0xE000E000, 0x1000, NO_CLOCK, 0, ACCESS_AHB, 0, core_read, core_write,
     NULL},
    {"DBGMCU", 0xE0042000, 0x400, NO_CLOCK, 0, ACCESS_WORDS, 2, core_read, core_write,
     NULL},
};

// Where libunicorn asks us. What is not in the table above ends the run; outside of
// these nothing answers and the core gets a bus fault.
static const struct {
    uint32_t base, size;
} windows[] = {
    {0x22000000, 0x02000000},  // RAM bit by bit
    {0x40000000, 0x00008000},  // APB1
    {0x40010000, 0x00008000},  // APB2
    {0x40020000, 0x00060000},  // AHB1
    {0x42000000, 0x02000000},  // peripherals bit by bit
    {0x50000000, 0x00061000},  // AHB2
    {0xA0000000, 0x00001000},  // FSMC
    {0xE0000000, 0x00100000},  // the core's own
};
enum { WINDOWS = sizeof windows / sizeof *windows };

struct window_port {
    struct f405 *m;
    uint32_t base;
};
static struct window_port window_ports[WINDOWS];

// Small things

void f405_complain(struct f405 *m, const char *what) {
    if (m->complaint == NULL) {
        m->complaint = what;
    }
}

void f405_end(struct f405 *m, const char *format, ...) {
    if (m->ended != NULL) {
        return;
    }
    va_list list;
    va_start(list, format);
    (void)vsnprintf(m->ended_text, sizeof m->ended_text, format, list);
    va_end(list);
    m->ended = m->ended_text;
    f405_attend(m);
}

void f405_not_modelled(struct f405 *m, const char *what) {
    f405_end(m, "uses what is not modelled, %s,", what);
}

// xorshift64*, Vigna 2016: noise that is the same for the same seed.
uint32_t f405_random(struct f405 *m) {
    uint64_t x = m->seed;
    x ^= x >> 12;
    x ^= x << 25;
    x ^= x >> 27;
    m->seed = x;
    return (uint32_t)((x * UINT64_C(0x2545F4914F6CDD1D)) >> 32);
}

// Registers: ours, or libunicorn's while it executes. One list for both.

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

// In the order in which they are lent: the mode decides what SP is.
static const int lendable[] = {
    UC_ARM_REG_PRIMASK, UC_ARM_REG_FAULTMASK, UC_ARM_REG_BASEPRI, UC_ARM_REG_CONTROL,
    UC_ARM_REG_XPSR,    UC_ARM_REG_SP,        UC_ARM_REG_LR,      UC_ARM_REG_FPSCR,
};
enum { LENDABLE = sizeof lendable / sizeof *lendable };

static void lend(struct f405 *m, int reg) {
    struct f405_registers *x = &m->registers;
    const bool is_xpsr = reg == UC_ARM_REG_XPSR;
    // An IT block is ours: libunicorn gets its instructions one by one.
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

// Time

// Picoseconds a cycle as the shortest fraction, with which 64 bits reach far: 125000/21
// at 168 MHz, and 2^64/125000 cycles are 10 days. Clocks are few, so the last is kept.
struct ratio {
    uint32_t hz;
    uint64_t ps, cycles;
};

static const struct ratio *ratio_of(uint32_t hz) {
    static struct ratio last[4];
    struct ratio *ratio = &last[(hz >> 4) & 3];
    if (ratio->hz != hz) {
        uint64_t a = F405_PS_PER_S;
        for (uint64_t b = hz; b != 0;) {
            const uint64_t rest = a % b;
            a = b;
            b = rest;
        }
        *ratio = (struct ratio){hz, F405_PS_PER_S / a, hz / a};
    }
    return ratio;
}

// a * b / c, by whichever width that takes.
static uint64_t scale(uint64_t a, uint64_t b, uint64_t c, bool is_up) {
    uint64_t product = 0;
    const uint64_t more = is_up ? c - 1 : 0;
    if (__builtin_mul_overflow(a, b, &product) ||
        __builtin_add_overflow(product, more, &product)) {
        return (uint64_t)(((unsigned __int128)a * b + more) / c);
    }
    return product / c;
}

uint64_t f405_ps(uint64_t cycles, uint32_t hz) {
    if (hz == 0) {
        return F405_NEVER / 4;  // far away, and no sum with it overflows
    }
    const struct ratio *ratio = ratio_of(hz);
    return scale(cycles, ratio->ps, ratio->cycles, false);
}

uint64_t f405_now(const struct f405 *m) {
    if (m->hclk_hz == 0) {
        return m->base_ps;
    }
    return m->base_ps + f405_ps(m->cycle - m->base_cycle, m->hclk_hz);
}

uint64_t f405_when(const struct f405 *m) {
    return m->when != F405_NEVER ? m->when : f405_now(m);
}

uint64_t f405_ns(uint64_t ps) {
    return ps / 1000;
}

// The first cycle at or after that time.
uint64_t f405_cycle_at(const struct f405 *m, uint64_t ps) {
    if (ps <= m->base_ps) {
        return m->base_cycle;
    }
    if (m->hclk_hz == 0) {
        return m->base_cycle;
    }
    const struct ratio *ratio = ratio_of(m->hclk_hz);
    return m->base_cycle + scale(ps - m->base_ps, ratio->cycles, ratio->ps, true);
}

static void find_next(struct f405 *m) {
    uint64_t next = F405_NEVER;
    for (unsigned i = 0; i < EVENTS; i++) {
        next = m->at[i] < next ? m->at[i] : next;
    }
    m->next_ps = next;
}

static void limit(struct f405 *m, uint64_t ps) {
    if (m->is_in_code) {
        const uint64_t cycle = f405_cycle_at(m, ps);
        m->limit_cycle = cycle < m->limit_cycle ? cycle : m->limit_cycle;
    }
}

void f405_at(struct f405 *m, enum f405_event event, uint64_t ps) {
    m->at[event] = ps;
    find_next(m);
    limit(m, ps);
}

void f405_never(struct f405 *m, enum f405_event event) {
    m->at[event] = F405_NEVER;
    find_next(m);
}

void f405_attend(struct f405 *m) {
    m->attention = 1;
}

void f405_pause(struct f405 *m, uint64_t at_ps) {
    if (at_ps < m->until) {
        m->until = at_ps;
        limit(m, at_ps);
    }
}

// Memory

bool f405_is_flash(uint32_t address) {
    return address < F405_FLASH_SIZE || address - F405_FLASH < F405_FLASH_SIZE;
}

uint8_t *f405_memory(struct f405 *m, uint32_t address, uint32_t size) {
    if (address - F405_FLASH <= F405_FLASH_SIZE - size) {
        return m->flash + (address - F405_FLASH);
    }
    if (address - F405_RAM <= F405_RAM_SIZE - size) {
        return m->ram + (address - F405_RAM);
    }
    if (address <= F405_FLASH_SIZE - size) {
        return m->flash + address;
    }
    if (address - F405_CCM <= F405_CCM_SIZE - size) {
        return m->ccm + (address - F405_CCM);
    }
    return NULL;
}

bool f405_is_clocked(const struct f405 *m, unsigned bus, unsigned bit) {
    return bus == NO_CLOCK || ((m->rcc.enr[bus] >> bit) & 1) != 0;
}

static const struct block *find_block(uint32_t address) {
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
        if (address - blocks[i].base < blocks[i].size) {
            return &blocks[i];
        }
    }
    return NULL;
}

static bool is_window(uint32_t address) {
    for (unsigned i = 0; i < WINDOWS; i++) {
        if (address - windows[i].base < windows[i].size) {
            return true;
        }
    }
    return false;
}

// Null where the run is over, or where the registers are asleep.
static const struct block *reach(struct f405 *m, uint32_t address, bool is_write) {
    const struct block *block = find_block(address);
    if (block == NULL) {
        f405_end(m, "%s 0x%08x, which is not modelled,", is_write ? "writes" : "reads",
                 address);
        return NULL;
    }
    if (!f405_is_clocked(m, block->bus, block->bit)) {
        f405_complain(m, "a peripheral used with its clock off");
        return NULL;
    }
    return block;
}

bool f405_bus_read(struct f405 *m, uint32_t address, unsigned size, uint32_t *value) {
    const uint8_t *memory = f405_memory(m, address, size);
    *value = 0;
    if (memory != NULL) {
        memcpy(value, memory, size);
        return true;
    }
    if (!is_window(address)) {
        return false;
    }
    const struct block *block = reach(m, address, false);
    if (block != NULL) {
        const uint32_t word =
            block->read(m, block->unit, (address - block->base) & ~UINT32_C(3));
        *value = (word >> (8 * (address & 3))) & (UINT32_MAX >> (32 - 8 * size));
        f405_pump(m);
    }
    return true;
}

// A part of a word: the APB repeats it over the word (RM, "AHB/APB bridges"), the AHB's
// registers take it for themselves.
static uint32_t widen(struct f405 *m, const struct block *block, uint32_t at,
                      unsigned size, uint32_t value) {
    const uint32_t mask = UINT32_MAX >> (32 - 8 * size);
    if (block->access == ACCESS_WORDS) {
        f405_complain(m, "a part of a register written that takes words alone");
    }
    if (block->access == ACCESS_APB) {
        const uint32_t part = value & mask;
        return size == 1 ? part * UINT32_C(0x01010101) : part * UINT32_C(0x00010001);
    }
    const unsigned shift = 8 * (at & 3);
    const uint32_t word = block->read(m, block->unit, at & ~UINT32_C(3));
    return (word & ~(mask << shift)) | ((value & mask) << shift);
}

bool f405_bus_write(struct f405 *m, uint32_t address, unsigned size, uint32_t value) {
    uint8_t *memory = f405_memory(m, address, size);
    if (memory != NULL) {
        if (f405_is_flash(address)) {
            return false;  // no bus master but the core programs it
        }
        memcpy(memory, &value, size);
        return true;
    }
    if (!is_window(address)) {
        return false;
    }
    const struct block *block = reach(m, address, true);
    if (block != NULL) {
        const uint32_t at = address - block->base;
        if (size != 4) {
            value = widen(m, block, at, size, value);
        }
        block->write(m, block->unit, at & ~UINT32_C(3), value);
        f405_pump(m);
    }
    return true;
}

void f405_pump(struct f405 *m) {
    if (m->is_pumping) {
        return;
    }
    m->is_pumping = true;
    while (i2c_pump(m) || usart_pump(m) || spi_pump(m) || adc_pump(m)) {
    }
    m->is_pumping = false;
}

// What libunicorn asks and tells

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
        // The manual promises no earlier (ARM, "MSR, CPS: visibility"; PM, "ISB").
        m->attention = 2;
    }
}

// Before the one instruction that libunicorn executes for us, and before the next.
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

// Resets

static void reset_peripherals(struct f405 *m) {
    for (unsigned i = 0; i < EVENTS; i++) {
        if (i != EVENT_CHIP && i != EVENT_RADIO) {
            m->at[i] = F405_NEVER;
        }
    }
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
        if (blocks[i].reset != NULL) {
            blocks[i].reset(m, blocks[i].unit);
        }
    }
    find_next(m);
}

static void start(struct f405 *m, uint32_t cause) {
    rcc_reset(m, cause);
    reset_peripherals(m);
    core_reset(m);
    m->is_asleep = m->is_locked_up = m->is_blocked = false;
    m->is_waiting = m->is_deep = false;
    m->attention = 0;
    m->fault = FAULT_NONE;
    m->trap = -1;
    m->wants_reset = 0;
    for (int i = 0; i <= 12; i++) {
        f405_set(m, UC_ARM_REG_R0 + i, 0);
    }
    uint32_t vectors[2];
    memcpy(vectors, m->flash, sizeof vectors);
    f405_set(m, UC_ARM_REG_XPSR, UINT32_C(1) << 24);
    f405_set(m, UC_ARM_REG_CONTROL, 0);
    f405_set(m, UC_ARM_REG_PRIMASK, 0);
    f405_set(m, UC_ARM_REG_FAULTMASK, 0);
    f405_set(m, UC_ARM_REG_BASEPRI, 0);
    f405_set(m, UC_ARM_REG_FPSCR, 0);
    f405_set(m, UC_ARM_REG_SP, vectors[0] & ~UINT32_C(3));
    f405_set(m, UC_ARM_REG_LR, UINT32_MAX);
    m->pc = vectors[1] & ~UINT32_C(1);
    if ((vectors[1] & 1) == 0) {
        f405_end(m, "has no reset vector,");
    }
}

static void paint_stack(struct f405 *m) {
    const uint32_t size = m->stack.top - m->stack.lowest;
    uint8_t *memory = f405_memory(m, m->stack.lowest, size);
    if (memory != NULL && m->stack.top > m->stack.lowest) {
        memset(memory, F405_PAINT, size);
    }
}

static void forget_memory(struct f405 *m) {
    for (uint32_t i = 0; i < F405_RAM_SIZE; i++) {
        m->ram[i] = (uint8_t)f405_random(m);
    }
    for (uint32_t i = 0; i < F405_CCM_SIZE; i++) {
        m->ccm[i] = (uint8_t)f405_random(m);
    }
    paint_stack(m);
}

static void do_reset(struct f405 *m, uint32_t cause) {
    (void)f405_stack_deepest(m);
    if (cause == F405_RESET_BROWN_OUT) {
        forget_memory(m);
        m->chip->power_cycle(m->chip->self, f405_ns(f405_now(m)));
        if (m->card != NULL) {
            m->card->power_cycle(m->card->self, f405_ns(f405_now(m)));
        }
        if (m->radio != NULL) {
            m->radio->power_cycle(m->radio->self, f405_ns(f405_now(m)));
        }
    }
    m->resets++;
    if (m->rcc.is_stopped) {
        m->stopped += f405_now(m) - m->rcc.stopped_at;
    }
    if (m->on_reset != NULL) {
        m->on_reset(m->context);
    }
    start(m, cause);
    pins_follow(m);
    wired_follow(m);
}

void f405_reset(struct f405 *m, uint32_t cause) {
    if (m->when != F405_NEVER || m->is_in_code) {
        m->wants_reset = cause;  // once the core has stopped
        f405_attend(m);
    } else {
        do_reset(m, cause);
    }
}

void f405_power_up(struct f405 *m) {
    rcc_power_up(m);
    forget_memory(m);
    start(m, F405_RESET_POWER_ON | F405_RESET_BROWN_OUT);
    pins_follow(m);
    wired_power_up(m);
}

// The loop

static void follow_chip(struct f405 *m) {
    m->chip->advance(m->chip->self, f405_ns(f405_when(m)));
    pins_follow(m);
}

static void do_event(struct f405 *m, enum f405_event event) {
    switch (event) {
    case EVENT_OSCILLATORS:
        rcc_event(m);
        break;
    case EVENT_CHIP:
        follow_chip(m);
        break;
    case EVENT_FLASH:
        flash_event(m);
        break;
    case EVENT_IWDG:
        iwdg_event(m);
        break;
    case EVENT_SYSTICK:
        core_tick(m);
        break;
    case EVENT_TIMER2:
    case EVENT_TIMER3:
    case EVENT_TIMER4:
    case EVENT_TIMER5:
        timer_event(m, event - EVENT_TIMER2);
        break;
    case EVENT_I2C:
        i2c_event(m);
        break;
    case EVENT_USART_SENT:
        usart_sent(m);
        break;
    case EVENT_USART_RECEIVED:
        usart_received(m);
        break;
    case EVENT_USART_IDLE:
        usart_idle(m);
        break;
    case EVENT_SPI:
        spi_event(m);
        break;
    case EVENT_ADC:
        adc_event(m);
        break;
    case EVENT_RADIO:
        wired_event(m);
        break;
    case EVENTS:
        break;
    }
}

static void do_events(struct f405 *m) {
    while (m->next_ps <= f405_now(m) && m->wants_reset == 0) {
        unsigned event = 0;
        while (m->at[event] != m->next_ps) {
            event++;
        }
        m->when = m->at[event];
        m->at[event] = F405_NEVER;
        do_event(m, (enum f405_event)event);
        find_next(m);
        f405_pump(m);
        m->when = F405_NEVER;
    }
}

// Time passes in which the core does nothing.
static void skip_to(struct f405 *m, uint64_t ps) {
    if (m->hclk_hz == 0) {
        m->base_ps = ps;
    } else {
        const uint64_t cycle = f405_cycle_at(m, ps);
        m->cycle = cycle > m->cycle ? cycle : m->cycle;
    }
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
        // A store is buffered: the core is past it when the bus refuses.
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

// Why libunicorn has stopped, and where.
static void serve_stop(struct f405 *m, uc_err error) {
    const uint32_t at = m->pc;
    m->pc = ask(m, UC_ARM_REG_PC);
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
        m->pc = at + 2;  // it has not been executed
        (void)core_sleep(m);
    } else {
        (void)core_sleep(m);  // WFI.W
    }
}

// One instruction by libunicorn. True: it is done, and the next may follow.
static bool ask_unicorn(struct f405 *m, uc_err *error) {
    struct f405_registers *x = &m->registers;
    const uint32_t at = m->pc;
    for_each_register(m, lend);
    m->is_lent = true;
    m->has_stepped = m->is_stopped = false;
    *error = uc_emu_start(m->uc, m->pc | 1, 0, 0, 0);
    m->is_lent = false;
#if UC_API_MAJOR > 2 || (UC_API_MAJOR == 2 && UC_API_MINOR >= 1)
    // It remembers that a store to that page was let through, and would ask for no
    // further one. Before 2.1 this call drops all code instead, and takes long.
    if (m->flash_control.has_stored) {
        (void)uc_ctl_flush_tlb(m->uc);
    }
#endif
    m->flash_control.has_stored = false;
    for_each_register(m, take_back);
    m->lent = *x;
    if (*error == UC_ERR_OK && m->fault == FAULT_NONE) {
        x->it = thumb_advance(x->it);
    }
    const bool is_done =
        *error == UC_ERR_OK && m->fault == FAULT_NONE && m->trap < 0 && m->is_stopped;
    if (m->has_stepped && m->watch.on_instruction != NULL) {
        m->watch.on_instruction(m->watch.context, at, m->pc);
    }
    m->is_stopped = false;
    return is_done;
}

static void execute(struct f405 *m, uint64_t target) {
    uc_err error = UC_ERR_OK;
    m->limit_cycle = f405_cycle_at(m, target);
    m->is_stopped = false;
    m->is_in_code = true;
    enum thumb end = thumb_run(m);
    while (end == THUMB_UNKNOWN && ask_unicorn(m, &error)) {
        end = thumb_run(m);
    }
    m->is_in_code = false;
    switch (end) {
    case THUMB_STOPPED:
        break;
    case THUMB_ASLEEP:
        (void)core_sleep(m);  // WFI
        break;
    case THUMB_RETURNS:
        core_return(m, m->pc | 1);
        break;
    case THUMB_UNKNOWN:
        serve_stop(m, error);
        break;
    }
}

static void sleep_until(struct f405 *m, uint64_t target) {
    if (!core_can_wake(m) && !m->iwdg.is_running) {
        f405_end(m, "sleeps with no interrupt enabled");
        return;
    }
    const uint64_t from = f405_now(m);
    const uint64_t from_cycle = m->cycle;
    skip_to(m, target);
    m->asleep += f405_now(m) - from;
    m->asleep_cycles += m->cycle - from_cycle;
}

// Asleep, and nobody wakes it. STOP mode waits for the flash (RM, "Stop mode").
static void go_on_sleeping(struct f405 *m, uint64_t target) {
    if (m->is_deep && !m->rcc.is_stopped && !m->flash_control.is_busy) {
        rcc_stop(m, true);
    }
    if (m->ended == NULL) {
        sleep_until(m, target);
    }
}

static void wake(struct f405 *m) {
    if (m->rcc.is_stopped) {
        const uint64_t from = f405_now(m);
        rcc_stop(m, false);
        m->asleep += f405_now(m) - from;
    }
    if (m->is_waiting) {
        m->core.has_event = false;
    }
    m->is_asleep = m->is_waiting = m->is_deep = false;
}

static void step(struct f405 *m, uint64_t target) {
    const struct f405_flash *flash = &m->flash_control;
    if (m->is_locked_up && !m->iwdg.is_running) {
        f405_end(m, "is locked up: a fault in the handler of faults");
    } else if ((m->hclk_hz == 0 && !m->rcc.is_stopped) || m->is_locked_up) {
        skip_to(m, target);
    } else if (flash->is_busy && f405_is_flash(m->pc)) {
        // Reading it waits until it is done (RM, "Read-while-write").
        skip_to(m, target < flash->busy_until ? target : flash->busy_until);
    } else if (m->is_asleep && !core_wakes(m)) {
        go_on_sleeping(m, target);
    } else {
        if (m->is_asleep) {
            wake(m);
        }
        if (!core_take(m)) {
            execute(m, target);
        }
    }
}

bool f405_run(struct f405 *m, uint64_t until_ps) {
    m->until = until_ps;
    while (m->ended == NULL) {
        do_events(m);
        if (m->wants_reset != 0) {
            do_reset(m, m->wants_reset);
        }
        if (f405_now(m) >= m->until || m->ended != NULL) {
            break;
        }
        step(m, m->next_ps < m->until ? m->next_ps : m->until);
    }
    return m->ended == NULL;
}

// Life

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
    for (unsigned i = 0; good && i < WINDOWS; i++) {
        window_ports[i] = (struct window_port){m, windows[i].base};
        good = uc_mmio_map(uc, windows[i].base, windows[i].size, on_read,
                           &window_ports[i], on_write, &window_ports[i]) == UC_ERR_OK;
    }
    return good;
}

// libunicorn takes any callback as void *, which C knows no conversion to.
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

// RM, "Device electronic signature"; DS, "Embedded reference voltage" and "Temperature
// sensor characteristics".
static void sign(struct f405 *m) {
    memset(m->system, 0xFF, F405_SYSTEM_SIZE);
    uint8_t *unique = m->system + 0xA10;
    for (unsigned i = 0; i < 12; i++) {
        unique[i] = (uint8_t)f405_random(m);
    }
    const uint16_t kilobytes = F405_FLASH_SIZE / 1024;
    const uint16_t calibration[3] = {
        1502,  // VREFINT: 1.21 V of 3.3 V
        943,   // 30 degC: 0.76 V + 5 * 2.5 mV, less what 12 bits leave
        1176,  // 110 degC
    };
    memcpy(m->system + 0xA22, &kilobytes, sizeof kilobytes);
    memcpy(m->system + 0xA2A, calibration, sizeof calibration);
}

bool f405_init(struct f405 *m, const struct f405_chip *chip, uint64_t seed) {
    memset(m, 0, sizeof *m);
    m->chip = chip;
    m->seed = seed * UINT64_C(0x9E3779B97F4A7C15) + UINT64_C(0x6A09E667F3BCC909);
    m->clock_start = m->when = F405_NEVER;
    m->stack.lowest = m->stack.top = F405_RAM;
    for (unsigned i = 0; i < EVENTS; i++) {
        m->at[i] = F405_NEVER;
    }
    m->flash = aligned_alloc(4096, F405_FLASH_SIZE);
    m->ram = aligned_alloc(4096, F405_RAM_SIZE);
    m->ccm = aligned_alloc(4096, F405_CCM_SIZE);
    m->system = aligned_alloc(4096, F405_SYSTEM_SIZE);
    if (m->flash == NULL || m->ram == NULL || m->ccm == NULL || m->system == NULL) {
        return false;
    }
    memset(m->flash, 0xFF, F405_FLASH_SIZE);
    sign(m);
    if (uc_open(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS, &m->uc) != UC_ERR_OK ||
        uc_ctl_set_cpu_model(m->uc, UC_CPU_ARM_CORTEX_M4) != UC_ERR_OK ||
        uc_ctl_exits_enable(m->uc) != UC_ERR_OK || !map_memory(m) || !add_hooks(m)) {
        return false;
    }
    for_each_register(m, take_back);
    m->lent = m->registers;
    return true;
}

void f405_free(struct f405 *m) {
    if (m->uc != NULL) {
        (void)uc_close(m->uc);
    }
    usart_free(m);
    free(m->flash);
    free(m->ram);
    free(m->ccm);
    free(m->system);
    memset(m, 0, sizeof *m);
}

// The unused part between variables and stack is one run of equal words: our paint, or
// the firmware's own where it paints too. What breaks the run is stack.
uint32_t f405_stack_deepest(struct f405 *m) {
    struct f405_stack *stack = &m->stack;
    const uint8_t *memory = f405_memory(m, stack->lowest, stack->top - stack->lowest);
    if (memory == NULL || stack->top <= stack->lowest) {
        return 0;
    }
    const uint32_t size = stack->top - stack->lowest;
    uint32_t at = 0;
    while (at < size && memcmp(memory + at, memory, 4) == 0) {
        at += 4;
    }
    stack->deepest = size - at > stack->deepest ? size - at : stack->deepest;
    return stack->deepest;
}
