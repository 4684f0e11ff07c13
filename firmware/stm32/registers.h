// SPDX-License-Identifier: MIT
// The registers of the STM32F405 that this folder uses, with their bits.
//
// Comments in this folder name sections of the reference manual (RM0090), of the
// Cortex-M4 programming manual (PM0214), of the data sheet (DocID022152) and of the
// errata sheet (ES0182) by their titles, which all their editions share.
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

#define BIT(n) (UINT32_C(1) << (n))
#define AT(type, address) ((struct type *)(address))

// "Flash interface registers".
struct flash {
    volatile uint32_t acr, keyr, optkeyr, sr, cr;
};
#define FLASH AT(flash, 0x40023C00)
#define FLASH_ACR_LATENCY(n) ((uint32_t)(n))
#define FLASH_ACR_PRFTEN BIT(8)
#define FLASH_ACR_ICEN BIT(9)
#define FLASH_ACR_DCEN BIT(10)
#define FLASH_ACR_DCRST BIT(12)
#define FLASH_SR_ERRORS (BIT(1) | BIT(4) | BIT(5) | BIT(6) | BIT(7))
#define FLASH_SR_BSY BIT(16)
#define FLASH_CR_PG BIT(0)
#define FLASH_CR_SER BIT(1)
#define FLASH_CR_SNB(n) ((uint32_t)(n) << 3)
#define FLASH_CR_PSIZE_X32 BIT(9)
#define FLASH_CR_STRT BIT(16)
#define FLASH_CR_LOCK BIT(31)

// "Power control register".
struct pwr {
    volatile uint32_t cr, csr;
};
#define PWR AT(pwr, 0x40007000)
#define PWR_CR_LPDS BIT(0)
#define PWR_CR_PDDS BIT(1)
#define PWR_CR_CWUF BIT(2)
#define PWR_CR_FPDS BIT(9)
#define PWR_CR_VOS BIT(14)

// "RCC registers".
struct rcc {
    volatile uint32_t cr, pllcfgr, cfgr, cir;
    volatile uint32_t ahb1rstr, ahb2rstr, ahb3rstr, reserved1;
    volatile uint32_t apb1rstr, apb2rstr, reserved2[2];
    volatile uint32_t ahb1enr, ahb2enr, ahb3enr, reserved3;
    volatile uint32_t apb1enr, apb2enr, reserved4[2];
    volatile uint32_t ahb1lpenr, ahb2lpenr, ahb3lpenr, reserved5;
    volatile uint32_t apb1lpenr, apb2lpenr, reserved6[2];
    volatile uint32_t bdcr, csr;
};
#define RCC AT(rcc, 0x40023800)
#define RCC_CR_HSION BIT(0)
#define RCC_CR_HSIRDY BIT(1)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_CSSON BIT(19)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define RCC_PLLCFGR_M(n) ((uint32_t)(n))
#define RCC_PLLCFGR_N(n) ((uint32_t)(n) << 6)
#define RCC_PLLCFGR_P_2 UINT32_C(0)
#define RCC_PLLCFGR_HSE BIT(22)
#define RCC_PLLCFGR_Q(n) ((uint32_t)(n) << 24)
#define RCC_CFGR_RTCPRE(n) ((uint32_t)(n) << 16)
#define RCC_CFGR_SW_PLL UINT32_C(2)
#define RCC_CFGR_SWS (UINT32_C(3) << 2)
#define RCC_CFGR_SWS_PLL (UINT32_C(2) << 2)
#define RCC_CFGR_PPRE1_4 (UINT32_C(5) << 10)
#define RCC_CFGR_PPRE2_2 (UINT32_C(4) << 13)
#define RCC_CIR_CSSC BIT(23)
#define RCC_AHB1_GPIOA BIT(0)
#define RCC_AHB1_GPIOB BIT(1)
#define RCC_AHB1_GPIOC BIT(2)
#define RCC_AHB1_DMA1 BIT(21)
#define RCC_AHB1_DMA2 BIT(22)
#define RCC_APB1_TIM2 BIT(0)
#define RCC_APB1_TIM3 BIT(1)
#define RCC_APB1_USART2 BIT(17)
#define RCC_APB1_I2C1 BIT(21)
#define RCC_APB1_PWR BIT(28)
#define RCC_APB2_ADC1 BIT(8)
#define RCC_APB2_SPI1 BIT(12)
#define RCC_APB2_SYSCFG BIT(14)
#define RCC_APB2_TIM11 BIT(18)
#define RCC_CSR_RMVF BIT(24)
#define RCC_CSR_BORRSTF BIT(25)
#define RCC_CSR_PINRSTF BIT(26)
#define RCC_CSR_PORRSTF BIT(27)
#define RCC_CSR_SFTRSTF BIT(28)
#define RCC_CSR_IWDGRSTF BIT(29)
#define RCC_CSR_WWDGRSTF BIT(30)

