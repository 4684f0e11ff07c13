// SPDX-License-Identifier: MIT
// Reads six bytes at each edge of data-ready (PB0, EXTI0): addresses by interrupt, data
// by DMA, with LAST for the NACK of the last byte. TIM3 captures the time of the edges.
#include "i2c.h"

enum { G = 0x6B, MORE = 0x80, OUT_X = 0x28, SAMPLES = 50 };

static volatile uint32_t done, failed, edges;
static volatile uint32_t captures[SAMPLES + 2];
static uint8_t data[6];
static volatile enum { POINT, READ } stage;

static void on_ready(void) {
    EXTI(E_PR) = BIT(0);
    captures[edges % (SAMPLES + 2)] = TIM(3, TIM_CCR1 + 8);
    edges++;
    stage = POINT;
    I2C(I_CR1) = PE | ACK | START;
}

static void on_event(void) {
    const uint32_t sr1 = I2C(I_SR1);
    if ((sr1 & SB) != 0) {
        I2C(I_DR) = G << 1 | (stage == READ);
    } else if ((sr1 & ADDR) != 0) {
        if (stage == READ) {
            I2C(I_CR2) |= BIT(12) | BIT(11);
        }
        (void)I2C(I_SR2);
        if (stage == POINT) {
            I2C(I_DR) = OUT_X | MORE;
        }
    } else if ((sr1 & BTF) != 0 && stage == POINT) {
        stage = READ;
        DMA1_STREAM(0, S_NDTR) = sizeof data;
        DMA1_STREAM(0, S_M0AR) = (uint32_t)data;
        DMA1_STREAM(0, S_PAR) = 0x40005410;
        DMA1_STREAM(0, S_CR) = 1 << 25 | BIT(10) | BIT(4) | BIT(0);
        I2C(I_CR1) |= START;
    }
}

static void on_error(void) {
    failed++;
    I2C(I_SR1) = 0;
    I2C(I_CR1) |= STOP;
}

static void on_data(void) {
    DMA1(0x08) = 0x3D;
    I2C(I_CR1) |= STOP;
    I2C(I_CR2) &= ~(BIT(12) | BIT(11));
    done++;
}

void program(void) {
    RCC_AHB1ENR |= BIT(21);
    RCC_APB1ENR |= BIT(1);
    RCC_APB2ENR |= BIT(14);
    i2c_setup();
    wait_us(30000);
    say("good", i2c_write(G, 0x22, 0x08));  // DRDY on its pin
    TIM(3, TIM_PSC) = 15;
    TIM(3, TIM_EGR) = 1;
    TIM(3, TIM_CCMR2) = 1;
    TIM(3, TIM_CCER) = BIT(8);
    TIM(3, TIM_CR1) = 1;
    pin_alternate(GPIOB, 0, 2);
    SYSCFG_EXTICR1 = 1;
    EXTI(E_RTSR) = EXTI(E_IMR) = BIT(0);
    // Turns on three axes at 760 Hz. The first read clears data-ready, so that each
    // later sample gives an edge.
    say("good", i2c_write(G, 0x20, 0xFF));
    wait_us(300000);
    vectors[IRQ + 6] = on_ready;
    vectors[IRQ + 31] = on_event;
    vectors[IRQ + 32] = on_error;
    vectors[IRQ + 11] = on_data;
    I2C(I_CR2) |= BIT(9) | BIT(8);
    EXTI(E_PR) = BIT(0);
    enable_irq(6, 0x10);
    enable_irq(31, 0x10);
    enable_irq(32, 0x10);
    enable_irq(11, 0x10);
    on_ready();
    edges = 0;
    while (done < SAMPLES) {
        __asm__ volatile("wfi");
    }
    wait_us(1000);
    say("done", done);
    say("failed", failed);
    say("edges", edges);
    uint32_t shortest = 65535;
    uint32_t longest = 0;
    for (unsigned i = 1; i < edges; i++) {
        const uint32_t gap = (captures[i] - captures[i - 1]) & 0xFFFF;
        shortest = gap < shortest ? gap : shortest;
        longest = gap > longest ? gap : longest;
    }
    say("shortest", shortest);
    say("longest", longest);
    for (unsigned i = 0; i < 6; i += 2) {
        say("axis", (uint32_t)data[i + 1] << 8 | data[i]);
    }
}
