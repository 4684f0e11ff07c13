// SPDX-License-Identifier: MIT
// Compares sim/f405/core/thumb*.c with libunicorn: every instruction of 16 bits and
// many of 32, each on random registers and memory, alone or in an IT block. An
// instruction that thumb*.c runs must leave the same state behind; those left to
// libunicorn are counted.
//
//   thumb_twin SEED CASES: CASES instructions of 32 bits; prints how many were run and
//   how many left, or the first difference
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "f405/f405.h"

enum {
    CODE = F405_RAM + 0x1000,
    DATA = F405_RAM + 0x8000,  // where registers and the stack point
    PAGE = 0x1000,
    BKPT = 0xBE00,
    IT = 0xBF08,  // a block of one instruction; condition in bits 4 to 7
    NZCV = 0xF,
    FPU_ACTIVE = 1 << 2,  // bit of CONTROL
};

static struct f405 machine;
static uc_engine *uc;
static uint8_t *memory, *other;  // libunicorn's RAM and CCM
static uint64_t state;
static uint64_t run, left;

// xorshift64*, Vigna 2016.
static uint32_t draw(void) {
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)((state * UINT64_C(0x2545F4914F6CDD1D)) >> 32);
}

// Pointers into DATA, small and negative numbers, and any from 2^31 on.
static uint32_t draw_value(void) {
    switch (draw() % 8) {
    case 0:
        return draw() % 64;
    case 1:
        return -(draw() % 64);
    case 2:
        return draw() | UINT32_C(0x80000000);
    case 3:
        return draw() & 0xFFFF;
    default:
        return DATA + (draw() % 0x1000) * (draw() % 4 == 0 ? 1 : 4);
    }
}

static const int registers[15] = {
    UC_ARM_REG_R0,  UC_ARM_REG_R1,  UC_ARM_REG_R2,  UC_ARM_REG_R3, UC_ARM_REG_R4,
    UC_ARM_REG_R5,  UC_ARM_REG_R6,  UC_ARM_REG_R7,  UC_ARM_REG_R8, UC_ARM_REG_R9,
    UC_ARM_REG_R10, UC_ARM_REG_R11, UC_ARM_REG_R12, UC_ARM_REG_SP, UC_ARM_REG_LR,
};

static void put_code(const uint16_t *words, unsigned count) {
    memcpy(machine.ram + (CODE - F405_RAM), words, 2 * count);
    memcpy(memory + (CODE - F405_RAM), words, 2 * count);
    (void)uc_ctl_remove_cache(uc, (uint64_t)CODE, (uint64_t)CODE + PAGE);
}

static void draw_state(uint32_t *flags) {
    struct f405_registers *x = &machine.registers;
    memset(x, 0, sizeof *x);
    for (unsigned i = 0; i < 15; i++) {
        x->r[i] = i == 13 ? DATA + 4 * (draw() % 0x400) : draw_value();
        (void)uc_reg_write(uc, registers[i], &x->r[i]);
    }
    *flags = draw() & NZCV;
    x->n = (*flags & 8) != 0;
    x->z = (*flags & 4) != 0;
    x->c = (*flags & 2) != 0;
    x->v = (*flags & 1) != 0;
    for (int i = 0; i < 32; i++) {
        x->s[i] = draw();
        (void)uc_reg_write(uc, UC_ARM_REG_S0 + i, &x->s[i]);
    }
    x->rest = UINT32_C(1) << 24;
    x->control = FPU_ACTIVE;
    const uint32_t xpsr = *flags << 28 | UINT32_C(1) << 24;
    const uint32_t zero = 0;
    (void)uc_reg_write(uc, UC_ARM_REG_XPSR, &xpsr);
    (void)uc_reg_write(uc, UC_ARM_REG_PRIMASK, &zero);
    (void)uc_reg_write(uc, UC_ARM_REG_CONTROL, &x->control);
    for (unsigned i = 0; i < 16; i++) {
        uint32_t *word =
            (uint32_t *)(void *)(machine.ram + (DATA - F405_RAM)) + draw() % 0x1000;
        *word = draw_value() | (draw() & 1);
    }
    memcpy(memory, machine.ram, F405_RAM_SIZE);
}

