// SPDX-License-Identifier: MIT
// Start-up of the watchdog.
#ifndef RESET_H
#define RESET_H

// Settles the cause of this start and turns the watchdog on.
void reset_init(void);

#endif
