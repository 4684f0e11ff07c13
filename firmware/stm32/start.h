// SPDX-License-Identifier: MIT
// Where the linker has put things, and what start.c does before main.
#ifndef START_H
#define START_H

#include <stdint.h>

#define STACK_PAINT UINT32_C(0xC5C5C5C5)  // a word that the stack has not reached

// stm32f405.ld: places ...
extern uint8_t data_start[], bss_start[];
extern const uint8_t data_load[];
extern uint32_t stack_bottom[], stack_top[];
// ... and numbers of bytes, each the address of its name.
extern const uint8_t data_size[], bss_size[], stack_size[];

// The reset vector: starts the device clock, makes memory ready, calls main.
_Noreturn void start_reset(void);

#endif