static void say(const uint16_t *words, unsigned count, const char *what, uint32_t ours,
                uint32_t theirs) {
    printf("code");
    for (unsigned i = 0; i < count; i++) {
        printf(" %04x", words[i]);
    }
    printf(": %s %08" PRIx32 ", libunicorn %08" PRIx32 "\n", what, ours, theirs);
    exit(1);
}

static uint32_t ask(int reg) {
    uint32_t value = 0;
    (void)uc_reg_read(uc, reg, &value);
    return value;
}

// Runs the instructions before the last word, which is a BKPT.
static void compare(const uint16_t *words, unsigned count, unsigned instructions) {
    uint32_t flags = 0;
    draw_state(&flags);
    put_code(words, count);
    const uint32_t end = CODE + 2 * (count - 1);
    machine.pc = CODE;
    machine.cycle = 0;
    machine.limit_cycle = instructions;
    machine.attention = 0;
    machine.is_stopped = false;
    machine.complaint = machine.ended = NULL;
    const enum thumb how = thumb_run(&machine);
    const bool is_through = machine.cycle == instructions || machine.pc == end;
    if (how == THUMB_UNKNOWN && !is_through) {
        left++;
        return;
    }
    const uc_err error = uc_emu_start(uc, CODE | 1, end, 0, instructions);
    // A jump to where no memory is: both are at its target.
    const bool is_away =
        machine.pc < F405_RAM || machine.pc >= F405_RAM + F405_RAM_SIZE;
    if (error != UC_ERR_OK && !is_away) {
        return;  // a load or store of a peripheral, which libunicorn does not have here
    }
    run++;
    for (unsigned i = 0; i < 15; i++) {
        // Bits 0 and 1 of SP are zero (ARM, "The ARM core registers"), but not in
        // libunicorn.
        const uint32_t theirs = ask(registers[i]) & (i == 13 ? ~UINT32_C(3) : ~0U);
        if (machine.registers.r[i] != theirs) {
            char name[8];
            (void)snprintf(name, sizeof name, "r%u", i);
            say(words, count, name, machine.registers.r[i], theirs);
        }
    }
    const struct f405_registers *x = &machine.registers;
    for (int i = 0; i < 32; i++) {
        if (x->s[i] != ask(UC_ARM_REG_S0 + i)) {
            say(words, count, "s", x->s[i], ask(UC_ARM_REG_S0 + i));
        }
    }
    const uint32_t ours = (uint32_t)x->n << 31 | (uint32_t)x->z << 30 |
                          (uint32_t)x->c << 29 | (uint32_t)x->v << 28 |
                          (x->rest & UINT32_C(1) << 27);
    const uint32_t theirs = ask(UC_ARM_REG_XPSR) & UINT32_C(0xF8000000);
    if (ours != theirs) {
        say(words, count, "flags", ours, theirs);
    }
    if (machine.pc != (ask(UC_ARM_REG_PC) & ~UINT32_C(1))) {
        say(words, count, "pc", machine.pc, ask(UC_ARM_REG_PC));
    }
    if (x->primask != ask(UC_ARM_REG_PRIMASK)) {
        say(words, count, "primask", x->primask, ask(UC_ARM_REG_PRIMASK));
    }
    const int apart = memcmp(machine.ram, memory, F405_RAM_SIZE);
    if (apart != 0) {
        say(words, count, "memory", 1, 0);
    }
}

static void compare_short(uint16_t word) {
    const uint16_t alone[] = {word, BKPT};
    compare(alone, 2, 1);
    // A block must not contain branches, IT or changes of masks (ARM, IT).
    const bool may_be_conditional = (word & 0xF500) != 0xB100 && word >> 12 != 0xD &&
                                    word >> 11 != 0x1C && (word & 0xFFE0) != 0xB660 &&
                                    (word & 0xFF00) != 0xBF00;
    if (may_be_conditional) {
        const uint16_t condition = (uint16_t)(draw() % 14 << 4);
        const uint16_t block[] = {(uint16_t)(IT | condition), word, BKPT};
        compare(block, 3, 2);
    }
}

