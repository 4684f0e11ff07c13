// SPDX-License-Identifier: MIT
// The two DMA controllers: unit 0 is DMA1, unit 1 is DMA2.
#ifndef SIM_F405_PERIPHERALS_DMA_H
#define SIM_F405_PERIPHERALS_DMA_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

enum { STREAMS = 8 };

struct f405_stream {
    uint32_t cr, ndtr, par, m0ar, m1ar, fcr;
    uint32_t length, at, register_at;  // as when enabled; where it stands
};

struct f405_dma {
    struct f405_stream streams[STREAMS];
    uint8_t flags[STREAMS];  // as in LISR: FEIF, DMEIF, TEIF, HTIF, TCIF
};

void dma_reset(struct f405 *m, unsigned unit);
// One transfer for a peripheral that asks on that stream and channel. False: the stream
// is not set up for it.
bool dma_serve(struct f405 *m, unsigned unit, unsigned stream, unsigned channel,
               bool is_to_peripheral);
// Transfers left of the stream, where it serves this channel; else 0.
uint32_t dma_left(const struct f405 *m, unsigned unit, unsigned stream,
                  unsigned channel);
uint32_t dma_read(struct f405 *m, unsigned unit, uint32_t at);
void dma_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
