// SPDX-License-Identifier: MIT
// The wire to the host.
#ifndef UART_H
#define UART_H

// 921,600 baud, 8 bits, no parity, one stop bit; receiving.
void uart_init(void);

void uart_sent(void);      // DMA1 stream 6: a piece has been handed to the USART
void uart_received(void);  // DMA1 stream 5: half a ring; USART2: the line is idle

#endif
