// SPDX-License-Identifier: MIT
// What is wired where on an Arduino Nano (docs/nano.md), and its clock.
//
// Comments in this folder name sections of the ATmega328P data sheet (DS40002061B) by
// their titles, which all its editions share.
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#if F_CPU != 16000000
#error "baud rate, bus clock and device clock are made for 16 MHz"
#endif

enum {
    PIN_TXD = PD1,         // D1
    PIN_DATA_READY = PD2,  // D2: INT of the sensor, driven high and low by it
    PIN_BUTTON = PD3,      // D3: to ground
    PIN_LED = PB5,         // D13, on the board: high is on
    PIN_SDA = PC4,         // A4
    PIN_SCL = PC5,         // A5
    ADC_FLOATING = 7,      // A7: has no digital part; nothing is connected
};

#endif