// "GPIO registers". Two bits a pin in moder, ospeedr and pupdr, four in afr.
struct gpio {
    volatile uint32_t moder, otyper, ospeedr, pupdr, idr, odr, bsrr, lckr, afr[2];
};
#define GPIOA AT(gpio, 0x40020000)
#define GPIOB AT(gpio, 0x40020400)
#define GPIOC AT(gpio, 0x40020800)
enum gpio_mode { GPIO_INPUT = 0, GPIO_OUTPUT = 1, GPIO_ALTERNATE = 2, GPIO_ANALOG = 3 };

// "SYSCFG registers": which port a line of EXTI looks at, four bits a line.
struct syscfg {
    volatile uint32_t memrmp, pmc, exticr[4], reserved[2], cmpcr;
};
#define SYSCFG AT(syscfg, 0x40013800)
#define SYSCFG_EXTICR(line, port) ((uint32_t)(port) << (4 * ((line) % 4)))
enum { SYSCFG_PORT_B = 1, SYSCFG_PORT_C = 2 };

// "EXTI registers".
struct exti {
    volatile uint32_t imr, emr, rtsr, ftsr, swier, pr;
};
#define EXTI AT(exti, 0x40013C00)

// "TIM2 to TIM5 registers"; of them "TIM10/11/13/14 registers" have those of channel 1.
struct tim {
    volatile uint32_t cr1, cr2, smcr, dier, sr, egr, ccmr1, ccmr2, ccer, cnt, psc, arr;
    volatile uint32_t reserved1, ccr1, ccr2, ccr3, ccr4, reserved2[3], option;
};
#define TIM2 AT(tim, 0x40000000)
#define TIM3 AT(tim, 0x40000400)
#define TIM11 AT(tim, 0x40014800)
#define TIM_CR1_CEN BIT(0)
#define TIM_DIER_CC3IE BIT(3)
#define TIM_SR_CC1IF BIT(1)
#define TIM_SR_CC1OF BIT(9)
#define TIM_SR_CC3OF BIT(11)
#define TIM_EGR_UG BIT(0)
#define TIM_CCMR1_CC1_INPUT BIT(0)
#define TIM_CCMR1_IC1PSC_8 (UINT32_C(3) << 2)
#define TIM_CCMR2_CC3_INPUT BIT(0)
#define TIM_CCMR2_IC3_FILTER(n) ((uint32_t)(n) << 4)
#define TIM_CCER_CC1E BIT(0)
#define TIM_CCER_CC3E BIT(8)
#define TIM11_OPTION_HSE_RTC UINT32_C(2)

// "DMA registers". Flags of streams 4 to 7 are in the high registers.
struct dma_stream {
    volatile uint32_t cr, ndtr, par, m0ar, m1ar, fcr;
};
struct dma {
    volatile uint32_t lisr, hisr, lifcr, hifcr;
    struct dma_stream stream[8];
};
#define DMA1 AT(dma, 0x40026000)
#define DMA2 AT(dma, 0x40026400)
#define DMA_CR_EN BIT(0)
#define DMA_CR_HTIE BIT(3)
#define DMA_CR_TCIE BIT(4)
#define DMA_CR_TO_PERIPHERAL BIT(6)
#define DMA_CR_CIRC BIT(8)
#define DMA_CR_MINC BIT(10)
#define DMA_CR_CHANNEL(n) ((uint32_t)(n) << 25)
#define DMA_LOW_FLAGS_2 (UINT32_C(0x3D) << 16)
#define DMA_LOW_FLAGS_3 (UINT32_C(0x3D) << 22)
#define DMA_HIGH_FLAGS_5 (UINT32_C(0x3D) << 6)
#define DMA_HIGH_FLAGS_6 (UINT32_C(0x3D) << 16)

// "I2C registers".
struct i2c {
    volatile uint32_t cr1, cr2, oar1, oar2, dr, sr1, sr2, ccr, trise;
};
#define I2C1 AT(i2c, 0x40005400)
#define I2C_CR1_PE BIT(0)
#define I2C_CR1_START BIT(8)
#define I2C_CR1_STOP BIT(9)
#define I2C_CR1_ACK BIT(10)
#define I2C_CR1_POS BIT(11)
#define I2C_CR1_SWRST BIT(15)
#define I2C_CR2_ITERREN BIT(8)
#define I2C_CR2_ITEVTEN BIT(9)
#define I2C_CR2_ITBUFEN BIT(10)
#define I2C_SR1_SB BIT(0)
#define I2C_SR1_ADDR BIT(1)
#define I2C_SR1_BTF BIT(2)
#define I2C_SR1_RXNE BIT(6)
#define I2C_SR1_BERR BIT(8)
#define I2C_SR1_ARLO BIT(9)
#define I2C_SR1_AF BIT(10)
#define I2C_CCR_FS BIT(15)

