// SPDX-License-Identifier: MIT
// What the bare programs for the virtual STM32F405 share: registers by address (RM0090
// and PM0214), output on a serial line, and time.
#ifndef BARE_H
#define BARE_H

#include <stdbool.h>
#include <stdint.h>

#define AT(address) (*(volatile uint32_t *)(address))
#define BIT(n) (UINT32_C(1) << (n))
#define IN_RAM __attribute__((section(".in_ram"), noinline, long_call))
#define KEPT __attribute__((section(".kept")))  // not cleared at reset

#define RCC_CR AT(0x40023800)
#define RCC_PLLCFGR AT(0x40023804)
#define RCC_CFGR AT(0x40023808)
#define RCC_CIR AT(0x4002380C)
#define RCC_AHB1ENR AT(0x40023830)
#define RCC_APB1ENR AT(0x40023840)
#define RCC_APB2ENR AT(0x40023844)
#define RCC_CSR AT(0x40023874)
#define FLASH_ACR AT(0x40023C00)
#define FLASH_KEYR AT(0x40023C04)
#define FLASH_SR AT(0x40023C0C)
#define FLASH_CR AT(0x40023C10)
#define GPIO(port, at) AT(0x40020000 + 0x400 * (port) + (at))
enum { GPIOA, GPIOB, GPIOC };
enum { MODER = 0, OTYPER = 4, PUPDR = 12, IDR = 16, ODR = 20, BSRR = 24, AFRL = 32 };
#define TIM(n, at) AT(0x40000000 + 0x400 * ((n)-2) + (at))
enum {
    TIM_CR1 = 0x00,
    TIM_DIER = 0x0C,
    TIM_SR = 0x10,
    TIM_EGR = 0x14,
    TIM_CCMR1 = 0x18,
    TIM_CCMR2 = 0x1C,
    TIM_CCER = 0x20,
    TIM_CNT = 0x24,
    TIM_PSC = 0x28,
    TIM_ARR = 0x2C,
    TIM_CCR1 = 0x34,
};
#define USART(at) AT(0x40004400 + (at))
enum { U_SR = 0, U_DR = 4, U_BRR = 8, U_CR1 = 12, U_CR3 = 20 };
#define I2C(at) AT(0x40005400 + (at))
enum {
    I_CR1 = 0,
    I_CR2 = 4,
    I_DR = 16,
    I_SR1 = 20,
    I_SR2 = 24,
    I_CCR = 28,
    I_TRISE = 32
};
#define DMA1(at) AT(0x40026000 + (at))
#define DMA1_STREAM(n, at) AT(0x40026010 + 0x18 * (n) + (at))
#define DMA2(at) AT(0x40026400 + (at))
#define DMA2_STREAM(n, at) AT(0x40026410 + 0x18 * (n) + (at))
enum { S_CR = 0, S_NDTR = 4, S_PAR = 8, S_M0AR = 12 };
#define SPI(at) AT(0x40013000 + (at))
#define ADC(at) AT(0x40012000 + (at))
#define SYSCFG_EXTICR1 AT(0x40013808)
#define EXTI(at) AT(0x40013C00 + (at))
enum { E_IMR = 0, E_RTSR = 8, E_FTSR = 12, E_PR = 20 };
#define IWDG(at) AT(0x40003000 + (at))
#define SYSTICK(at) AT(0xE000E010 + (at))
#define NVIC_ISER(n) AT(0xE000E100 + 4 * (n))
#define NVIC_ISPR(n) AT(0xE000E200 + 4 * (n))
#define NVIC_IPR(line) (*(volatile uint8_t *)(0xE000E400 + (line)))
#define SCB(at) AT(0xE000ED00 + (at))
enum { ICSR = 4, VTOR = 8, AIRCR = 12, SCR = 16, CCR = 20, SHCSR = 0x24, CFSR = 0x28 };
enum { HFSR = 0x2C, BFAR = 0x38, CPACR = 0x88 };
#define SHPR(exception) (*(volatile uint8_t *)(0xE000ED18 - 4 + (exception)))
#define DEMCR AT(0xE000EDFC)
#define DWT_CTRL AT(0xE0001000)
#define DWT_CYCCNT AT(0xE0001004)

// The vector table is in RAM, so that a program can set its handlers.
extern void (*vectors[98])(void);
enum {
    HARD_FAULT = 3,
    BUS_FAULT = 5,
    USAGE_FAULT = 6,
    SVC = 11,
    PENDSV = 14,
    TICK = 15
};
enum { IRQ = 16 };

// The program under test. It starts on HSI with the line at 1 Mbaud and the FPU off;
// TIM2 counts microseconds from power-up on.
void program(void);
// Sends a line: the name and a hexadecimal number.
void say(const char *name, uint32_t value);
void flush(void);
// Ends the run by sleeping for ever.
_Noreturn void end(void);

static inline uint32_t now_us(void) {
    return TIM(2, TIM_CNT);
}

static inline void wait_us(uint32_t us) {
    for (const uint32_t from = now_us(); now_us() - from < us;) {
    }
}

static inline void enable_irq(unsigned line, uint8_t priority) {
    NVIC_IPR(line) = priority;
    NVIC_ISER(line / 32) = BIT(line % 32);
}

static inline void pin_mode(unsigned port, unsigned pin, uint32_t mode) {
    GPIO(port, MODER) =
        (GPIO(port, MODER) & ~(UINT32_C(3) << (2 * pin))) | (mode << (2 * pin));
}

static inline void pin_pull_up(unsigned port, unsigned pin) {
    GPIO(port, PUPDR) =
        (GPIO(port, PUPDR) & ~(UINT32_C(3) << (2 * pin))) | (UINT32_C(1) << (2 * pin));
}

static inline void pin_alternate(unsigned port, unsigned pin, uint32_t function) {
    const uint32_t reg = AFRL + 4 * (pin / 8);
    const unsigned shift = 4 * (pin % 8);
    GPIO(port, reg) =
        (GPIO(port, reg) & ~(UINT32_C(15) << shift)) | (function << shift);
    pin_mode(port, pin, 2);
}

#endif
