// SPDX-License-Identifier: MIT
// A bootloader in flash, with the fuses of a board as sold: a Nano's resets start at
// 0x7800 (ATmega328P, table 27-7), a Mega's at 0x3E000 (ATmega2560, table 29-7).
#ifndef SIM_NANO_BOOTLOADER_H
#define SIM_NANO_BOOTLOADER_H

#include "machine.h"

// Flashes the Intel HEX file and has this and each later start begin with it. Null, or
// the error of the file.
const char *bootloader_load(struct machine *machine, const char *path);

#endif
