// SPDX-License-Identifier: MIT
// The wiring of a pyboard (docs/f405.md), and its clocks.
#ifndef PINS_H
#define PINS_H

#if F_CPU != 168000000
#error "baud rate, bus clock and device clock are made for 168 MHz"
#endif

enum {
    HSI_MHZ = 16,
    // "Clocks": AHB 168 MHz, APB1 / 4, APB2 / 2; a timer of a divided bus runs at twice
    // its clock.
    APB1_HZ = 42000000,
    APB2_HZ = 84000000,
    APB1_TIMER_MHZ = 84,

    // Port A.
    PIN_CTS = 0,  // X1, alternate function 7: USART2. The RN-41's RTS; low: it listens
    PIN_RTS = 1,  // X2, the RN-41's CTS
    PIN_TXD = 2,  // X3
    PIN_RXD = 3,  // X4
    PIN_CARD_SELECT = 4,  // X5, low: selected
    PIN_CARD_CLOCK = 5,   // X6, alternate function 5: SPI1
    PIN_CARD_MISO = 6,    // X7
    PIN_CARD_MOSI = 7,    // X8
    PIN_SWDIO = 13,
    PIN_SWCLK = 14,
    // Port B.
    // Y11: DRDY_G of the sensor, high until its reading is read. Alternate function 2:
    // channel 3 of TIM3.
    PIN_DATA_READY = 0,
    PIN_BUTTON = 3,        // USR on the board, X17: to ground
    PIN_LED = 4,           // blue, on the board: high is on
    PIN_MMA_SUPPLY = 5,    // of the board's own accelerometer, on the same bus: off
    PIN_SCL = 6,           // X9, alternate function 4: I2C1
    PIN_SDA = 7,           // X10
    PIN_LINK = 12,         // Y5, the RN-41's PIO2, high while a host is connected
    PIN_RADIO_RESET = 13,  // Y6, its RESET_N, open drain
    // Port C.
    PIN_BATTERY = 0,      // X19: channel 10 of ADC1, half its voltage
    PIN_SUPPLY_GOOD = 1,  // X20, the BQ24072's PGOOD, open drain: low is yes
    PIN_CHARGING = 2,     // X21, its CHG, likewise
    PIN_BUSY = 6,  // Y1: high from the taking of a sample until the next look for one

    ALTERNATE_TIM3 = 2,
    ALTERNATE_I2C1 = 4,
    ALTERNATE_SPI1 = 5,
    ALTERNATE_USART2 = 7,
};

#endif
