// SPDX-License-Identifier: MIT
// Reads a peripheral that the virtual STM32F405 does not model: CAN1.
#include "bare.h"

void program(void) {
    say("before", 1);
    flush();
    say("after", AT(0x40006404));
}
