// SPDX-License-Identifier: MIT
// Stop mode is entered at the start of a program, not at the end of one: a watchdog
// that has been started runs in it too ("Stop mode", "IWDG main features"), until a
// reset.
#include "power.h"

#include "../board.h"
#include "adc.h"
#include "clock.h"
#include "core/drivers/battery.h"
#include "cpu.h"
#include "gpio.h"
#include "pins.h"

enum {
    AWAKE_AFTER_US = 50000,     // of the button or the supply without a break
    RELEASED_US_MAX = 3000000,  // of the button, which then is stuck
    PERIOD_US = BATTERY_PERIOD_MS * 1000,
};

// Numbers that memory is unlikely to contain by chance.
enum { MARK_SLEEP = 0x051EEBED };

__attribute__((section(".noinit"))) static struct { uint32_t mark, inverse; } wish;

static struct battery battery;
static uint32_t stepped_us;

static bool is_supply_good(void) {
    return !gpio_is_high(GPIOC, PIN_SUPPLY_GOOD);
}

// Pins of a start whose ports are as after a reset: what sleeps or draws no current,
// but for those of a debugger.
static void pins_sleep(void) {
    GPIOA->bsrr = BIT(PIN_CARD_SELECT);
    GPIOA->moder |= ~(UINT32_C(3) << (2 * PIN_SWDIO) | UINT32_C(3) << (2 * PIN_SWCLK));
    gpio_set_mode(GPIOA, PIN_CARD_SELECT, GPIO_OUTPUT);
    GPIOB->pupdr = 0;
    GPIOB->moder = UINT32_MAX;
    GPIOB->bsrr = BIT(PIN_RADIO_RESET) << 16;
    GPIOB->otyper = BIT(PIN_RADIO_RESET);
    gpio_set_mode(GPIOB, PIN_RADIO_RESET, GPIO_OUTPUT);
    gpio_set_pull(GPIOB, PIN_BUTTON, GPIO_PULL_UP);
    gpio_set_mode(GPIOB, PIN_BUTTON, GPIO_INPUT);
    GPIOC->moder = UINT32_MAX;
    gpio_set_pull(GPIOC, PIN_SUPPLY_GOOD, GPIO_PULL_UP);
    gpio_set_mode(GPIOC, PIN_SUPPLY_GOOD, GPIO_INPUT);
}

// Until an edge. By WFI: after WFE a debugger that keeps the clocks on would lose
// instructions (ES0182, "Debugging Stop mode with WFE entry"). Interrupts are off, so
// that the one that ends it does not enter.
static void stop(void) {
    EXTI->pr = BIT(PIN_BUTTON) | BIT(PIN_SUPPLY_GOOD);
    NVIC->icpr[0] = BIT(IRQ_EXTI1) | BIT(IRQ_EXTI3);
    if (is_supply_good()) {
        return;  // its edge has been before
    }
    // "Entering Stop mode". Main regulator in low power, flash off.
    PWR->cr = (PWR->cr & ~PWR_CR_PDDS) | PWR_CR_LPDS | PWR_CR_FPDS | PWR_CR_CWUF;
    SCB->scr |= SCB_SCR_SLEEPDEEP;
    __asm__ volatile("dsb\n\twfi\n\tisb" ::: "memory");
    SCB->scr &= ~SCB_SCR_SLEEPDEEP;
    PWR->cr &= ~(PWR_CR_LPDS | PWR_CR_FPDS);
}

static bool is_wanted(void) {
    const uint32_t begun = clock_us();
    while (board_button_is_down() || is_supply_good()) {
        if (clock_us() - begun >= AWAKE_AFTER_US) {
            return true;
        }
    }
    return false;
}

// The press that wakes is not one that starts a stream.
static void wait_for_release(void) {
    const uint32_t begun = clock_us();
    while (board_button_is_down() && clock_us() - begun < RELEASED_US_MAX) {
    }
}

bool power_start(void) {
    const bool is_wish = wish.mark == MARK_SLEEP && wish.inverse == ~wish.mark;
    wish.mark = 0;
    if (!is_wish || (RCC->csr & RCC_CSR_SFTRSTF) == 0) {
        return false;
    }
    RCC->csr |= RCC_CSR_RMVF;  // a reset from now on has its own cause
    RCC->ahb1enr |= RCC_AHB1_GPIOA | RCC_AHB1_GPIOB | RCC_AHB1_GPIOC;
    RCC->apb1enr |= RCC_APB1_PWR;
    RCC->apb2enr |= RCC_APB2_SYSCFG;
    (void)RCC->apb2enr;  // "Delay after an RCC peripheral clock enabling" (ES0182)
    cpu_barrier();
    pins_sleep();
    SYSCFG->exticr[PIN_BUTTON / 4] = SYSCFG_EXTICR(PIN_BUTTON, SYSCFG_PORT_B) |
                                     SYSCFG_EXTICR(PIN_SUPPLY_GOOD, SYSCFG_PORT_C);
    EXTI->ftsr = BIT(PIN_BUTTON) | BIT(PIN_SUPPLY_GOOD);
    EXTI->imr = BIT(PIN_BUTTON) | BIT(PIN_SUPPLY_GOOD);
    const uint32_t primask = cpu_mask();
    NVIC->iser[0] = BIT(IRQ_EXTI1) | BIT(IRQ_EXTI3);
    do {
        stop();
    } while (!is_wanted());
    wait_for_release();
    irq_disable(IRQ_EXTI1);
    irq_disable(IRQ_EXTI3);
    EXTI->imr = 0;
    EXTI->pr = BIT(PIN_BUTTON) | BIT(PIN_SUPPLY_GOOD);
    NVIC->icpr[0] = BIT(IRQ_EXTI1) | BIT(IRQ_EXTI3);
    cpu_unmask(primask);
    return true;
}

_Noreturn void power_sleep(void) {
    wish.mark = MARK_SLEEP;
    wish.inverse = ~wish.mark;
    board_reset();
}

void power_init(void) {
    gpio_set_pull(GPIOC, PIN_SUPPLY_GOOD, GPIO_PULL_UP);
    gpio_set_pull(GPIOC, PIN_CHARGING, GPIO_PULL_UP);
    gpio_set_mode(GPIOC, PIN_SUPPLY_GOOD, GPIO_INPUT);
    gpio_set_mode(GPIOC, PIN_CHARGING, GPIO_INPUT);
    battery_init(&battery);
    stepped_us = clock_us();
}

bool power_step(uint32_t now_us) {
    if (now_us - stepped_us < PERIOD_US) {
        return false;
    }
    stepped_us = now_us;
    const struct battery_reading reading = {
        .mv = adc_battery_mv(),
        .has_supply = is_supply_good(),
        .is_charge_low = !gpio_is_high(GPIOC, PIN_CHARGING),
    };
    return battery_step(&battery, &reading);
}

uint16_t power_battery_mv(void) {
    return battery.mv;
}

uint8_t power_flags(void) {
    return battery_power(&battery);
}
