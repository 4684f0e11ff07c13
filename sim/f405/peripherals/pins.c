// SPDX-License-Identifier: MIT
// Pins: the ports, the lines of EXTI, the multiplexer in SYSCFG (RM, "General-purpose
// I/Os", "External interrupt/event controller", "SYSCFG").
#include "chips/lsm9ds0.h"
#include "chips/sdcard.h"
#include "f405/f405.h"

enum {
    MODER = 0x00,
    OTYPER = 0x04,
    OSPEEDR = 0x08,
    PUPDR = 0x0C,
    IDR = 0x10,
    ODR = 0x14,
    BSRR = 0x18,
    LCKR = 0x1C,
    AFRL = 0x20,
    AFRH = 0x24,
    MODE_INPUT = 0,
    MODE_OUTPUT = 1,
    MODE_ALTERNATE = 2,
    PULL_UP = 1,
    IMR = 0x00,
    EMR = 0x04,
    RTSR = 0x08,
    FTSR = 0x0C,
    SWIER = 0x10,
    PR = 0x14,
    EXTI_LINES = 0x7FFFFF,
    MEMRMP = 0x00,
    PMC = 0x04,
    EXTICR1 = 0x08,
    EXTICR4 = 0x14,
    CMPCR = 0x20,
    // What is connected where.
    PIN_DRDY_G = 0,   // PB0
    PIN_DRDY_XM = 1,  // PB1
    PIN_BUTTON = 3,   // PB3
    PIN_SCL = 6,      // PB6
    PIN_SDA = 7,      // PB7
    PIN_WORK = 6,     // PC6
    PIN_CARD = 4,     // PA4
};

static unsigned mode_of(const struct f405_port *port, unsigned pin) {
    return (port->moder >> (2 * pin)) & 3;
}

// What the world outside drives: 0, 1, or -1 for nothing.
static int outside(const struct f405 *m, unsigned port, unsigned pin) {
    if (port == PORT_A && pin == PIN_CARD && m->card != NULL) {
        return 1;  // the card's pull-up (SD 6.2: 50 kohm on CD/DAT3)
    }
    if (port != PORT_B) {
        return wired_level(m, port, pin);
    }
    switch (pin) {
    case PIN_DRDY_G:
    case PIN_DRDY_XM:
        return sensor_chip_pin_is_high(m->sensor, pin == PIN_DRDY_G
                                                      ? LSM9DS0_CHIP_DRDY_G
                                                      : LSM9DS0_CHIP_INT2_XM)
                   ? 1
                   : 0;
    case PIN_BUTTON:
        return m->is_button_down ? 0 : -1;
    case PIN_SCL:
    case PIN_SDA:
        return 1;  // pull-ups; a sensor that holds SDA is handled elsewhere
    default:
        return wired_level(m, port, pin);
    }
}

// What the pin itself drives.
static int inside(const struct f405 *m, unsigned number, unsigned pin) {
    const struct f405_port *port = &m->ports[number];
    if (mode_of(port, pin) != MODE_OUTPUT) {
        return -1;
    }
    const bool is_high = ((port->odr >> pin) & 1) != 0;
    const bool is_open_drain = ((port->otyper >> pin) & 1) != 0;
    return is_high ? (is_open_drain ? -1 : 1) : 0;
}

bool pins_level(const struct f405 *m, unsigned port, unsigned pin) {
    const int own = inside(m, port, pin);
    const int others = outside(m, port, pin);
    if (own == 0 || others == 0) {
        return false;
    }
    if (port == PORT_B && pin == PIN_SDA && i2c_is_held(m)) {
        return false;
    }
    if (own == 1 || others == 1) {
        return true;
    }
    // A floating pin reads low: the worst case for a button that needs a pull-up.
    return ((m->ports[port].pupdr >> (2 * pin)) & 3) == PULL_UP;
}

bool pins_is_alternate(const struct f405 *m, unsigned port, unsigned pin, unsigned af) {
    const struct f405_port *p = &m->ports[port];
    return mode_of(p, pin) == MODE_ALTERNATE &&
           ((p->afr[pin / 8] >> (4 * (pin % 8))) & 15) == af;
}

static void follow_lines(struct f405 *m);

