// SPDX-License-Identifier: MIT
// Whether an interrupt has brought work for the main loop.
#ifndef IDLE_H
#define IDLE_H

#include <stdbool.h>

extern volatile bool idle_has_work;

#endif
