// SPDX-License-Identifier: MIT
// SPI1 as a master: DMA2 moves the bytes both ways, and its receiving end says when the
// last one is there.
#include "spi.h"

#include <stddef.h>

#include "cpu.h"
#include "gpio.h"
#include "idle.h"
#include "pins.h"

enum {
    CHANNEL = 3,  // "DMA2 request mapping": SPI1, received by stream 2, sent by 3
    // "SPI control register 1", BR: a clock of APB2 over 2^(n + 1).
    SLOW = 7,
    FAST = 1,
    SPEED_VERY_HIGH = 3,
    // A stream that is switched off ends the byte it is at; so does the SPI, in 24 us.
    TURNS_MAX = 2000,
};

_Static_assert(APB2_HZ / 256 >= 100000 && APB2_HZ / 256 <= 400000, "while identified");
_Static_assert(APB2_HZ / 4 <= 25000000, "default speed");

static struct dma_stream *const from_card = &DMA2->stream[2];
static struct dma_stream *const to_card = &DMA2->stream[3];

static volatile bool is_done = true;

// Source and destination of bytes that are not used. Not constant, as it is to
// lie in RAM.
static uint8_t ones = 0xFF;
static uint8_t unwanted;

static void configure(uint32_t rate) {
    for (uint16_t i = 0; (SPI1->sr & SPI_SR_BSY) != 0 && i < TURNS_MAX; i++) {
    }
    const uint32_t cr1 = SPI_CR1_MSTR | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_BR(rate);
    SPI1->cr1 = cr1;  // the rate must not change while it is on
    SPI1->cr1 = cr1 | SPI_CR1_SPE;
}

static void stop(struct dma_stream *stream) {
    stream->cr = 0;
    for (uint16_t i = 0; (stream->cr & DMA_CR_EN) != 0 && i < TURNS_MAX; i++) {
    }
}

static void stop_both(void) {
    SPI1->cr2 = 0;
    stop(to_card);
    stop(from_card);
    DMA2->lifcr = DMA_LOW_FLAGS_2 | DMA_LOW_FLAGS_3;
}

void spi_init(void) {
    RCC->ahb1enr |= RCC_AHB1_DMA2;
    RCC->apb2enr |= RCC_APB2_SPI1;
    (void)RCC->apb2enr;  // "Delay after an RCC peripheral clock enabling" (ES0182)
    cpu_barrier();
    static const uint8_t pins[] = {PIN_CARD_CLOCK, PIN_CARD_MISO, PIN_CARD_MOSI};
    gpio_set(GPIOA, PIN_CARD_SELECT, true);
    gpio_set_mode(GPIOA, PIN_CARD_SELECT, GPIO_OUTPUT);
    for (uint8_t i = 0; i < sizeof pins; i++) {
        const uint8_t pin = pins[i];
        // Steep edges of the clock, which the SPI also samples by ("Corrupted last bit
        // of data and/or CRC received in Master mode with delayed SCK feedback",
        // ES0182).
        GPIOA->ospeedr |= (uint32_t)SPEED_VERY_HIGH << (2 * pin);
        GPIOA->afr[0] = (GPIOA->afr[0] & ~(UINT32_C(15) << (4 * pin))) |
                        (uint32_t)ALTERNATE_SPI1 << (4 * pin);
        gpio_set_mode(GPIOA, pin, GPIO_ALTERNATE);
    }
    gpio_set_pull(GPIOA, PIN_CARD_MISO, GPIO_PULL_UP);  // nobody there reads as ones
    from_card->par = (uint32_t)(uintptr_t)&SPI1->dr;
    to_card->par = from_card->par;
    configure(SLOW);
    irq_enable(IRQ_DMA2_STREAM2, PRIORITY_CARD);
}

static void select(void *port, bool is_selected) {
    (void)port;
    gpio_set(GPIOA, PIN_CARD_SELECT, !is_selected);
}

static void set_fast(void *port, bool is_fast) {
    (void)port;
    configure(is_fast ? FAST : SLOW);
}

// "Communication using DMA": receiving is ready before there is anything to send.
static void begin(void *port, const uint8_t *out, uint8_t *in, uint16_t length) {
    (void)port;
    stop_both();
    // Left from an aborted exchange: a byte in each register, two at most.
    for (uint8_t i = 0; i < 2; i++) {
        for (uint16_t j = 0; (SPI1->sr & SPI_SR_BSY) != 0 && j < TURNS_MAX; j++) {
        }
        (void)SPI1->dr;
        (void)SPI1->sr;
    }
    is_done = false;
    from_card->m0ar = (uint32_t)(uintptr_t)(in != NULL ? in : &unwanted);
    from_card->ndtr = length;
    to_card->m0ar = (uint32_t)(uintptr_t)(out != NULL ? out : &ones);
    to_card->ndtr = length;
    cpu_barrier();  // the bytes are in memory before DMA looks
    SPI1->cr2 = SPI_CR2_RXDMAEN;
    from_card->cr = DMA_CR_CHANNEL(CHANNEL) | (in != NULL ? DMA_CR_MINC : 0) |
                    DMA_CR_TCIE | DMA_CR_EN;
    to_card->cr = DMA_CR_CHANNEL(CHANNEL) | (out != NULL ? DMA_CR_MINC : 0) |
                  DMA_CR_TO_PERIPHERAL | DMA_CR_EN;
    SPI1->cr2 = SPI_CR2_RXDMAEN | SPI_CR2_TXDMAEN;
}

void spi_exchanged(void) {
    DMA2->lifcr = DMA_LOW_FLAGS_2 | DMA_LOW_FLAGS_3;
    is_done = true;
    idle_has_work = true;
}

static bool exchange_is_done(void *port) {
    (void)port;
    return is_done;
}

const struct spi_device *spi_card(void) {
    static const struct spi_device device = {select, set_fast, begin, exchange_is_done,
                                             NULL};
    return &device;
}