static void tell_edge(struct f405 *m, unsigned port, unsigned pin, bool is_high) {
    struct f405_exti *exti = &m->exti;
    const uint32_t bit = UINT32_C(1) << pin;
    // Codes of EXTICR: 0 to 3 are A to D, 7 is H.
    const unsigned code = port == PORT_H ? 7 : port;
    if (((exti->exticr[pin / 4] >> (4 * (pin % 4))) & 15) == code &&
        ((is_high ? exti->rtsr : exti->ftsr) & bit) != 0) {
        exti->pr |= bit;
        follow_lines(m);
        if ((exti->emr & bit) != 0) {
            m->core.has_event = true;
            f405_attend(m);
        }
    }
    timer_edge(m, port, pin, is_high);
    if (port == PORT_B && pin == PIN_DRDY_G && is_high && m->on_data_ready != NULL) {
        m->on_data_ready(m->context);
    }
    if (port == PORT_C && pin == PIN_WORK && m->on_mark != NULL) {
        m->on_mark(m->context, is_high);
    }
    if (port == PORT_A && pin == PIN_CARD && m->card != NULL) {
        sdcard_chip_select(m->card, f405_ns(f405_when(m)), !is_high);
    }
}

void pins_follow_port(struct f405 *m, unsigned number) {
    struct f405_port *port = &m->ports[number];
    uint16_t levels = 0;
    for (unsigned pin = 0; pin < 16; pin++) {
        levels |= (uint16_t)(pins_level(m, number, pin) ? 1U << pin : 0U);
    }
    const uint16_t changed = levels ^ port->levels;
    port->levels = levels;
    for (unsigned pin = 0; pin < 16; pin++) {
        if (((changed >> pin) & 1) != 0) {
            tell_edge(m, number, pin, ((levels >> pin) & 1) != 0);
        }
    }
}

// The chip's pins may change with a byte on the bus and with time.
void pins_follow(struct f405 *m) {
    pins_follow_port(m, PORT_B);
    const uint64_t next = sensor_chip_next_event(m->sensor);
    if (next == UINT64_MAX) {
        f405_never(m, EVENT_CHIP);
        return;
    }
    const uint64_t soon = f405_when(m) + 1;
    f405_at(m, EVENT_CHIP, next * 1000 > soon ? next * 1000 : soon);
}

void f405_press(struct f405 *m, bool is_down) {
    m->is_button_down = is_down;
    pins_follow_port(m, PORT_B);
}

uint32_t pins_read(struct f405 *m, unsigned unit, uint32_t at) {
    const struct f405_port *port = &m->ports[unit];
    switch (at) {
    case MODER:
        return port->moder;
    case OTYPER:
        return port->otyper;
    case OSPEEDR:
        return port->ospeedr;
    case PUPDR:
        return port->pupdr;
    case IDR: {
        uint32_t levels = 0;
        for (unsigned pin = 0; pin < 16; pin++) {
            // An analog pin reads 0 (RM, "Analog configuration").
            if (mode_of(port, pin) != 3 && pins_level(m, unit, pin)) {
                levels |= UINT32_C(1) << pin;
            }
        }
        return levels;
    }
    case ODR:
        return port->odr;
    case BSRR:
        return 0;
    case AFRL:
    case AFRH:
        return port->afr[(at - AFRL) / 4];
    default:
        f405_not_modelled(m, "LCKR, or no register of a port");
        return 0;
    }
}

void pins_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    struct f405_port *port = &m->ports[unit];
    switch (at) {
    case MODER:
        port->moder = value;
        break;
    case OTYPER:
        port->otyper = value & 0xFFFF;
        break;
    case OSPEEDR:
        port->ospeedr = value;
        break;
    case PUPDR:
        port->pupdr = value;
        break;
    case IDR:
        break;
    case ODR:
        port->odr = value & 0xFFFF;
        break;
    case BSRR:  // setting wins (RM, "GPIO port bit set/reset register")
        port->odr = (port->odr & ~(value >> 16)) | (value & 0xFFFF);
        break;
    case AFRL:
    case AFRH:
        port->afr[(at - AFRL) / 4] = value;
        break;
    default:
        f405_not_modelled(m, "LCKR, or no register of a port");
        break;
    }
    if (unit == PORT_B &&
        (inside(m, PORT_B, PIN_DRDY_G) >= 0 || inside(m, PORT_B, PIN_DRDY_XM) >= 0)) {
        f405_complain(m, "a pin drives against the sensor's data-ready");
    }
    if (unit == PORT_C) {
        wired_settle(m);
    }
    pins_follow_port(m, unit);
    if (unit == PORT_B) {
        i2c_follow_pins(m);
    }
    if (unit == PORT_A) {
        usart_follow_cts(m);
    }
    if (unit <= PORT_B) {
        wired_follow(m);
    }
}

