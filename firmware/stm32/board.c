// SPDX-License-Identifier: MIT
// The STM32F405RG of a pyboard as a whole: start-up of its parts, pins, identity,
// sleep.
#include "../board.h"

#include "adc.h"
#include "clock.h"
#include "core/wire/messages.h"
#include "cpu.h"
#include "flash.h"
#include "generic/identity.h"
#include "idle.h"
#include "pins.h"
#include "power.h"
#include "radio.h"
#include "reset.h"
#include "sampling.h"
#include "start.h"

volatile bool idle_has_work;

// Fields of two bits a pin.
#define PAIR(pin, value) ((uint32_t)(value) << (2 * (pin)))
// Fields of four, of the pins 0 to 7.
#define NIBBLE(pin, value) ((uint32_t)(value) << (4 * (pin)))

enum { PULL_UP = 1, PULL_DOWN = 2, OPEN_DRAIN = 1 };

// The mode register of a port whose pins are all analog, which takes no current however
// their levels float, but for some: exclusive or with what those are.
#define ALL_ANALOG UINT32_C(0xFFFFFFFF)
#define MODE(pin, mode) PAIR(pin, GPIO_ANALOG ^ (mode))

static void pins_init(void) {
    // Debugging stays possible: its pins keep their function, and their pulls of reset.
    GPIOA->afr[0] =
        NIBBLE(PIN_TXD, ALTERNATE_USART2) | NIBBLE(PIN_RXD, ALTERNATE_USART2);
    GPIOA->pupdr = (GPIOA->pupdr & (PAIR(PIN_SWDIO, 3) | PAIR(PIN_SWCLK, 3))) |
                   PAIR(PIN_RXD, PULL_UP);  // an undriven line is idle
    GPIOA->moder = ALL_ANALOG ^ MODE(PIN_TXD, GPIO_ALTERNATE) ^
                   MODE(PIN_RXD, GPIO_ALTERNATE) ^ MODE(PIN_SWDIO, GPIO_ALTERNATE) ^
                   MODE(PIN_SWCLK, GPIO_ALTERNATE);

    GPIOB->bsrr =
        BIT(PIN_SCL) | BIT(PIN_SDA) | BIT(PIN_LED) << 16 | BIT(PIN_MMA_SUPPLY) << 16;
    GPIOB->otyper = (uint32_t)OPEN_DRAIN << PIN_SCL | (uint32_t)OPEN_DRAIN << PIN_SDA;
    GPIOB->afr[0] = NIBBLE(PIN_DATA_READY, ALTERNATE_TIM3) |
                    NIBBLE(PIN_SCL, ALTERNATE_I2C1) | NIBBLE(PIN_SDA, ALTERNATE_I2C1);
    GPIOB->pupdr =
        PAIR(PIN_BUTTON, PULL_UP) |
        PAIR(PIN_DATA_READY, PULL_DOWN);  // a wire that is off brings no edges
    GPIOB->moder = ALL_ANALOG ^ MODE(PIN_DATA_READY, GPIO_ALTERNATE) ^
                   MODE(PIN_BUTTON, GPIO_INPUT) ^ MODE(PIN_LED, GPIO_OUTPUT) ^
                   MODE(PIN_MMA_SUPPLY, GPIO_OUTPUT) ^ MODE(PIN_SCL, GPIO_ALTERNATE) ^
                   MODE(PIN_SDA, GPIO_ALTERNATE);

    GPIOC->moder = ALL_ANALOG ^ MODE(PIN_BUSY, GPIO_OUTPUT);
}

void board_init(void) {
    reset_init(power_start());
    clock_init();
    RCC->ahb1enr |= RCC_AHB1_GPIOA | RCC_AHB1_GPIOB | RCC_AHB1_GPIOC | RCC_AHB1_DMA1;
    RCC->apb1enr |= RCC_APB1_TIM3 | RCC_APB1_USART2 | RCC_APB1_I2C1;
    RCC->apb2enr |= RCC_APB2_ADC1;
    (void)RCC->apb2enr;  // "Delay after an RCC peripheral clock enabling" (ES0182)
    cpu_barrier();
    pins_init();
    flash_init();
    sampling_init();
    radio_init();
    adc_init();
    power_init();
    // What a reset cut short. A bus that stays held shows at the first transfer.
    const enum bus_result freed = board_bus_recover();
    (void)freed;
    reset_watch();
}

uint8_t board_kind(void) {
    return BOARD_F405;
}

bool board_unique_id(uint8_t id[8]) {
    const uint32_t words[3] = {UNIQUE_ID[0], UNIQUE_ID[1], UNIQUE_ID[2]};
    identity_fold((const uint8_t *)words, sizeof words, id);
    return true;
}

bool board_button_is_down(void) {
    return (GPIOB->idr & BIT(PIN_BUTTON)) == 0;
}

void board_led_set(bool on) {
    GPIOB->bsrr = on ? BIT(PIN_LED) : BIT(PIN_LED) << 16;
}

// The first word from below that is not paint ends what was never used; there is one,
// because start.c has not painted its own.
uint16_t board_stack_free(void) {
    uint16_t bytes = 0;
    const uint32_t *word = stack_bottom;
    for (; *word == STACK_PAINT; word++) {
        bytes = (uint16_t)(bytes + sizeof *word);
    }
    return bytes;
}

void board_idle(void) {
    const uint32_t primask = cpu_mask();
    while (!idle_has_work) {
        cpu_sleep();
    }
    idle_has_work = false;
    cpu_unmask(primask);
}

void board_pause(void) {
    board_idle();  // until the next tick
}
