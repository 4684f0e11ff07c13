// SPDX-License-Identifier: MIT
// Pins: the ports (GPIO), the edge detectors (EXTI) and the choice of their pins
// (SYSCFG).
#ifndef SIM_F405_PERIPHERALS_PINS_H
#define SIM_F405_PERIPHERALS_PINS_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_port {
    uint32_t moder, otyper, ospeedr, pupdr, odr, afr[2];
    uint16_t levels;  // as last seen by edge detectors
};

struct f405_exti {
    uint32_t imr, emr, rtsr, ftsr, pr;
    uint32_t exticr[4], memrmp, pmc;
};

void pins_reset(struct f405 *m, unsigned port);
// Something outside or inside that drives pins has changed.
void pins_follow(struct f405 *m);
void pins_follow_port(struct f405 *m, unsigned port);
bool pins_level(const struct f405 *m, unsigned port, unsigned pin);
// Whether the pin is in that alternate function.
bool pins_is_alternate(const struct f405 *m, unsigned port, unsigned pin, unsigned af);
uint32_t pins_read(struct f405 *m, unsigned unit, uint32_t at);
void pins_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

// Whether an edge can end STOP mode.
bool exti_can_wake(const struct f405 *m);
void exti_reset(struct f405 *m, unsigned unit);
uint32_t exti_read(struct f405 *m, unsigned unit, uint32_t at);
void exti_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void syscfg_reset(struct f405 *m, unsigned unit);
uint32_t syscfg_read(struct f405 *m, unsigned unit, uint32_t at);
void syscfg_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
