// SPDX-License-Identifier: MIT
// USART2, on the wire to the host or to the radio.
#ifndef SIM_F405_PERIPHERALS_USART_H
#define SIM_F405_PERIPHERALS_USART_H

#include <stdbool.h>
#include <stdint.h>

#include "run/line.h"

struct f405;

struct f405_usart {
    uint32_t sr, brr, cr1, cr2, cr3, gtpr;
    uint8_t data, shift, received;
    bool is_shifting, is_preamble, is_data_full;
    uint32_t seen;
    bool is_idle_due;  // something has come since the line was last seen idle
    uint64_t overruns, deaf;
    bool was_cts_high;
    uint64_t busy_until;  // receiving, with a frame of another rate
    struct line line;     // bytes on their way in, times in picoseconds
    bool is_receiving;
};

void usart_reset(struct f405 *m, unsigned unit);
void usart_sent(struct f405 *m);
void usart_received(struct f405 *m);
void usart_idle(struct f405 *m);
// One transfer by DMA, where the unit asks for one. True: there may be another.
bool usart_pump(struct f405 *m);
// The level of RTS, -1 where the pin is not it.
int usart_rts(const struct f405 *m);
// What BRR makes of the clock; 0: none.
uint32_t usart_baud(const struct f405 *m);
// The level of CTS may have changed.
void usart_follow_cts(struct f405 *m);
// A frame that the radio sent at that rate has ended.
void usart_deliver(struct f405 *m, uint8_t byte, uint32_t baud);
void usart_free(struct f405 *m);
uint32_t usart_read(struct f405 *m, unsigned unit, uint32_t at);
void usart_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
