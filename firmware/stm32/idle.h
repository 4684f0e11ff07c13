// SPDX-License-Identifier: MIT
// How interrupt handlers end the sleep of the main loop.
#ifndef IDLE_H
#define IDLE_H

#include <stdbool.h>

// Set by handlers that bring work to the main loop, cleared by board_idle.
extern volatile bool idle_has_work;

#endif
