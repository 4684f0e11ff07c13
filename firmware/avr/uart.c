// SPDX-License-Identifier: MIT
// The wire: a ring for each direction, filled and emptied by interrupt.
#include "uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "../board.h"
#include "idle.h"

typedef uint8_t ring_index;
#include "generic/ring.h"

enum {
    // F_CPU / (8 * (UBRR + 1)) = 500 kbaud at double speed, without error ("Baud Rate
    // Generation").
    BAUD = 3,
    // 3.8 ms on the wire: a sample's pose and raw, 98 bytes, with a status or a hello
    // of at most 90.
    SENDING_SIZE = 192,
    RECEIVED_SIZE = 64,  // power of two; 1.3 ms on the wire, four commands
    ENABLED = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0),
};

// The main loop writes `*_head` of sending and `*_tail` of received, the handlers the
// others; each is one byte.
static uint8_t sending[SENDING_SIZE];
static volatile uint8_t sending_head;
static volatile uint8_t sending_tail;
static bool has_sent;

static uint8_t received[RECEIVED_SIZE];
static volatile uint8_t received_head;
static volatile uint8_t received_tail;
static volatile uint16_t received_lost;

void uart_init(void) {
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = BAUD;
    UCSR0B = ENABLED;
}

ISR(USART_UDRE_vect) {
    const uint8_t tail = sending_tail;
    UDR0 = sending[tail];
    UCSR0A = _BV(U2X0) | _BV(TXC0);  // clears TXC0: it is set when this byte has left
    const uint8_t next = tail == SENDING_SIZE - 1 ? 0 : (uint8_t)(tail + 1);
    sending_tail = next;
    if (next == sending_head) {
        UCSR0B = ENABLED;
    }
}

ISR(USART_RX_vect) {
    const bool is_overrun = (UCSR0A & _BV(DOR0)) != 0;  // valid until UDR0 is read
    const uint8_t byte = UDR0;
    const uint8_t head = received_head;
    if (is_overrun) {
        received_lost++;
    }
    if ((uint8_t)(head - received_tail) == RECEIVED_SIZE) {
        received_lost++;
        return;
    }
    received[head % RECEIVED_SIZE] = byte;
    received_head = (uint8_t)(head + 1);
    idle_has_work = true;
}

bool board_send(const uint8_t *bytes, uint8_t length) {
    if (length > ring_room(SENDING_SIZE, sending_head, sending_tail)) {
        return false;
    }
    if (length == 0) {
        return true;
    }
    const uint8_t head = ring_write(sending, SENDING_SIZE, sending_head, bytes, length);
    // Together, or the handler may empty the ring in between and then be called again.
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        sending_head = head;
        UCSR0B = ENABLED | _BV(UDRIE0);
    }
    has_sent = true;
    return true;
}

bool board_send_is_idle(void) {
    bool is_idle;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        is_idle =
            sending_head == sending_tail && (!has_sent || (UCSR0A & _BV(TXC0)) != 0);
    }
    return is_idle;
}

int16_t board_receive(void) {
    const uint8_t tail = received_tail;
    if (tail == received_head) {
        return -1;
    }
    const uint8_t byte = received[tail % RECEIVED_SIZE];
    received_tail = (uint8_t)(tail + 1);
    return byte;
}

uint16_t board_receive_lost(void) {
    uint16_t lost;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        lost = received_lost;
    }
    return lost;
}
