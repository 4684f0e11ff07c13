// SPDX-License-Identifier: MIT
// The wire to the host.
#ifndef UART_H
#define UART_H

// 500 kbaud, 8 bits, no parity, one stop bit; receiving.
void uart_init(void);

#endif
