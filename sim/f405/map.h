// SPDX-License-Identifier: MIT
// Numbers that all parts of the STM32F405 share: clocks, memory, reset causes,
// exceptions and ports.
#ifndef SIM_F405_MAP_H
#define SIM_F405_MAP_H

#include <stdint.h>

#define F405_NEVER UINT64_MAX
#define F405_PS_PER_US UINT64_C(1000000)
#define F405_PS_PER_S UINT64_C(1000000000000)
#define F405_HSE_HZ 12000000U  // the crystal of the pyboard v1.1
#define F405_HSI_HZ 16000000U
#define F405_LSI_HZ 32000U  // DS, "LSI oscillator characteristics", typical

enum {
    F405_FLASH = 0x08000000,
    F405_FLASH_SIZE = 0x100000,
    F405_RAM = 0x20000000,
    F405_RAM_SIZE = 0x20000,
    F405_CCM = 0x10000000,
    F405_CCM_SIZE = 0x10000,
    F405_SYSTEM = 0x1FFF7000,  // the page with the device's signature
    F405_SYSTEM_SIZE = 0x1000,
    F405_PAINT = 0xA5,  // fills RAM at power-up, to find the deepest stack
    F405_SUPPLY_MV = 3300,
};

// Reset causes, bits of RCC_CSR (RM, "RCC clock control & status register").
enum f405_reset {
    F405_RESET_BROWN_OUT = 1 << 25,
    F405_RESET_PIN = 1 << 26,
    F405_RESET_POWER_ON = 1 << 27,
    F405_RESET_SOFTWARE = 1 << 28,
    F405_RESET_WATCHDOG = 1 << 29,
};

// Exceptions by number: the core's own, then the NVIC's lines from 16 on (RM, "Vector
// table for STM32F405xx/07xx").
enum f405_exception {
    EXCEPTION_NMI = 2,
    EXCEPTION_HARD_FAULT = 3,
    EXCEPTION_MEMORY_FAULT = 4,
    EXCEPTION_BUS_FAULT = 5,
    EXCEPTION_USAGE_FAULT = 6,
    EXCEPTION_SVC = 11,
    EXCEPTION_PENDSV = 14,
    EXCEPTION_SYSTICK = 15,
    EXCEPTION_IRQ = 16,
    IRQ_FLASH = 4,
    IRQ_RCC = 5,
    IRQ_EXTI0 = 6,
    IRQ_DMA1_STREAM0 = 11,
    IRQ_ADC = 18,
    IRQ_EXTI9_5 = 23,
    IRQ_TIM2 = 28,
    IRQ_TIM3 = 29,
    IRQ_TIM4 = 30,
    IRQ_I2C1_EVENT = 31,
    IRQ_I2C1_ERROR = 32,
    IRQ_SPI1 = 35,
    IRQ_USART2 = 38,
    IRQ_EXTI15_10 = 40,
    IRQ_DMA1_STREAM7 = 47,
    IRQ_TIM5 = 50,
    IRQ_DMA2_STREAM0 = 56,
    IRQ_DMA2_STREAM5 = 68,
    IRQ_LINES = 82,
    EXCEPTIONS = EXCEPTION_IRQ + IRQ_LINES,
};

enum { PORT_A, PORT_B, PORT_C, PORT_D, PORT_H, PORTS };

#endif
