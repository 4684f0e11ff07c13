// SPDX-License-Identifier: MIT
// What is wired where on an Arduino Nano (docs/nano.md), and its clock. Read by the
// assembler too.
//
// Comments in the folder above name sections of the ATmega328P data sheet (DS40002061B)
// by their titles, which all its editions share, and the ATmega2560's has them too.
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#if F_CPU != 16000000
#error "baud rate, bus clock and device clock are made for 16 MHz"
#endif

#define DATA_READY_vect INT0_vect
#define WIRE_SENT_vect USART_UDRE_vect
#define WIRE_RECEIVED_vect USART_RX_vect
// That of ATmegaBOOT, which a reset starts; others begin later.
#define BOOTLOADER_START 0x7800

#ifdef __ASSEMBLER__
// clang-format off

; Of timers and interfaces that this chip alone has.
    .macro quiet_others
    .endm

; r22: the causes of this start. r23: not 0 where the bootloader does not stop a
; watchdog. That is ATmegaBOOT, which leaves the UART on; no reset does.
    .macro look_at_bootloader
    lds     r23, UCSR0B
    .endm

// clang-format on
#else

#include <stdbool.h>
#include <stdint.h>

#define PINS_BOARD BOARD_NANO
#define LED_PORT PORTB

enum {
    PIN_TXD = PD1,         // D1
    PIN_DATA_READY = PD2,  // D2: INT of the sensor, driven high and low by it
    PIN_BUTTON = PD3,      // D3: to ground
    PIN_LED = PB5,         // D13, on the board: high is on
    PIN_SDA = PC4,         // A4
    PIN_SCL = PC5,         // A5
    ADC_FLOATING = 7,      // A7: has no digital part; nothing is connected
    ADC_BANDGAP = 14,      // table "Input Channel Selections"
};

// Pins that nothing is wired to get their pull-ups, so that they do not float
// ("Unconnected Pins"). The bus and the sensor's INT must not: they belong to a chip of
// 3.3 V, and the pull-ups here reach for 5 V.
static inline void pins_init(void) {
    PORTB = _BV(PB0) | _BV(PB1) | _BV(PB2) | _BV(PB3) | _BV(PB4);
    DDRB = _BV(PIN_LED);
    PORTC = _BV(PC0) | _BV(PC1) | _BV(PC2) | _BV(PC3);
    DDRC = 0;
    PORTD = (uint8_t)~_BV(PIN_DATA_READY);
    DDRD = _BV(PIN_TXD);
}

static inline bool pins_button_is_down(void) {
    return (PIND & _BV(PIN_BUTTON)) == 0;
}

// An interrupt at the rising edge of data-ready from now on, none of the past.
static inline void pins_data_ready_listen(void) {
    EICRA = _BV(ISC01) | _BV(ISC00);
    EIFR = _BV(INTF0);
    EIMSK = _BV(INT0);
}

static inline bool pins_bus_is_high(void) {
    const uint8_t lines = _BV(PIN_SDA) | _BV(PIN_SCL);
    return (PINC & lines) == lines;
}

_Static_assert(PIN_SCL == PIN_SDA + 1, "as enum bus_lines has them");

// A line is pulled low by being an output at 0, and let go by being an input, which all
// other pins of this port are. `lines`: enum bus_lines.
static inline void pins_bus_pull(uint8_t lines) {
    DDRC = (uint8_t)(lines << PIN_SDA);
}

// The lines that are high, and more bits.
static inline uint8_t pins_bus_look(void) {
    return PINC >> PIN_SDA;
}

#endif
#endif
