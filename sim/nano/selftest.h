// SPDX-License-Identifier: MIT
// Checks that the machine follows the data sheet where libsimavr does not.
#ifndef SIM_NANO_SELFTEST_H
#define SIM_NANO_SELFTEST_H

// Prints a line a check. 0: all pass; 1: one fails; 2: no such name. With the name of a
// correction, runs that check alone with the correction left out.
int selftest_run(const char *without);

#endif
