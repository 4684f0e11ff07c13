// SPDX-License-Identifier: MIT
// The wire: a ring for each direction, filled and emptied by interrupt (handlers.S).
#include "uart.h"

#include <avr/io.h>
#include <util/atomic.h>

#include "../board.h"
#include "handlers.h"

typedef uint8_t ring_index;
#include "generic/ring.h"

enum {
    // F_CPU / (8 * (UBRR + 1)) = 500 kbaud at double speed, without error ("Baud Rate
    // Generation").
    BAUD = 3,
};
_Static_assert(RECEIVED_SIZE % 2 == 0 && (RECEIVED_SIZE & (RECEIVED_SIZE - 1)) == 0,
               "its places are masked");

// The main loop writes `*_head` of sending and `*_tail` of received, the handlers the
// others; each is one byte.
uint8_t uart_sending[SENDING_SIZE];
volatile uint8_t uart_sending_head;
volatile uint8_t uart_sending_tail;
static bool has_sent;

uint8_t uart_received[RECEIVED_SIZE];
volatile uint8_t uart_received_head;
volatile uint8_t uart_received_tail;
volatile uint16_t uart_received_lost;

void uart_init(void) {
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = BAUD;
    UCSR0B = UART_ENABLED;
}

bool board_send(const uint8_t *bytes, uint8_t length) {
    uint8_t head = uart_sending_head;
    if (length > ring_room(SENDING_SIZE, head, uart_sending_tail)) {
        return false;
    }
    if (length == 0) {
        return true;
    }
    for (; length > 0; length--) {
        uart_sending[head++] = *bytes++;
        if (head == SENDING_SIZE) {
            head = 0;
        }
    }
    // Together, or the handler may empty the ring in between and then be called again.
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        uart_sending_head = head;
        UCSR0B = UART_ENABLED | _BV(UDRIE0);
    }
    has_sent = true;
    return true;
}

bool board_send_is_idle(void) {
    bool is_idle;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        is_idle = uart_sending_head == uart_sending_tail &&
                  (!has_sent || (UCSR0A & _BV(TXC0)) != 0);
    }
    return is_idle;
}

int16_t board_receive(void) {
    const uint8_t tail = uart_received_tail;
    if (tail == uart_received_head) {
        return -1;
    }
    const uint8_t byte = uart_received[tail % RECEIVED_SIZE];
    uart_received_tail = (uint8_t)(tail + 1);
    return byte;
}

uint16_t board_receive_lost(void) {
    uint16_t lost;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        lost = uart_received_lost;
    }
    return lost;
}
