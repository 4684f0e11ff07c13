// SPDX-License-Identifier: MIT
// The seam between the card's driver and what carries its bytes: a board's SPI with its
// DMA, an emulated card, a test.
#ifndef SPI_H
#define SPI_H

#include <stdbool.h>
#include <stdint.h>

// Mode 0, most significant bit first. All return at once.
struct spi_device {
    // Only between exchanges.
    void (*select)(void *port, bool is_selected);
    // At most 25 MHz; otherwise 100 to 400 kHz.
    void (*set_fast)(void *port, bool is_fast);
    // Begins an exchange of 1 or more bytes, which runs in the background, and drops
    // one that has not come to its end. Without `out` ones are sent, without `in` what
    // comes is thrown away. Both stay valid until it is done, in memory that a board's
    // DMA reaches.
    void (*begin)(void *port, const uint8_t *out, uint8_t *in, uint16_t length);
    bool (*is_done)(void *port);
    void *port;
};

#endif
