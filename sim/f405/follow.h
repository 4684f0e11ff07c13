// SPDX-License-Identifier: MIT
// Tells a profile what the virtual STM32F405 does.
#ifndef SIM_F405_FOLLOW_H
#define SIM_F405_FOLLOW_H

#include "../profile.h"
#include "f405.h"

struct f405_follow {
    struct profile *profile;
    struct f405 *machine;
};

// Watches the machine, in which the image has been loaded; it runs slower then, and the
// same to the instruction.
void f405_follow_begin(struct f405_follow *follow);
struct profile_time f405_follow_time(const struct f405 *m);

#endif
