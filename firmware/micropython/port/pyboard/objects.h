// SPDX-License-Identifier: MIT
// The parts of the module machine, one file each.
#ifndef PYBOARD_OBJECTS_H
#define PYBOARD_OBJECTS_H

#include "py/obj.h"

extern const mp_obj_type_t pyboard_pin_type;
extern const mp_obj_type_t pyboard_i2c_type;
extern const mp_obj_type_t pyboard_uart_type;
extern const mp_obj_type_t pyboard_adc_type;

// Interrupts: an edge of a pin; an event of the I2C.
void pins_edge(void);
void bus_event(void);

// Before MicroPython starts over: its objects are gone.
void pins_forget(void);

// The wire, which is MicroPython's console until machine.UART has it.
enum { WIRE_BAUD = 921600 };
void wire_open(uint32_t baud);

#endif
