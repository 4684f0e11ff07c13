// SPDX-License-Identifier: MIT
// Receives an 8N1 frame that was sent at another rate.
#ifndef SIM_CHIPS_UART_H
#define SIM_CHIPS_UART_H

#include <stdbool.h>
#include <stdint.h>

enum {
    UART_BITS = 10,
    // Both sides together may be 3.33 % apart: the least that RM0090 promises for 8N1
    // ("USART receiver tolerance to clock deviation"). Beyond it nothing is promised.
    UART_TOLERANCE_PPM = 33300,
};

// Where both rates are near enough: the byte. Otherwise what the receiver's samples in
// the middle of its bits find in this frame and in the idle line after it, and never
// the byte. has_stop is false where it finds no stop bit. Rates in baud, not 0.
static inline uint8_t uart_sample(uint8_t sent, uint32_t from_baud, uint32_t to_baud,
                                  bool *has_stop) {
    const uint64_t apart =
        from_baud > to_baud ? from_baud - to_baud : to_baud - from_baud;
    *has_stop = true;
    if (apart * 1000000 <= (uint64_t)to_baud * UART_TOLERANCE_PPM) {
        return sent;
    }
    const uint32_t frame = 0xFFFFFC00U | 0x200U | ((uint32_t)sent << 1);
    uint8_t got = 0;
    for (uint64_t bit = 1; bit < UART_BITS; bit++) {
        const uint64_t at = (2 * bit + 1) * from_baud / (2 * (uint64_t)to_baud);
        const bool is_high = at >= UART_BITS || ((frame >> at) & 1) != 0;
        if (bit == UART_BITS - 1) {
            *has_stop = is_high;
        } else if (is_high) {
            got |= (uint8_t)(1U << (bit - 1));
        }
    }
    return got == sent ? (uint8_t)(got ^ 0x80) : got;
}

#endif
