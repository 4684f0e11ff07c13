// SPDX-License-Identifier: MIT
// The wire: USB while a program has its port open, UART0 otherwise.
#ifndef WIRE_H
#define WIRE_H

void wire_init(void);

#endif
