// SPDX-License-Identifier: MIT
// GP numbers, as printed on the back of a Pico.
#ifndef PINS_H
#define PINS_H

enum {
    PIN_TXD = 0,  // UART0
    PIN_RXD = 1,
    PIN_SDA = 4,  // I2C0
    PIN_SCL = 5,
    PIN_DATA_READY = 6,
    PIN_BUTTON = 15,  // to GND
    PIN_BUSY = 22,    // high while a sample is worked on
    PIN_LED = 25,     // on the board
    PIN_VSYS = 29,    // a third of the supply, on the board
};

// The input of the ADC that PIN_VSYS is.
enum { ADC_VSYS = 3 };

#endif
