// SPDX-License-Identifier: MIT
// A bootloader in the flash of the virtual Nano, with the fuses of a Nano as sold: high
// 0xDA, so resets start at 0x7800 (data sheet, table 27-7).
#ifndef SIM_NANO_BOOTLOADER_H
#define SIM_NANO_BOOTLOADER_H

#include "machine.h"

enum { BOOTLOADER_START = 0x7800 };

// Flashes the Intel HEX file and has this and each later start begin with it. Null, or
// what is wrong with the file.
const char *bootloader_load(struct machine *machine, const char *path);

#endif
