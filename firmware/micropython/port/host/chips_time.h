// SPDX-License-Identifier: MIT
// The time of modelled chips, which is the port's clock while there are any.
#ifndef HOST_CHIPS_TIME_H
#define HOST_CHIPS_TIME_H

#include <stdbool.h>
#include <stdint.h>

// False where there is no chip.
bool chips_time_us(uint64_t *us);

#endif
