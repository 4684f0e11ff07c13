// SPDX-License-Identifier: MIT
// Tells a profile what the virtual ATmega328P does.
#ifndef SIM_FOLLOW_H
#define SIM_FOLLOW_H

#include "machine.h"
#include "profile.h"

struct follow {
    struct profile *profile;
    struct machine *machine;
};

enum { FOLLOW_FLASH_BYTES = 32768 };

// Watches the machine, in which the image has been loaded, once the profile has its
// parts. It runs slower then, and the same to the cycle.
void follow_begin(struct follow *follow);
struct profile_time follow_time(const struct machine *machine);

#endif
