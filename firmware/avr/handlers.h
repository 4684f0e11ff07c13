// SPDX-License-Identifier: MIT
// Shared by the interrupt handlers of handlers.S and the C around them: places of
// members for the assembler, and the variables themselves.
#ifndef HANDLERS_H
#define HANDLERS_H

// In struct sampling, and of its `slots`.
#define SAMPLING_FILLED 0
#define SAMPLING_TAKEN 1
#define SAMPLING_IS_RUNNING 2
#define SAMPLING_FAILURE 4
#define SAMPLING_MISSED 5
#define SAMPLING_IS_WRITE 7
#define SAMPLING_REMAINING 8
#define SAMPLING_CURSOR 9
#define SAMPLING_BEGUN 11
#define SAMPLING_ADDRESS 13
#define SAMPLING_REG 14
#define SAMPLING_LENGTH 15
#define SAMPLING_READY 16
// With SAMPLING_TWO_BURSTS.
#define SAMPLING_SECOND_ADDRESS 21
#define SAMPLING_SECOND_REG 22
#define SAMPLING_SECOND_LENGTH 23
#define SAMPLING_IS_SECOND 24

// In a reading.
#define READING_SIZE 30
#define READING_TIME 24

#define FAILURE_NACK 0xFF
#define FAILURE_STUCK 0xFD

// 3.8 ms on the wire: a sample's pose and raw, 98 bytes, with a status or a hello of at
// most 90.
#define SENDING_SIZE 192
// A power of two; 1.3 ms on the wire, four commands.
#define RECEIVED_SIZE 64
#define UART_ENABLED (_BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0))

#ifndef __ASSEMBLER__

#include <stdbool.h>
#include <stdint.h>

#include "generic/slots.h"

struct sampling {
    struct slots slots;
    bool is_write;      // of set-up: the bytes go to the device
    uint8_t remaining;  // bytes of the transfer still to come
    uint8_t *cursor;    // where the next byte goes, or comes from
    uint16_t begun;     // ticks
    struct bus_burst burst;
    uint32_t ready;  // data-ready edges
    uint8_t carry;   // of `ready`, after 248 days
#ifdef SAMPLING_TWO_BURSTS
    struct bus_burst second;  // follows `burst`; of length 0: none does
    bool is_second;           // is on the bus
#endif
};
extern struct sampling sampling;
enum { READING_SLOTS = 2 };
extern struct reading sampling_readings[READING_SLOTS];

// Starts a transfer from or to `bytes` as sampling.burst has it. Interrupts must be
// off.
void sampling_begin(uint8_t *bytes);

extern uint8_t uart_sending[SENDING_SIZE];
extern volatile uint8_t uart_sending_head;
extern volatile uint8_t uart_sending_tail;
extern uint8_t uart_received[RECEIVED_SIZE];
extern volatile uint8_t uart_received_head;
extern volatile uint8_t uart_received_tail;
extern volatile uint16_t uart_received_lost;

#endif
#endif
