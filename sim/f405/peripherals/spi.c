// SPDX-License-Identifier: MIT
// SPI1 as a full-duplex master of 8 or 16 bits (RM, "Serial peripheral interface"),
// with the card's socket.
#include "chips/sdcard.h"
#include "f405/f405.h"

enum {
    CR1 = 0x00,
    CR2 = 0x04,
    SR = 0x08,
    DR = 0x0C,
    CRCPR = 0x10,
    CR1_CPHA = 1 << 0,
    CR1_CPOL = 1 << 1,
    CR1_MSTR = 1 << 2,
    CR1_SPE = 1 << 6,
    CR1_SSI = 1 << 8,
    CR1_SSM = 1 << 9,
    CR1_DFF = 1 << 11,
    CR1_KNOWN = 0x0B7F,
    CR2_RXDMAEN = 1 << 0,
    CR2_TXDMAEN = 1 << 1,
    CR2_SSOE = 1 << 2,
    CR2_ERRIE = 1 << 5,
    CR2_RXNEIE = 1 << 6,
    CR2_TXEIE = 1 << 7,
    CR2_KNOWN = 0xE7,
    RXNE = 1 << 0,
    TXE = 1 << 1,
    OVR = 1 << 6,
    BSY = 1 << 7,
    DMA2_UNIT = 1,
    CHANNEL = 3,
    AF_SPI = 5,
};

static void follow_line(struct f405 *m) {
    const struct f405_spi *spi = &m->spi;
    core_irq(m, EXCEPTION_IRQ + IRQ_SPI1,
             ((spi->sr & TXE) && (spi->cr2 & CR2_TXEIE)) ||
                 ((spi->sr & RXNE) && (spi->cr2 & CR2_RXNEIE)) ||
                 ((spi->sr & OVR) && (spi->cr2 & CR2_ERRIE)));
}

// The clock is that of APB2 divided by 2 to this power.
static unsigned divider_bits(const struct f405 *m) {
    return 1 + ((m->spi.cr1 >> 3) & 7);
}

static void begin(struct f405 *m) {
    struct f405_spi *spi = &m->spi;
    if (spi->is_shifting || !spi->is_data_full || (spi->cr1 & CR1_SPE) == 0) {
        return;
    }
    const unsigned bits = (spi->cr1 & CR1_DFF) != 0 ? 16 : 8;
    spi->shift = spi->data;
    spi->is_data_full = false;
    spi->is_shifting = true;
    spi->sr |= TXE | BSY;
    f405_at(m, EVENT_SPI,
            f405_when(m) + f405_ps((uint64_t)bits << divider_bits(m), m->pclk_hz[1]));
}

// Exchanges the byte whose transfer ends at that time. Without a card the pull-up gives
// ones.
static uint8_t exchange(struct f405 *m, uint64_t at_ps, uint8_t byte) {
    for (unsigned pin = 5; pin <= 7; pin++) {
        if (!pins_is_alternate(m, PORT_A, pin, AF_SPI)) {
            f405_complain(m, "SPI1 used with its pins elsewhere");
            return 0xFF;
        }
    }
    if (m->card == NULL) {
        return 0xFF;
    }
    // A card samples at rising edges, whichever level the clock idles at.
    if (((m->spi.cr1 & CR1_CPOL) != 0) != ((m->spi.cr1 & CR1_CPHA) != 0)) {
        f405_complain(m, "SPI1 samples at the edge at which a card changes");
    }
    return sdcard_chip_exchange(m->card, f405_ns(at_ps),
                                m->pclk_hz[1] >> divider_bits(m), byte);
}

void spi_event(struct f405 *m) {
    struct f405_spi *spi = &m->spi;
    const uint64_t end = f405_when(m);
    uint16_t in = 0;
    if ((spi->cr1 & CR1_DFF) != 0) {
        const uint64_t half = f405_ps(UINT64_C(8) << divider_bits(m), m->pclk_hz[1]);
        in = (uint16_t)(exchange(m, end - half, (uint8_t)(spi->shift >> 8)) << 8);
    }
    in |= exchange(m, end, (uint8_t)spi->shift);
    spi->is_shifting = false;
    if ((spi->sr & RXNE) != 0) {
        spi->sr |= OVR;
    } else {
        spi->received = in;
        spi->sr |= RXNE;
    }
    begin(m);
    if (!spi->is_shifting) {
        spi->sr &= ~(uint32_t)BSY;
    }
    follow_line(m);
}

bool spi_pump(struct f405 *m) {
    const struct f405_spi *spi = &m->spi;
    if ((spi->cr2 & CR2_RXDMAEN) != 0 && (spi->sr & RXNE) != 0 &&
        (dma_serve(m, DMA2_UNIT, 0, CHANNEL, false) ||
         dma_serve(m, DMA2_UNIT, 2, CHANNEL, false))) {
        return true;
    }
    return (spi->cr2 & CR2_TXDMAEN) != 0 && (spi->sr & TXE) != 0 &&
           (spi->cr1 & CR1_SPE) != 0 &&
           (dma_serve(m, DMA2_UNIT, 3, CHANNEL, true) ||
            dma_serve(m, DMA2_UNIT, 5, CHANNEL, true));
}

uint32_t spi_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    struct f405_spi *spi = &m->spi;
    uint32_t value = 0;
    switch (at) {
    case CR1:
        return spi->cr1;
    case CR2:
        return spi->cr2;
    case SR:
        value = spi->sr;
        if (spi->has_read_data) {  // DR, then SR, clears it
            spi->sr &= ~(uint32_t)OVR;
            spi->has_read_data = false;
        }
        break;
    case DR:
        value = spi->received;
        spi->sr &= ~(uint32_t)RXNE;
        spi->has_read_data = (spi->sr & OVR) != 0;
        break;
    case CRCPR:
        return spi->crcpr;
    default:
        f405_not_modelled(m, "CRC and I2S of SPI1");
        break;
    }
    follow_line(m);
    return value;
}

static void write_control(struct f405 *m, uint32_t value) {
    struct f405_spi *spi = &m->spi;
    if ((value & ~(uint32_t)CR1_KNOWN) != 0 ||
        ((value & CR1_SPE) != 0 && (value & CR1_MSTR) == 0)) {
        f405_not_modelled(m, "SPI1 other than a master both ways");
    }
    if ((value & CR1_SPE) != 0 && (spi->cr2 & CR2_SSOE) == 0 &&
        (value & (CR1_SSM | CR1_SSI)) != (CR1_SSM | CR1_SSI)) {
        f405_complain(m, "SPI1 a master while its NSS says slave");
    }
    spi->cr1 = value & CR1_KNOWN;
}

void spi_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_spi *spi = &m->spi;
    switch (at) {
    case CR1:
        write_control(m, value);
        break;
    case CR2:
        spi->cr2 = value & CR2_KNOWN;
        break;
    case SR:
        break;
    case DR:
        if (spi->is_data_full) {
            f405_complain(m, "a byte for SPI1 written over another");
        }
        spi->data = (uint16_t)value;
        spi->is_data_full = true;
        spi->sr &= ~(uint32_t)TXE;
        break;
    case CRCPR:
        spi->crcpr = value;
        break;
    default:
        f405_not_modelled(m, "CRC and I2S of SPI1");
        break;
    }
    begin(m);
    follow_line(m);
}

void spi_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    m->spi = (struct f405_spi){.sr = TXE, .crcpr = 7};
    f405_never(m, EVENT_SPI);
    follow_line(m);
}
