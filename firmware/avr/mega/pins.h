// SPDX-License-Identifier: MIT
// What is wired where on an Arduino Mega 2560 (docs/nano.md), and its clock. Read by
// the assembler too.
//
// Sections are those of the ATmega2560's data sheet (DS40002211).
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#if F_CPU != 16000000
#error "baud rate, bus clock and device clock are made for 16 MHz"
#endif

#define DATA_READY_vect INT4_vect
#define WIRE_SENT_vect USART0_UDRE_vect
#define WIRE_RECEIVED_vect USART0_RX_vect
// The highest 8 KB, which the fuses of a Mega as sold have a reset start.
#define BOOTLOADER_START 0x3E000

#ifdef __ASSEMBLER__
// clang-format off

; Of timers and interfaces that this chip alone has.
    .macro quiet_others
    sts     TIMSK3, r1
    sts     TIMSK4, r1
    sts     TIMSK5, r1
    sts     UCSR1B, r1
    sts     UCSR2B, r1
    sts     UCSR3B, r1
    .endm

; r22: the causes of this start, of which the protocol has none by JTAG. r23: not 0
; where the bootloader does not stop a watchdog. Those of a Mega leave the UART on, and
; those that do stop it clear MCUSR.
    .macro look_at_bootloader
    andi    r22, _BV(WDRF) | _BV(BORF) | _BV(EXTRF) | _BV(PORF)
    lds     r23, UCSR0B
    cpse    r23, r1
    mov     r23, r22
    .endm

// clang-format on
#else

#include <stdbool.h>
#include <stdint.h>

#define PINS_BOARD BOARD_MEGA
#define LED_PORT PORTB

enum {
    PIN_TXD = PE1,         // 1
    PIN_DATA_READY = PE4,  // 2: INT of the sensor, driven high and low by it
    PIN_BUTTON = PE5,      // 3: to ground
    PIN_LED = PB7,         // 13, on the board: high is on
    PIN_SDA = PD1,         // 20
    PIN_SCL = PD0,         // 21
    PIN_FLOATING = PF7,    // A7: nothing is connected
    ADC_FLOATING = 7,
    ADC_BANDGAP = 30,  // table "Input Channel Selections", MUX5 being 0
};

// Pins that nothing is wired to get their pull-ups, so that they do not float
// ("Unconnected Pins"). The bus and the sensor's INT must not: they belong to a chip of
// 3.3 V, and the pull-ups here reach for 5 V. Nor the pin whose noise is wanted.
static inline void pins_init(void) {
    PORTA = PORTC = PORTG = PORTH = PORTJ = PORTK = PORTL = 0xFF;
    PORTB = (uint8_t)~_BV(PIN_LED);
    DDRB = _BV(PIN_LED);
    PORTD = (uint8_t) ~(_BV(PIN_SDA) | _BV(PIN_SCL));
    DDRD = 0;
    PORTE = (uint8_t)~_BV(PIN_DATA_READY);
    DDRE = _BV(PIN_TXD);
    PORTF = (uint8_t)~_BV(PIN_FLOATING);
    DIDR0 = _BV(ADC7D);  // no current through its digital part
}

static inline bool pins_button_is_down(void) {
    return (PINE & _BV(PIN_BUTTON)) == 0;
}

// An interrupt at the rising edge of data-ready from now on, none of the past.
static inline void pins_data_ready_listen(void) {
    EICRB = _BV(ISC41) | _BV(ISC40);
    EIFR = _BV(INTF4);
    EIMSK = _BV(INT4);
}

static inline bool pins_bus_is_high(void) {
    const uint8_t lines = _BV(PIN_SDA) | _BV(PIN_SCL);
    return (PIND & lines) == lines;
}

_Static_assert(PIN_SDA == 1 && PIN_SCL == 0, "which is not as enum bus_lines has them");

static inline uint8_t pins_bus_swap(uint8_t lines) {
    return (uint8_t)((lines & 1) << 1 | (lines >> 1 & 1));
}

// A line is pulled low by being an output at 0, and let go by being an input, which all
// other pins of this port are. `lines`: enum bus_lines.
static inline void pins_bus_pull(uint8_t lines) {
    DDRD = pins_bus_swap(lines);
}

// The lines that are high.
static inline uint8_t pins_bus_look(void) {
    return pins_bus_swap(PIND);
}

#endif
#endif
