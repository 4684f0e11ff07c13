// SPDX-License-Identifier: MIT
// Devices wired to the pins beside sensor and card: a radio on USART2, a Li-ion cell on
// a divider, and its charger, a BQ24072.
#include "chips/rn41.h"
#include "f405/f405.h"

enum {
    PIN_RADIO_RTS = 0,     // PA0
    PIN_RADIO_PIO2 = 12,   // PB12
    PIN_RADIO_RESET = 13,  // PB13
    PIN_BATTERY = 0,       // PC0
    PIN_PGOOD = 1,         // PC1, PC2: open drain, low is yes
    PIN_CHG = 2,
    MODE_INPUT = 0,
    MODE_OUTPUT = 1,
    PULL_UP = 1,
    PULL_DOWN = 2,
    PULL_OHMS = 40000,     // DS, "I/O static characteristics", typical
    DIVIDER_OHMS = 50000,  // 100k and 100k, seen from their middle
    THRESHOLD_MV = F405_SUPPLY_MV / 2,
};

// Battery

static uint32_t battery_mv(const struct f405 *m) {
    const struct f405_wired *wired = &m->wired;
    const uint64_t gone = f405_when(m) - wired->from_ps;
    if (wired->for_ps == 0 || gone >= wired->for_ps) {
        return wired->to_mv;
    }
    const double part = (double)gone / (double)wired->for_ps;
    return (uint32_t)((double)wired->from_mv +
                      part * ((double)wired->to_mv - (double)wired->from_mv) + 0.5);
}

void f405_battery(struct f405 *m, uint32_t from_mv, uint32_t to_mv, uint64_t for_ps) {
    struct f405_wired *wired = &m->wired;
    wired->has_battery = true;
    wired->from_mv = from_mv;
    wired->to_mv = to_mv;
    wired->from_ps = f405_when(m);
    wired->for_ps = for_ps;
}

void f405_charger(struct f405 *m, bool is_external, bool is_charging) {
    m->wired.is_external = is_external;
    m->wired.is_charging = is_charging;
    pins_follow_port(m, PORT_C);
}

// What the pin itself drives: its level and, in *ohms, the resistance behind it; 0:
// nothing.
static double own_mv(const struct f405 *m, double *ohms) {
    const struct f405_port *port = &m->ports[PORT_C];
    const unsigned mode = (port->moder >> (2 * PIN_BATTERY)) & 3;
    const unsigned pull = (port->pupdr >> (2 * PIN_BATTERY)) & 3;
    const bool is_high = ((port->odr >> PIN_BATTERY) & 1) != 0;
    *ohms = 0.0;
    if (mode == MODE_OUTPUT && (!is_high || ((port->otyper >> PIN_BATTERY) & 1) == 0)) {
        *ohms = 50.0;
        return is_high ? F405_SUPPLY_MV : 0.0;
    }
    // An analog pin has no pulls (RM, "Analog configuration").
    if ((mode == MODE_INPUT || mode == MODE_OUTPUT) &&
        (pull == PULL_UP || pull == PULL_DOWN)) {
        *ohms = PULL_OHMS;
        return pull == PULL_UP ? F405_SUPPLY_MV : 0.0;
    }
    return 0.0;
}

void wired_settle(struct f405 *m) {
    double ohms = 0.0;
    const double mv = own_mv(m, &ohms);
    if (ohms > 0.0) {
        m->wired.pin_mv = mv;
    }
}

double wired_analog_mv(const struct f405 *m, double *ohms) {
    double own_ohms = 0.0;
    const double own = own_mv(m, &own_ohms);
    if (!m->wired.has_battery) {
        *ohms = own_ohms;
        return m->wired.pin_mv;
    }
    const double half = battery_mv(m) / 2.0;
    *ohms = DIVIDER_OHMS;
    if (own_ohms == 0.0) {
        return half;
    }
    *ohms = DIVIDER_OHMS * own_ohms / (DIVIDER_OHMS + own_ohms);
    return (half * own_ohms + own * DIVIDER_OHMS) / (DIVIDER_OHMS + own_ohms);
}

