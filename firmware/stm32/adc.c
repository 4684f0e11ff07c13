// SPDX-License-Identifier: MIT
// The converter measures the reference inside, whose voltage the maker has measured
// against a supply of 3.3 V: what it reads now gives the supply, and with that the
// battery.
#include "adc.h"

#include <stdbool.h>

#include "../board.h"
#include "clock.h"
#include "core/drivers/battery.h"
#include "cpu.h"
#include "gpio.h"
#include "pins.h"

enum {
    CHANNEL_BATTERY = 10,
    CHANNEL_VREFINT = 17,
    CALIBRATED_AT_MV = 3300,  // data sheet, "Embedded reference voltage"
    FULL_SCALE = 4095,
    TURNS_MAX = 2000,   // a conversion takes 3900 cycles, a turn four and more
    SETTLE_US = 20,     // 3 us of the converter, 10 of the reference
    TOUCH_US = 2,       // fills what an open pin holds, some 10 pF, through 40 kohm
    OPEN_COUNTS = 400,  // what is left of that on an open pin, at least; 0.3 V
};

void adc_init(void) {
    // 84 MHz / 4 is below the converter's 36; 480 cycles of it are 23 us: for the
    // reference, which asks for 10 (data sheet, "Embedded reference voltage"), and for
    // the 50 kohm of the divider ("12-bit ADC characteristics", "R_AIN").
    ADC_COMMON_CCR = ADC_CCR_ADCPRE_4 | ADC_CCR_TSVREFE;
    ADC1->smpr1 = ADC_SMPR1_480(CHANNEL_VREFINT) | ADC_SMPR1_480(CHANNEL_BATTERY);
    ADC1->cr2 = ADC_CR2_ADON;
    const uint32_t begun = clock_us();
    while (clock_us() - begun < SETTLE_US) {
    }
}

static void start(uint8_t channel) {
    ADC1->sqr3 = channel;
    ADC1->cr2 = ADC_CR2_ADON | ADC_CR2_SWSTART;
}

// Counts, 0 where the converter does not end.
static uint32_t result(void) {
    for (uint16_t i = 0; i < TURNS_MAX; i++) {
        if ((ADC1->sr & ADC_SR_EOC) != 0) {
            return ADC1->dr;
        }
    }
    return 0;
}

uint16_t board_supply_mv(void) {
    const uint32_t calibration = VREFINT_CAL;
    start(CHANNEL_VREFINT);
    const uint32_t counts = result();
    if (counts == 0 || calibration == 0 || calibration > FULL_SCALE) {
        return 0;
    }
    const uint32_t mv = CALIBRATED_AT_MV * calibration / counts;
    return mv <= UINT16_MAX ? (uint16_t)mv : 0;
}

// The battery's pin a moment after it was pulled. An analog pin has no pull ("Analog
// configuration"): a divider is back at its level at once, what is open stays.
static uint32_t touched(enum gpio_pull pull) {
    gpio_set_pull(GPIOC, PIN_BATTERY, pull);
    const uint32_t primask = cpu_mask();
    gpio_set_mode(GPIOC, PIN_BATTERY, GPIO_INPUT);
    const uint32_t begun = clock_us();
    while (clock_us() - begun <= TOUCH_US) {
    }
    gpio_set_mode(GPIOC, PIN_BATTERY, GPIO_ANALOG);
    start(CHANNEL_BATTERY);
    cpu_unmask(primask);
    gpio_set_pull(GPIOC, PIN_BATTERY, GPIO_NO_PULL);
    return result();
}

uint16_t adc_battery_mv(void) {
    const uint32_t supply_mv = board_supply_mv();
    const uint32_t up = touched(GPIO_PULL_UP);
    const uint32_t down = touched(GPIO_PULL_DOWN);
    if (supply_mv == 0 || up > down + OPEN_COUNTS) {
        return BATTERY_UNKNOWN;
    }
    // Twice the mean of both, each 4095 at most: fits where the supply does.
    const uint32_t mv = (up + down) * supply_mv / FULL_SCALE;
    return mv < BATTERY_UNKNOWN ? (uint16_t)mv : BATTERY_UNKNOWN;
}

// Asked for only where the silicon brings no id, which this one does.
uint16_t board_entropy(void) {
    return (uint16_t)clock_us();
}
