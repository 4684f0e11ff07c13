// SPDX-License-Identifier: MIT
// What start.S leaves for C. Read by the assembler too.
#ifndef START_H
#define START_H

#define STACK_PAINT 0xC5  // a byte that the stack has not reached

#ifndef __ASSEMBLER__
#include <stdint.h>

extern uint8_t start_reset_flags;  // MCUSR as the reset left it
#endif

#endif
