// SPDX-License-Identifier: MIT
// Why the board started, how to start it again, and the watchdogs.
#ifndef RESET_H
#define RESET_H

#include <stdbool.h>
#include <stdint.h>

// The record of a crashed program, in memory that a reset does not clear.
// It stays for a debugger (print reset_record) until the next one overwrites it.
struct reset_record {
    uint32_t mark;  // which kind; nothing once it has been told
    uint32_t pc, lr, psr;
    uint32_t cfsr, hfsr;  // PM0214, "Fault status registers"
    uint32_t address;     // that a faulty access was for, where cfsr says it is valid
};
extern struct reset_record reset_record;

// Settles the cause of this start; power_start() says whether the board has slept.
void reset_init(bool has_slept);

// From now on the main loop must kick.
void reset_watch(void);

_Noreturn void reset_now(void);

// Exceptions: hard fault, and SysTick, which wakes the main loop and sees whether it
// still runs.
void reset_fault(void);
void reset_tick(void);

#endif
