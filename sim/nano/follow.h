// SPDX-License-Identifier: MIT
// Reports the virtual processor's calls, returns and interrupts to a profile.
#ifndef SIM_NANO_FOLLOW_H
#define SIM_NANO_FOLLOW_H

#include "machine.h"
#include "run/profile.h"

struct follow {
    struct profile *profile;
    struct machine *machine;
};

// Starts reporting; the image has to be loaded. The machine runs slower then, but the
// same to the cycle.
void follow_begin(struct follow *follow);
struct profile_time follow_time(const struct machine *machine);

#endif
