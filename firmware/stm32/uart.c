// SPDX-License-Identifier: MIT
// The wire: a ring for each direction, filled and emptied by DMA.
#include "uart.h"

#include <string.h>

#include "../board.h"
#include "cpu.h"
#include "idle.h"
#include "pins.h"

enum {
    BAUD = 921600,
    // "Fractional baud rate generation", oversampling by 16: APB1 / 46 is 913,043 baud,
    // 0.93 % slow; a receiver bears 3 % and more.
    BRR = (APB1_HZ + BAUD / 2) / BAUD,
    CHANNEL = 4,           // "DMA1 request mapping": USART2, both ways
    SENDING_SIZE = 2048,   // 22 ms on the wire
    RECEIVED_SIZE = 1024,  // 11 ms
};

_Static_assert(BRR == 46, "as the comment says");

static struct dma_stream *const to_wire = &DMA1->stream[6];
static struct dma_stream *const from_wire = &DMA1->stream[5];

// DMA does not reach the CCM: these are in the RAM that it does reach.
static uint8_t sending[SENDING_SIZE];
static volatile uint16_t sending_head;  // written by the main loop
static volatile uint16_t sending_tail;  // by the handler
static uint16_t in_flight;  // bytes from the tail on that DMA is at; 0: it is at rest

static volatile uint8_t received[RECEIVED_SIZE];
static uint32_t received_total;  // bytes since start
static uint32_t taken_total;
static uint16_t lost;

void uart_init(void) {
    to_wire->par = (uint32_t)(uintptr_t)&USART2->dr;
    from_wire->par = to_wire->par;
    from_wire->m0ar = (uint32_t)(uintptr_t)received;
    from_wire->ndtr = RECEIVED_SIZE;
    from_wire->cr = DMA_CR_CHANNEL(CHANNEL) | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_HTIE |
                    DMA_CR_TCIE | DMA_CR_EN;
    USART2->brr = BRR;
    USART2->cr3 = USART_CR3_DMAR | USART_CR3_DMAT | USART_CR3_EIE;
    USART2->cr1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_IDLEIE;
    irq_enable(IRQ_DMA1_STREAM5, PRIORITY_WIRE);
    irq_enable(IRQ_DMA1_STREAM6, PRIORITY_WIRE);
    irq_enable(IRQ_USART2, PRIORITY_WIRE);
}

// Hands DMA what lies in one piece from the tail on. Interrupts are off, or this is the
// handler.
static void send_next(void) {
    const uint16_t head = sending_head;
    const uint16_t tail = sending_tail;
    in_flight = (uint16_t)((head >= tail ? head : SENDING_SIZE) - tail);
    if (in_flight == 0) {
        return;
    }
    DMA1->hifcr = DMA_HIGH_FLAGS_6;
    USART2->sr = (uint16_t)~USART_SR_TC;  // "Continuous communication using DMA"
    to_wire->m0ar = (uint32_t)(uintptr_t)(sending + tail);
    to_wire->ndtr = in_flight;
    cpu_barrier();  // the bytes are in memory before DMA looks
    to_wire->cr = DMA_CR_CHANNEL(CHANNEL) | DMA_CR_MINC | DMA_CR_TO_PERIPHERAL |
                  DMA_CR_TCIE | DMA_CR_EN;
}

void uart_sent(void) {
    DMA1->hifcr = DMA_HIGH_FLAGS_6;
    sending_tail = (uint16_t)((sending_tail + in_flight) % SENDING_SIZE);
    send_next();
}

bool board_send(const uint8_t *bytes, uint8_t length) {
    const uint16_t head = sending_head;
    // One stays free, or a full ring would look empty.
    const uint16_t used = (uint16_t)((head - sending_tail) & (SENDING_SIZE - 1));
    if (length > SENDING_SIZE - 1 - used) {
        return false;
    }
    const uint16_t to_end = (uint16_t)(SENDING_SIZE - head);
    const uint16_t first = length < to_end ? length : to_end;
    memcpy(sending + head, bytes, first);
    memcpy(sending, bytes + first, (uint16_t)(length - first));
    const uint32_t primask = cpu_mask();
    sending_head = (uint16_t)((head + length) % SENDING_SIZE);
    if (in_flight == 0) {
        send_next();
    }
    cpu_unmask(primask);
    return true;
}

bool board_send_is_idle(void) {
    const uint32_t primask = cpu_mask();
    const bool is_idle = in_flight == 0 && (USART2->sr & USART_SR_TC) != 0;
    cpu_unmask(primask);
    return is_idle;
}

// Called twice a ring at least, by the DMA's interrupts, so that the distance from the
// last time is known. Interrupts are off, or this is the handler.
static void look_at_ring(void) {
    const uint32_t at = RECEIVED_SIZE - from_wire->ndtr;
    received_total += (at - received_total) % RECEIVED_SIZE;
    if (received_total - taken_total > RECEIVED_SIZE) {
        const uint32_t over = received_total - taken_total - RECEIVED_SIZE;
        lost = (uint16_t)(lost + over);
        taken_total += over;
    }
}

void uart_received(void) {
    DMA1->hifcr = DMA_HIGH_FLAGS_5;
    // Reading DR after SR clears the line's flags; DMA has taken the byte long since.
    const uint32_t flags = USART2->sr;
    if ((flags & (USART_SR_IDLE | USART_SR_ORE | USART_SR_NF | USART_SR_FE)) != 0) {
        (void)USART2->dr;
        if ((flags & USART_SR_ORE) != 0) {
            lost++;
        }
    }
    look_at_ring();
    idle_has_work = true;
}

int16_t board_receive(void) {
    int16_t byte = -1;
    const uint32_t primask = cpu_mask();
    look_at_ring();
    if (taken_total != received_total) {
        byte = received[taken_total % RECEIVED_SIZE];
        taken_total++;
    }
    cpu_unmask(primask);
    return byte;
}

uint16_t board_receive_lost(void) {
    return lost;
}