static void compare_long(void) {
    // Defined first halves; the bits that are open are random.
    static const struct {
        uint16_t value, open, second, open_second;
    } kinds[] = {
        {0xE800, 0x01FF, 0x0000, 0xFFFF},  // multiple, double, table branches
        {0xE8D0, 0x000F, 0xF000, 0x001F},
        {0xEA00, 0x01FF, 0x0000, 0x7FFF},  // shifted registers
        {0xF000, 0x07FF, 0x0000, 0x7FFF},  // immediates
        {0xF000, 0x07FF, 0x8000, 0x7FFF},  // branches, masks
        {0xF3EF, 0x0000, 0x8000, 0x0FFF},
        {0xF800, 0x01FF, 0x0000, 0xFFFF},  // loads and stores
        {0xF800, 0x017F, 0x0800, 0xF7FF},
        {0xF800, 0x017F, 0x0000, 0xF03F},
        {0xFA00, 0x00FF, 0xF000, 0x0FFF},  // registers
        {0xFB00, 0x007F, 0x0000, 0xFFFF},  // products
        {0xFB80, 0x007F, 0x0000, 0xFFFF},
        {0xFB90, 0x002F, 0xF0F0, 0x0F0F},
        {0xEC00, 0x01FF, 0x0A00, 0xF13F},  // registers of the FPU
        {0xEE00, 0x001F, 0x0A10, 0xF080},
    };
    const unsigned kind = draw() % (sizeof kinds / sizeof *kinds);
    const uint16_t words[] = {
        (uint16_t)(kinds[kind].value | (draw() & kinds[kind].open)),
        (uint16_t)(kinds[kind].second | (draw() & kinds[kind].open_second)),
        BKPT,
    };
    compare(words, 3, 1);
}

static uint8_t *room(size_t size) {
    uint8_t *bytes = aligned_alloc(PAGE, size);
    return bytes == NULL ? NULL : memset(bytes, 0, size);
}

static bool map(uint32_t address, uint32_t size, uint32_t access, uint8_t *bytes) {
    return bytes != NULL &&
           uc_mem_map_ptr(uc, address, size, access, bytes) == UC_ERR_OK;
}

static bool set_up(void) {
    const uint32_t code = UC_PROT_READ | UC_PROT_EXEC;
    const uint32_t data = UC_PROT_READ | UC_PROT_WRITE;
    machine.core.cpacr = UINT32_C(0xF) << 20;
    machine.is_in_code = true;  // a peripheral can't request a reset
    machine.ram = room(F405_RAM_SIZE);
    machine.flash = room(F405_FLASH_SIZE);
    machine.ccm = room(F405_CCM_SIZE);
    memory = room(F405_RAM_SIZE);
    other = room(F405_CCM_SIZE);
    return machine.ram != NULL && machine.ccm != NULL &&
           uc_open(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS, &uc) == UC_ERR_OK &&
           uc_ctl_set_cpu_model(uc, UC_CPU_ARM_CORTEX_M4) == UC_ERR_OK &&
           map(F405_RAM, F405_RAM_SIZE, UC_PROT_ALL, memory) &&
           map(F405_CCM, F405_CCM_SIZE, data, other) &&
           map(F405_FLASH, F405_FLASH_SIZE, code, machine.flash) &&
           map(0, F405_FLASH_SIZE, code, machine.flash);
}

int main(int argc, char **argv) {
    if (argc != 3) {
        return 2;
    }
    state = strtoull(argv[1], NULL, 10) * UINT64_C(0x9E3779B97F4A7C15) + 1;
    const uint64_t cases = strtoull(argv[2], NULL, 10);
    if (!set_up()) {
        return 2;
    }
    for (unsigned word = 0; word < 0xE800; word++) {
        compare_short((uint16_t)word);
    }
    printf("short: run %" PRIu64 " left %" PRIu64 "\n", run, left);
    run = left = 0;
    for (uint64_t i = 0; i < cases; i++) {
        compare_long();
    }
    printf("long: run %" PRIu64 " left %" PRIu64 "\n", run, left);
    return 0;
}
