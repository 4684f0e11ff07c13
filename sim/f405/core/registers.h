// SPDX-License-Identifier: MIT
// The registers that instructions work on. They are kept here and lent to libunicorn
// while it executes an instruction.
#ifndef SIM_F405_CORE_REGISTERS_H
#define SIM_F405_CORE_REGISTERS_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

// `rest` is XPSR without N, Z, C, V and the IT state.
struct f405_registers {
    uint32_t r[15];  // R0 to LR
    bool n, z, c, v;
    uint8_t it;
    uint32_t rest, primask, faultmask, basepri, control, fpscr;
    uint32_t s[32];
};

// By libunicorn's name, UC_ARM_REG_...
uint32_t f405_get(const struct f405 *m, int reg);
void f405_set(struct f405 *m, int reg, uint32_t value);
uint32_t f405_sp(const struct f405 *m);

// Between ours and libunicorn's: all but PC.
void registers_lend(struct f405 *m);
void registers_take_back(struct f405 *m);

#endif
