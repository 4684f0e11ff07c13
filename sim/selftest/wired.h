// SPDX-License-Identifier: MIT
// What is wired where on the board of the processor that the programs are built for.
#ifndef SIM_SELFTEST_WIRED_H
#define SIM_SELFTEST_WIRED_H

#include <avr/io.h>

// D2, with its interrupt, and D3, the bus, and the converter's channel of the bandgap.
#ifdef __AVR_ATmega2560__
#define READY_vect INT4_vect
enum { READY = 4, READY_BIT = PE4, BUTTON_BIT = PE5, SDA_BIT = PD1, SCL_BIT = PD0 };
enum { BANDGAP = 30 };
#define READY_SENSE EICRB
#define WIRED_PORT PORTE
#define WIRED_DDR DDRE
#define WIRED_PIN PINE
#define LINES_DDR DDRD
#define LINES_PIN PIND
#else
#define READY_vect INT0_vect
enum { READY = 0, READY_BIT = PD2, BUTTON_BIT = PD3, SDA_BIT = PC4, SCL_BIT = PC5 };
enum { BANDGAP = 14 };
#define READY_SENSE EICRA
#define WIRED_PORT PORTD
#define WIRED_DDR DDRD
#define WIRED_PIN PIND
#define LINES_DDR DDRC
#define LINES_PIN PINC
#endif

#endif
