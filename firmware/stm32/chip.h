// SPDX-License-Identifier: MIT
// The sensor that is soldered to this board, beyond what board.h asks for.
#ifndef CHIP_H
#define CHIP_H

#include <stdbool.h>

// Stops it, before the board sleeps. Not while it is sampled.
bool chip_power_down(void);

#endif
