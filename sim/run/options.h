// SPDX-License-Identifier: MIT
// The options of a run, as the command line has them.
#ifndef SIM_RUN_OPTIONS_H
#define SIM_RUN_OPTIONS_H

#include "run.h"

// Reads the arguments. 0 to continue, else the exit code plus 1.
int run_parse_options(struct run *run, char **rest);
// The value of a hexadecimal digit, or -1.
int run_hex_digit(char digit);

#endif
