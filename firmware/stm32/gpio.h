// SPDX-License-Identifier: MIT
// One pin's mode and pull among those of its port. Not for interrupt handlers.
#ifndef GPIO_H
#define GPIO_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

enum gpio_pull { GPIO_NO_PULL = 0, GPIO_PULL_UP = 1, GPIO_PULL_DOWN = 2 };

static inline void gpio_set_pull(struct gpio *port, uint8_t pin, enum gpio_pull pull) {
    port->pupdr = (port->pupdr & ~(UINT32_C(3) << (2 * pin))) | (uint32_t)pull
                                                                    << (2 * pin);
}

static inline void gpio_set_mode(struct gpio *port, uint8_t pin, enum gpio_mode mode) {
    port->moder = (port->moder & ~(UINT32_C(3) << (2 * pin))) | (uint32_t)mode
                                                                    << (2 * pin);
}

static inline void gpio_set(struct gpio *port, uint8_t pin, bool is_high) {
    port->bsrr = is_high ? BIT(pin) : BIT(pin) << 16;
}

static inline bool gpio_is_high(const struct gpio *port, uint8_t pin) {
    return (port->idr & BIT(pin)) != 0;
}

#endif
