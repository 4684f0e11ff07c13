// SPDX-License-Identifier: MIT
// ADC1: converts the reference once, then eight times by DMA, and a floating pin.
#include "bare.h"

static uint16_t samples[8];

static uint32_t convert(unsigned channel) {
    ADC(0x34) = channel;
    ADC(0x08) = BIT(0) | BIT(30);
    while ((ADC(0x00) & BIT(1)) == 0) {
    }
    return ADC(0x4C);
}

void program(void) {
    RCC_APB2ENR |= BIT(8);
    RCC_AHB1ENR |= BIT(22);
    ADC(0x304) = BIT(23);
    ADC(0x0C) = 7 << 21;
    ADC(0x08) = BIT(0);
    wait_us(10);
    const uint32_t from = now_us();
    say("reference", convert(17));
    say("us", now_us() - from < 400);
    say("calibration", AT(0x1FFF7A28) >> 16);
    say("floating", convert(1) != convert(1));
    // SQR: eight conversions of the reference.
    DMA2_STREAM(0, S_PAR) = 0x4001204C;
    DMA2_STREAM(0, S_M0AR) = (uint32_t)samples;
    DMA2_STREAM(0, S_NDTR) = 8;
    DMA2_STREAM(0, S_CR) = BIT(10) | 1 << 11 | 1 << 13 | BIT(0);
    ADC(0x04) = BIT(8);
    ADC(0x2C) = 7 << 20;
    ADC(0x30) = 17 | 17 << 5;
    ADC(0x34) = 17 | 17 << 5 | 17 << 10 | 17 << 15 | 17 << 20 | 17 << 25;
    ADC(0x08) = BIT(0) | BIT(8) | BIT(30);
    while ((DMA2(0) & BIT(5)) == 0) {
    }
    uint32_t sum = 0;
    for (unsigned i = 0; i < 8; i++) {
        sum += samples[i];
    }
    say("sum", sum);
    say("signature", AT(0x1FFF7A20) >> 16);
}
