// SPDX-License-Identifier: MIT
// Why the board last started, and what makes it start again when the program hangs.
#ifndef RESET_H
#define RESET_H

// Reads the cause; call it first.
void reset_init(void);

// Starts both watchdogs.
void reset_watch(void);

#endif
