// SPDX-License-Identifier: MIT
// What the self-test and its programs on the virtual Nano share.
#ifndef SIM_SELFTEST_PROBES_H
#define SIM_SELFTEST_PROBES_H

#include <stdbool.h>
#include <stdint.h>

enum {
    PROBE_ADDRESS = 0x6F0,
    PROBE_RESULTS = 0x700,  // 16-bit numbers, little endian
    PROBE_DONE = 0xD1,
};

enum probe {
    PROBE_TWI_FAST = 1,
    PROBE_TWI_SLOW,
    PROBE_TWI_FLAG,
    PROBE_TWI_BUS_HELD,
    PROBE_BUS_LINES,
    PROBE_INTERRUPT_ENTRY,
    PROBE_INTERRUPT_FLAGS,
    PROBE_EXTERNAL_FLAG,
    PROBE_UART_SEND,
    PROBE_UART_DOUBLE_BUFFER,
    PROBE_UART_BAUD_ORDER,
    PROBE_UART_POLLING,
    PROBE_UART_RECEIVE,
    PROBE_SLEEP,
    PROBE_EEPROM_TIME,
    PROBE_EEPROM_READY,
    PROBE_TIMER_PRELOAD,
    PROBE_TIMER_COMPARE,
    PROBE_WATCHDOG_RESET,
    PROBE_RESET_CAUSE,
    PROBE_ANALOG,
    PROBE_BUTTON,
};

#endif
