// SPDX-License-Identifier: MIT
// USART2 with its flow control, a ring for each direction. What is at its other end is
// radio.h's business.
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

// 8 bits, no parity, one stop bit; receiving. CTS, where it is high, holds what is to
// be sent; left open it is low.
void uart_init(uint32_t baud);

// Once what is sent has left, or is forgotten: a byte under way is torn.
void uart_set_baud(uint32_t baud);

// While held, what is to be sent stays in its ring.
void uart_hold(bool is_held);
// Forgets what has not left. A byte or two may be in the hardware and leave yet.
void uart_forget(void);

// Takes all `length` bytes or, where there is no room, none.
bool uart_send(const uint8_t *bytes, uint8_t length);
// Everything was sent, or CTS has blocked it for 0.5 s of calls: it may never be sent.
bool uart_is_idle(void);
// The next received byte, or -1.
int16_t uart_receive(void);
// Received bytes lost since reset for want of room.
uint16_t uart_receive_lost(void);

void uart_sent(void);      // DMA1 stream 6: a piece has been handed to the USART
void uart_received(void);  // DMA1 stream 5: half a ring; USART2: the line is idle

#endif
