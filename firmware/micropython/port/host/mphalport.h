// SPDX-License-Identifier: MIT
// What MicroPython requires of a port in addition to py/mphal.h.
#include "shared/runtime/interrupt_char.h"

// No virtual pins.
#define mp_hal_pin_obj_t mp_obj_t
