// SPDX-License-Identifier: MIT
// SPI1, on which is the card.
#ifndef SIM_F405_PERIPHERALS_SPI_H
#define SIM_F405_PERIPHERALS_SPI_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_spi {
    uint32_t cr1, cr2, sr, crcpr;
    uint16_t data, shift, received;
    bool is_shifting, is_data_full;
    bool has_read_data;  // first half of clearing OVR
};

void spi_reset(struct f405 *m, unsigned unit);
void spi_event(struct f405 *m);
// One transfer by DMA, where the unit asks for one. True: there may be another.
bool spi_pump(struct f405 *m);
uint32_t spi_read(struct f405 *m, unsigned unit, uint32_t at);
void spi_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