// Levels

int wired_level(const struct f405 *m, unsigned port, unsigned pin) {
    const struct f405_wired *wired = &m->wired;
    if (port == PORT_C && pin == PIN_BATTERY) {
        double ohms = 0.0;
        return wired_analog_mv(m, &ohms) > THRESHOLD_MV ? 1 : 0;
    }
    if (port == PORT_C && wired->has_battery) {
        return (pin == PIN_PGOOD && wired->is_external) ||
                       (pin == PIN_CHG && wired->is_charging)
                   ? 0
                   : -1;
    }
    if (m->radio == NULL) {
        return -1;
    }
    if (port == PORT_A && pin == PIN_RADIO_RTS) {
        return wired->rts;
    }
    if (port == PORT_B && pin == PIN_RADIO_PIO2) {
        return wired->pio2;
    }
    return port == PORT_B && pin == PIN_RADIO_RESET ? 1 : -1;  // pulled up inside
}

// Radio

void wired_tell_host(struct f405 *m) {
    uint8_t byte = 0;
    while (rn41_chip_host_read(m->radio, &byte)) {
        if (m->on_byte != NULL) {
            m->on_byte(m->context, byte);
        }
    }
}

static void follow_outputs(struct f405 *m) {
    struct rn41_chip *radio = m->radio;
    struct f405_wired *wired = &m->wired;
    const int rts = rn41_chip_rts(radio);
    const int pio2 = rn41_chip_pio2(radio);
    if (rts != wired->rts) {
        wired->rts = rts;
        pins_follow_port(m, PORT_A);
        usart_follow_cts(m);
    }
    if (pio2 != wired->pio2) {
        wired->pio2 = pio2;
        pins_follow_port(m, PORT_B);
    }
}

static void plan(struct f405 *m) {
    const uint64_t next = rn41_chip_next_event(m->radio);
    if (next > F405_NEVER / 2000) {
        f405_never(m, EVENT_RADIO);
        return;
    }
    const uint64_t soon = f405_when(m) + 1;
    f405_at(m, EVENT_RADIO, next * 1000 > soon ? next * 1000 : soon);
}

void wired_follow(struct f405 *m) {
    struct rn41_chip *radio = m->radio;
    struct f405_wired *wired = &m->wired;
    if (radio == NULL) {
        return;
    }
    uint8_t byte = 0;
    uint32_t baud = 0;
    while (rn41_chip_take(radio, &byte, &baud)) {
        usart_deliver(m, byte, baud);
    }
    const uint64_t now_ns = f405_ns(f405_when(m));
    const bool is_cts_high = usart_rts(m) == 1;
    const bool is_reset_low = !pins_level(m, PORT_B, PIN_RADIO_RESET);
    if (is_cts_high != wired->is_cts_high) {
        wired->is_cts_high = is_cts_high;
        rn41_chip_set_cts(radio, now_ns, is_cts_high);
        wired_tell_host(m);
    }
    if (is_reset_low != wired->is_reset_low) {
        wired->is_reset_low = is_reset_low;
        rn41_chip_set_reset(radio, now_ns, is_reset_low);
        wired_tell_host(m);
    }
    if (rn41_chip_is_sending(radio)) {
        f405_never(m, EVENT_USART_IDLE);  // its start bit comes before
    }
    follow_outputs(m);
    plan(m);
}

void wired_event(struct f405 *m) {
    rn41_chip_advance(m->radio, f405_ns(f405_when(m)));
    wired_tell_host(m);
    wired_follow(m);
}

void wired_power_up(struct f405 *m) {
    m->wired.rts = m->wired.pio2 = -1;
    m->wired.pin_mv = f405_random(m) % F405_SUPPLY_MV;
    wired_follow(m);
}
