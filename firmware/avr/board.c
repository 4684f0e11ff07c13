// SPDX-License-Identifier: MIT
// The Arduino Nano as a whole: start-up of its parts, pins, identity, sleep.
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

// Pins that nothing is wired to get their pull-ups, so that they do not float
// ("Unconnected Pins"). The bus and the sensor's INT must not: they belong to a chip of
// 3.3 V, and the pull-ups here reach for 5 V.
static void pins_init(void) {
    PORTB = _BV(PB0) | _BV(PB1) | _BV(PB2) | _BV(PB3) | _BV(PB4);
    DDRB = _BV(PIN_LED);
    PORTC = _BV(PC0) | _BV(PC1) | _BV(PC2) | _BV(PC3);
    DDRC = 0;
    PORTD = (uint8_t)~_BV(PIN_DATA_READY);
    DDRD = _BV(PIN_TXD);
}

void board_init(void) {
    while ((EECR & _BV(EEPE)) != 0) {
        // A write from before the reset goes on, for 3.4 ms at most.
    }
    pins_init();
    clock_init();
    twi_init();
    uart_init();
    adc_init();
    SMCR = _BV(SE);  // sleep is idle mode: timer, TWI and UART go on
    sei();
}

uint8_t board_kind(void) {
    return BOARD_NANO;
}

uint8_t board_cycles_per_us(void) {
    return F_CPU / 1000000;
}

// The ATmega328P documents no serial number.
bool board_unique_id(uint8_t id[8]) {
    (void)id;
    return false;
}

bool board_button_is_down(void) {
    return (PIND & _BV(PIN_BUTTON)) == 0;
}

void board_led_set(bool on) {
    if (on) {
        PORTB |= _BV(PIN_LED);
    } else {
        PORTB &= (uint8_t)~_BV(PIN_LED);
    }
}

// The first byte from below that is not paint ends what was never used; there is one,
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
