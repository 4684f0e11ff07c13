// SPDX-License-Identifier: MIT
// Reports the virtual STM32F405's calls, returns and exceptions to a profile.
#ifndef SIM_F405_FOLLOW_H
#define SIM_F405_FOLLOW_H

#include "f405.h"
#include "run/profile.h"

struct f405_follow {
    struct profile *profile;
    struct f405 *machine;
};

// Starts reporting; the image has to be loaded. The machine runs slower then, but the
// same to the instruction.
void f405_follow_begin(struct f405_follow *follow);
struct profile_time f405_follow_time(const struct f405 *m);

#endif