// "USART registers".
struct usart {
    volatile uint32_t sr, dr, brr, cr1, cr2, cr3, gtpr;
};
#define USART2 AT(usart, 0x40004400)
#define USART_SR_FE BIT(1)
#define USART_SR_NF BIT(2)
#define USART_SR_ORE BIT(3)
#define USART_SR_IDLE BIT(4)
#define USART_SR_TC BIT(6)
#define USART_CR1_RE BIT(2)
#define USART_CR1_TE BIT(3)
#define USART_CR1_IDLEIE BIT(4)
#define USART_CR1_UE BIT(13)
#define USART_CR3_EIE BIT(0)
#define USART_CR3_DMAR BIT(6)
#define USART_CR3_DMAT BIT(7)
#define USART_CR3_RTSE BIT(8)
#define USART_CR3_CTSE BIT(9)

// "SPI registers".
struct spi {
    volatile uint32_t cr1, cr2, sr, dr, crcpr, rxcrcr, txcrcr, i2scfgr, i2spr;
};
#define SPI1 AT(spi, 0x40013000)
#define SPI_CR1_MSTR BIT(2)
#define SPI_CR1_BR(n) ((uint32_t)(n) << 3)
#define SPI_CR1_SPE BIT(6)
#define SPI_CR1_SSI BIT(8)
#define SPI_CR1_SSM BIT(9)
#define SPI_CR2_RXDMAEN BIT(0)
#define SPI_CR2_TXDMAEN BIT(1)
#define SPI_SR_BSY BIT(7)

// "ADC registers", and "ADC common control register".
struct adc {
    volatile uint32_t sr, cr1, cr2, smpr1, smpr2, jofr[4], htr, ltr, sqr1, sqr2, sqr3,
        jsqr, jdr[4], dr;
};
#define ADC1 AT(adc, 0x40012000)
#define ADC_COMMON_CCR (*(volatile uint32_t *)0x40012304)
#define ADC_SR_EOC BIT(1)
#define ADC_CR2_ADON BIT(0)
#define ADC_CR2_SWSTART BIT(30)
#define ADC_SMPR1_480(channel) (UINT32_C(7) << (3 * ((channel)-10)))
#define ADC_CCR_ADCPRE_4 BIT(16)
#define ADC_CCR_TSVREFE BIT(23)

// "IWDG registers".
struct iwdg {
    volatile uint32_t kr, pr, rlr, sr;
};
#define IWDG AT(iwdg, 0x40003000)
enum { IWDG_UNLOCK = 0x5555, IWDG_RELOAD = 0xAAAA, IWDG_START = 0xCCCC };

// PM0214, "SysTick timer".
struct systick {
    volatile uint32_t csr, rvr, cvr;
};
#define SYSTICK AT(systick, 0xE000E010)
#define SYSTICK_ENABLE BIT(0)
#define SYSTICK_INTERRUPT BIT(1)
#define SYSTICK_CPU_CLOCK BIT(2)

// PM0214, "Nested vectored interrupt controller". One byte of ipr a line, of which the
// high four bits count; 0 is the most urgent.
struct nvic {
    volatile uint32_t iser[32], icer[32], ispr[32], icpr[32], iabr[64];
    volatile uint8_t ipr[240];
};
#define NVIC AT(nvic, 0xE000E100)

// PM0214, "System control block".
struct scb {
    volatile uint32_t cpuid, icsr, vtor, aircr, scr, ccr;
    volatile uint8_t shpr[12];  // of exception 4 on
    volatile uint32_t shcsr, cfsr, hfsr, dfsr, mmfar, bfar;
};
#define SCB AT(scb, 0xE000ED00)
#define SCB_AIRCR_RESET (UINT32_C(0x05FA) << 16 | BIT(2))
#define SCB_SCR_SLEEPDEEP BIT(2)
#define SCB_CCR_DIV_0_TRP BIT(4)
#define SCB_CPACR (*(volatile uint32_t *)0xE000ED88)
#define SCB_CPACR_FPU (UINT32_C(0xF) << 20)

// "Device electronic signature", and the data sheet's "Embedded reference voltage".
#define UNIQUE_ID ((const volatile uint32_t *)0x1FFF7A10)  // three words
#define VREFINT_CAL (*(const volatile uint16_t *)0x1FFF7A2A)

// Interrupt lines ("Vector table for STM32F405xx/07xx").
enum irq {
    IRQ_EXTI1 = 7,
    IRQ_EXTI3 = 9,
    IRQ_DMA1_STREAM5 = 16,
    IRQ_DMA1_STREAM6 = 17,
    IRQ_TIM3 = 29,
    IRQ_I2C1_EVENT = 31,
    IRQ_I2C1_ERROR = 32,
    IRQ_USART2 = 38,
    IRQ_DMA2_STREAM2 = 58,
    IRQ_LINES = 82,
};

#endif
