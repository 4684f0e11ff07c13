// SPDX-License-Identifier: MIT
// An Arduino Nano or Mega as a whole: start-up of its parts, pins, identity, sleep.
#include "../board.h"

#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "adc.h"
#include "clock.h"
#include "core/wire/messages.h"
#include "idle.h"
#include "pins.h"
#include "start.h"
#include "twi.h"
#include "uart.h"

volatile bool idle_has_work;

void board_init(void) {
    while ((EECR & _BV(EEPE)) != 0) {
        // A write from before the reset continues for 3.4 ms at most.
    }
    pins_init();
    clock_init();
    twi_init();
    uart_init();
    adc_init();
    SMCR = _BV(SE);  // sleep is idle mode: timer, TWI and UART keep running
    sei();
}

uint8_t board_kind(void) {
    return PINS_BOARD;
}

uint8_t board_cycles_per_us(void) {
    return F_CPU / 1000000;
}

// Neither processor documents a serial number.
bool board_unique_id(uint8_t id[8]) {
    (void)id;
    return false;
}

bool board_button_is_down(void) {
    return pins_button_is_down();
}

void board_led_set(bool on) {
    if (on) {
        LED_PORT |= _BV(PIN_LED);
    } else {
        LED_PORT &= (uint8_t)~_BV(PIN_LED);
    }
}

// The first byte from below that is not paint ends the unused part; there is one,
// because where main returns to is not paint. About 9 cycles for two bytes.
uint16_t board_stack_free(void) {
    extern const uint8_t _end[];
    const uint8_t *byte = _end;
    while (byte[0] == STACK_PAINT && byte[1] == STACK_PAINT) {
        byte += 2;
    }
    if (byte[0] == STACK_PAINT) {
        byte++;
    }
    return (uint16_t)(byte - _end);
}

// An interrupt between the look at the flag and the sleep can't be missed: the
// instruction after `sei` runs before any handler ("Reset and Interrupt Handling").
void board_idle(void) {
    cli();
    while (!idle_has_work) {
        sei();
        sleep_cpu();
        cli();
    }
    idle_has_work = false;
    sei();
}

void board_pause(void) {
    // The next interrupt may be 5 ms away.
}