void pins_reset(struct f405 *m, unsigned port) {
    struct f405_port *p = &m->ports[port];
    const uint16_t levels = p->levels;
    *p = (struct f405_port){.levels = levels};
    if (port == PORT_A) {  // the debugger's pins
        p->moder = 0xA8000000;
        p->ospeedr = 0x0C000000;
        p->pupdr = 0x64000000;
    } else if (port == PORT_B) {
        p->moder = 0x00000280;
        p->ospeedr = 0x000000C0;
        p->pupdr = 0x00000100;
    }
}

// EXTI

static void follow_lines(struct f405 *m) {
    const uint32_t asked = m->exti.pr & m->exti.imr;
    for (unsigned line = 0; line < 5; line++) {
        core_irq(m, EXCEPTION_IRQ + IRQ_EXTI0 + line, ((asked >> line) & 1) != 0);
    }
    core_irq(m, EXCEPTION_IRQ + IRQ_EXTI9_5, (asked & 0x03E0) != 0);
    core_irq(m, EXCEPTION_IRQ + IRQ_EXTI15_10, (asked & 0xFC00) != 0);
}

// RM, "Stop mode", exit: an interrupt of a line that the NVIC lets through, or, of a
// WFE, an event.
bool exti_can_wake(const struct f405 *m) {
    const uint32_t imr = m->exti.imr;
    const bool *enabled = m->core.enabled + EXCEPTION_IRQ;
    for (unsigned line = 0; line < 5; line++) {
        if (((imr >> line) & 1) != 0 && enabled[IRQ_EXTI0 + line]) {
            return true;
        }
    }
    return ((imr & 0x03E0) != 0 && enabled[IRQ_EXTI9_5]) ||
           ((imr & 0xFC00) != 0 && enabled[IRQ_EXTI15_10]) ||
           (m->is_waiting && m->exti.emr != 0);
}

void exti_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    struct f405_exti *exti = &m->exti;
    exti->imr = exti->emr = exti->rtsr = exti->ftsr = exti->pr = 0;
}

uint32_t exti_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    const struct f405_exti *exti = &m->exti;
    const uint32_t values[] = {exti->imr,  exti->emr, exti->rtsr,
                               exti->ftsr, 0,         exti->pr};
    if (at > PR) {
        f405_not_modelled(m, "no register of EXTI");
        return 0;
    }
    return values[at / 4];
}

void exti_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_exti *exti = &m->exti;
    value &= EXTI_LINES;
    switch (at) {
    case IMR:
        exti->imr = value;
        break;
    case EMR:
        exti->emr = value;
        break;
    case RTSR:
        exti->rtsr = value;
        break;
    case FTSR:
        exti->ftsr = value;
        break;
    case SWIER:
        exti->pr |= value & exti->imr;
        break;
    case PR:
        exti->pr &= ~value;
        break;
    default:
        f405_not_modelled(m, "no register of EXTI");
        break;
    }
    follow_lines(m);
}

// SYSCFG

void syscfg_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    struct f405_exti *exti = &m->exti;
    exti->memrmp = exti->pmc = 0;
    for (unsigned i = 0; i < 4; i++) {
        exti->exticr[i] = 0;
    }
}

uint32_t syscfg_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    if (at >= EXTICR1 && at <= EXTICR4) {
        return m->exti.exticr[(at - EXTICR1) / 4];
    }
    if (at == CMPCR) {
        return 0;
    }
    return at == MEMRMP ? m->exti.memrmp : m->exti.pmc;
}

void syscfg_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    if (at >= EXTICR1 && at <= EXTICR4) {
        m->exti.exticr[(at - EXTICR1) / 4] = value & 0xFFFF;
    } else {
        f405_not_modelled(m, "SYSCFG but for EXTICR");
    }
}
