// SPDX-License-Identifier: MIT
// Reads what the virtual STM32F405 has no model of: CAN1.
#include "bare.h"

void program(void) {
    say("before", 1);
    flush();
    say("after", AT(0x40006404));
}
