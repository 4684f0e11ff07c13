// SPDX-License-Identifier: MIT
// A ring for each direction, filled and emptied by DMA, which the hardware's flow
// control holds.
#include "uart.h"

#include "clock.h"
#include "cpu.h"
#include "gpio.h"
#include "idle.h"
#include "pins.h"

typedef uint16_t ring_index;
#include "generic/ring.h"

enum {
    CHANNEL = 4,  // "DMA1 request mapping": USART2, both ways
    // 0.18 s on the wire. A radio that is busy with itself holds CTS now and then.
    SENDING_SIZE = 16384,
    RECEIVED_SIZE = 1024,  // 11 ms
    HELD_US = 500000,
    STOP_TURNS_MAX = 1000,  // a DMA stream stops after the byte under way
};

// "Fractional baud rate generation", oversampling by 16. For 921,600 baud APB1 / 46 is
// 913,043, 0.93 % slow; a receiver bears 3 % and more.
#define BRR(baud) ((APB1_HZ + (baud) / 2) / (baud))
_Static_assert(BRR(921600) == 46, "as the comment says");

static struct dma_stream *const to_wire = &DMA1->stream[6];
static struct dma_stream *const from_wire = &DMA1->stream[5];

// DMA does not reach the CCM: these are in the RAM that it does reach.
static uint8_t sending[SENDING_SIZE];
static volatile uint16_t sending_head;  // written by the main loop
static volatile uint16_t sending_tail;  // by the handler
static uint16_t in_flight;  // bytes from the tail on that DMA is at; 0: it is at rest
static volatile bool is_held;
static uint32_t stood_at, stood_since_us;  // the place that DMA was at when last asked

static volatile uint8_t received[RECEIVED_SIZE];
static uint32_t received_total;  // bytes since start
static uint32_t taken_total;
static uint16_t lost;

void uart_init(uint32_t baud) {
    GPIOA->afr[0] |= (uint32_t)ALTERNATE_USART2 << (4 * PIN_CTS) |
                     (uint32_t)ALTERNATE_USART2 << (4 * PIN_RTS);
    gpio_set_pull(GPIOA, PIN_CTS, GPIO_PULL_DOWN);
    gpio_set_mode(GPIOA, PIN_CTS, GPIO_ALTERNATE);
    gpio_set_mode(GPIOA, PIN_RTS, GPIO_ALTERNATE);
    to_wire->par = (uint32_t)(uintptr_t)&USART2->dr;
    from_wire->par = to_wire->par;
    from_wire->m0ar = (uint32_t)(uintptr_t)received;
    from_wire->ndtr = RECEIVED_SIZE;
    from_wire->cr = DMA_CR_CHANNEL(CHANNEL) | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_HTIE |
                    DMA_CR_TCIE | DMA_CR_EN;
    USART2->brr = BRR(baud);
    USART2->cr3 = USART_CR3_DMAR | USART_CR3_DMAT | USART_CR3_EIE | USART_CR3_RTSE |
                  USART_CR3_CTSE;
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
    if (is_held) {
        in_flight = 0;
        return;
    }
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

void uart_hold(bool is_to_be) {
    const uint32_t primask = cpu_mask();
    is_held = is_to_be;
    if (in_flight == 0) {
        send_next();
    }
    cpu_unmask(primask);
}

void uart_forget(void) {
    const uint32_t primask = cpu_mask();
    in_flight = 0;
    sending_tail = sending_head;
    to_wire->cr = 0;  // "Stream x configuration register": EN stays until it has ended
    for (uint16_t i = 0; i < STOP_TURNS_MAX && (to_wire->cr & DMA_CR_EN) != 0; i++) {
    }
    DMA1->hifcr = DMA_HIGH_FLAGS_6;
    NVIC->icpr[IRQ_DMA1_STREAM6 / 32] = BIT(IRQ_DMA1_STREAM6 % 32);
    cpu_unmask(primask);
}

void uart_set_baud(uint32_t baud) {
    uart_forget();
    if (USART2->brr == BRR(baud)) {
        return;
    }
    const uint32_t enabled = USART2->cr1;
    USART2->cr1 = enabled & ~USART_CR1_UE;
    USART2->brr = BRR(baud);
    USART2->cr1 = enabled;
}

bool uart_send(const uint8_t *bytes, uint8_t length) {
    if (length > ring_room(SENDING_SIZE, sending_head, sending_tail)) {
        return false;
    }
    const uint16_t head =
        ring_write(sending, SENDING_SIZE, sending_head, bytes, length);
    const uint32_t primask = cpu_mask();
    sending_head = head;
    if (in_flight == 0) {
        send_next();
    }
    cpu_unmask(primask);
    return true;
}

bool uart_is_idle(void) {
    const uint32_t primask = cpu_mask();
    const bool is_idle = in_flight == 0 && sending_head == sending_tail &&
                         (USART2->sr & USART_SR_TC) != 0;
    const uint32_t at = (uint32_t)sending_tail << 16 | to_wire->ndtr;
    cpu_unmask(primask);
    if (at != stood_at) {
        stood_at = at;
        stood_since_us = clock_us();
    }
    return is_idle || clock_us() - stood_since_us >= HELD_US;
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

int16_t uart_receive(void) {
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

uint16_t uart_receive_lost(void) {
    return lost;
}
