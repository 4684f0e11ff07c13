// SPDX-License-Identifier: MIT
// What start.S leaves for C. Read by the assembler too.
#ifndef START_H
#define START_H

#define STACK_PAINT 0xC5     // a byte that the stack has not reached
#define START_SOFTWARE 0x10  // the protocol's flag, which is no flag of MCUSR
#define START_ASKED 0xB007   // a number that memory is unlikely to hold by itself
#define START_500_MS 0x05    // WDP2 and WDP0

#ifndef __ASSEMBLER__
#include <stdint.h>

// Why the board started, as the protocol numbers it; 0 where that is not known.
extern uint8_t start_reset_cause;
// START_ASKED before a start that was asked for. Outlives a reset.
extern uint16_t start_asked;
#endif

#endif
