// SPDX-License-Identifier: MIT
// Echoes received bytes by DMA when the line becomes idle, then reads nothing
// for 0.1 s.
#include "bare.h"

static uint8_t ring[64];
static volatile uint32_t idles, sent;
static volatile uint8_t out[64];
static unsigned taken;

static void on_line(void) {
    const uint32_t sr = USART(U_SR);
    (void)USART(U_DR);
    if ((sr & BIT(4)) == 0) {
        return;
    }
    idles++;
    const unsigned head = (sizeof ring - DMA1_STREAM(5, S_NDTR)) % sizeof ring;
    unsigned length = 0;
    for (; taken != head; taken = (taken + 1) % sizeof ring) {
        out[length++] = ring[taken];
    }
    if (length == 0) {
        return;
    }
    USART(U_SR) = ~BIT(6);
    DMA1_STREAM(6, S_NDTR) = length;
    DMA1_STREAM(6, S_CR) |= BIT(0);
}

static void on_sent(void) {
    DMA1(0x0C) = 0x3D << 16;
    sent++;
}

void program(void) {
    RCC_AHB1ENR |= BIT(21);
    DMA1_STREAM(5, S_PAR) = 0x40004404;
    DMA1_STREAM(5, S_M0AR) = (uint32_t)ring;
    DMA1_STREAM(5, S_NDTR) = sizeof ring;
    DMA1_STREAM(5, S_CR) = 4 << 25 | BIT(10) | BIT(8) | BIT(0);
    DMA1_STREAM(6, S_PAR) = 0x40004404;
    DMA1_STREAM(6, S_M0AR) = (uint32_t)out;
    DMA1_STREAM(6, S_CR) = 4 << 25 | BIT(10) | BIT(6) | BIT(4);
    vectors[IRQ + 38] = on_line;
    vectors[IRQ + 17] = on_sent;
    enable_irq(38, 0);
    enable_irq(17, 0);
    USART(U_CR3) = BIT(7) | BIT(6);
    USART(U_CR1) |= BIT(4);
    wait_us(100000);
    USART(U_CR3) = 0;
    USART(U_CR1) &= ~BIT(4);
    say("idles", idles);
    say("sent", sent);
    // Three bytes come at 150 ms; the flags are read after all of them.
    wait_us(100000);
    const uint32_t sr = USART(U_SR);
    say("flags", sr & 0x3F);
    say("byte", USART(U_DR));
    say("flags", USART(U_SR) & 0x3F);
    // DMA can't reach the CCM.
    DMA1_STREAM(6, S_M0AR) = 0x10000000;
    DMA1_STREAM(6, S_NDTR) = 4;
    DMA1_STREAM(6, S_CR) = 4 << 25 | BIT(10) | BIT(6) | BIT(0);
    USART(U_CR3) = BIT(7);
    wait_us(100);
    say("dma", (DMA1(4) >> 16) & 0x3D);
    say("enabled", DMA1_STREAM(6, S_CR) & 1);
}
