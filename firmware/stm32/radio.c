// SPDX-License-Identifier: MIT
// The board's side of core/drivers/rn41.h.
#include "radio.h"

#include "../board.h"
#include "clock.h"
#include "gpio.h"
#include "pins.h"
#include "uart.h"

static void send(const char *bytes, uint8_t length) {
    // A command that finds no room has no answer either.
    const bool is_sent = uart_send((const uint8_t *)bytes, length);
    (void)is_sent;
}

static bool is_linked(void) {
    return gpio_is_high(GPIOB, PIN_LINK);
}

static void hold_reset(bool is_held) {
    gpio_set(GPIOB, PIN_RADIO_RESET, !is_held);
}

static const struct rn41_port port = {
    .send = send,
    .receive = uart_receive,
    .set_baud = uart_set_baud,
    .is_linked = is_linked,
    .hold_reset = hold_reset,
};
static struct rn41 module;

void radio_init(void) {
    gpio_set(GPIOB, PIN_RADIO_RESET, true);
    GPIOB->otyper |= BIT(PIN_RADIO_RESET);
    gpio_set_mode(GPIOB, PIN_RADIO_RESET, GPIO_OUTPUT);
    gpio_set_pull(GPIOB, PIN_LINK, GPIO_PULL_UP);
    gpio_set_mode(GPIOB, PIN_LINK, GPIO_INPUT);
    uart_init(RN41_BAUD);
    uart_hold(true);
    uint8_t id[8] = {0};
    const bool has_id = board_unique_id(id);
    (void)has_id;
    char name[RN41_NAME_SIZE];
    rn41_name(name, id);
    rn41_begin(&module, &port, name, clock_us());
}

enum rn41_event radio_step(uint32_t now_us) {
    const bool carried = rn41_carries(&module);
    const enum rn41_event event = rn41_step(&module, now_us);
    if (carried && !rn41_carries(&module)) {
        uart_forget();  // what was meant for who is gone
    }
    uart_hold(module.state == RN41_LOOKING);
    if (event == RN41_LINKED) {
        // Ends whatever a torn frame has left at the host.
        static const uint8_t delimiter = 0;
        const bool is_sent = uart_send(&delimiter, sizeof delimiter);
        (void)is_sent;  // the ring is empty
    }
    return event;
}

enum radio radio_state(void) {
    switch (module.state) {
    case RN41_LOOKING:
        return RADIO_NONE;
    case RN41_CABLE:
        return RADIO_CABLE;
    case RN41_CONFIGURING:
        return RADIO_CONFIGURING;
    case RN41_WAITING:
        return RADIO_WAITING;
    case RN41_CONNECTED:
        return RADIO_CONNECTED;
    default:
        return RADIO_FAILED;
    }
}

uint16_t radio_resets(void) {
    return module.resets;
}

enum cause radio_cause(void) {
    switch (module.fault) {
    case RN41_SILENT:
        return CAUSE_TIMEOUT;
    case RN41_NO_FAULT:
        return CAUSE_NONE;
    default:
        return CAUSE_REJECTED;
    }
}

// While it is not known yet whether a cable is there, what is sent is kept for it.
bool board_send(const uint8_t *bytes, uint8_t length) {
    return (rn41_carries(&module) || module.state == RN41_LOOKING) &&
           uart_send(bytes, length);
}

bool board_send_is_idle(void) {
    return uart_is_idle();
}

int16_t board_receive(void) {
    if (module.state == RN41_CONFIGURING || module.state == RN41_FAILED) {
        return -1;  // the driver's
    }
    return uart_receive();
}

uint16_t board_receive_lost(void) {
    return uart_receive_lost();
}
