// SPDX-License-Identifier: MIT
// SPI1 with its DMA: what carries a card's bytes.
#ifndef STM32_SPI_H
#define STM32_SPI_H

#include "core/drivers/spi.h"

// Pins and clocks too; the ports have theirs.
void spi_init(void);

const struct spi_device *spi_card(void);

void spi_exchanged(void);  // DMA2 stream 2: the last byte has come

#endif
