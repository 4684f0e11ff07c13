// SPDX-License-Identifier: MIT
// Frames go to USB while a program has its port open there, otherwise to UART0;
// commands come from either.
#include "wire.h"

#include "../board.h"
#include "hardware/gpio.h"
#include "hardware/irq.h"
#include "hardware/sync.h"
#include "hardware/timer.h"
#include "hardware/uart.h"
#include "idle.h"
#include "pico/bootrom.h"
#include "pins.h"
#include "tusb.h"

typedef uint16_t ring_index;
#include "generic/ring.h"

enum {
    BAUD = 921600,
    SENDING_SIZE = 16384,  // 0.18 s on the UART
    RECEIVED_SIZE = 1024,  // 11 ms
    HELD_US = 500000,      // without room on USB: there is no reader
    LOADER_BAUD = 1200,    // asks for the boot loader, as on other boards with USB
};

static uart_inst_t *const uart = uart0;

static uint8_t sending[SENDING_SIZE];
static volatile uint16_t sending_head;  // written by the main loop
static volatile uint16_t sending_tail;  // by the handler

static volatile uint8_t received[RECEIVED_SIZE];
static volatile uint16_t received_head;  // by the handler
static uint16_t received_tail;           // by the main loop
static volatile uint16_t lost;

static uint32_t usb_room, usb_moved_us;  // when its room last changed

// UART0

static void take_received(void) {
    while (uart_is_readable(uart)) {
        const uint32_t data = uart_get_hw(uart)->dr;
        const uint16_t next = (uint16_t)((received_head + 1) % RECEIVED_SIZE);
        const bool is_room = next != received_tail;
        if ((data & UART_UARTDR_OE_BITS) != 0 || !is_room) {
            lost++;
        }
        if (is_room) {
            received[received_head] = (uint8_t)data;
            received_head = next;
        }
        idle_has_work = true;
    }
}

static void put_sending(void) {
    while (sending_head != sending_tail && uart_is_writable(uart)) {
        uart_get_hw(uart)->dr = sending[sending_tail];
        sending_tail = (uint16_t)((sending_tail + 1) % SENDING_SIZE);
    }
    uart_set_irqs_enabled(uart, true, sending_head != sending_tail);
}

static void on_uart(void) {
    take_received();
    put_sending();
}

static bool uart_send(const uint8_t *bytes, uint8_t length) {
    if (length > ring_room(SENDING_SIZE, sending_head, sending_tail)) {
        return false;
    }
    sending_head = ring_write(sending, SENDING_SIZE, sending_head, bytes, length);
    const uint32_t mask = save_and_disable_interrupts();
    put_sending();
    restore_interrupts(mask);
    return true;
}

static bool uart_is_idle(void) {
    return sending_head == sending_tail &&
           (uart_get_hw(uart)->fr & UART_UARTFR_BUSY_BITS) == 0;
}

// USB

// By the rate together with a DTR that is not active: no program then uses the port.
static void enter_loader_if_asked(void) {
    cdc_line_coding_t coding;
    tud_cdc_get_line_coding(&coding);
    if (coding.bit_rate == LOADER_BAUD && !tud_cdc_connected()) {
        rom_reset_usb_boot(0, 0);
    }
}

// A host sets this when a program opens the port, even if DTR is still active from the
// one before, as imud leaves it. Unread bytes are not for the next program.
void tud_cdc_line_state_cb(uint8_t port, bool is_open, bool rts) {
    (void)port;
    (void)is_open;
    (void)rts;
    (void)tud_cdc_write_clear();
    enter_loader_if_asked();
}

void tud_cdc_line_coding_cb(uint8_t port, const cdc_line_coding_t *coding) {
    (void)port;
    (void)coding;
    enter_loader_if_asked();
}

// All has been read, or there is no reader.
static bool usb_is_idle(void) {
    const uint32_t room = tud_cdc_write_available();
    const uint32_t now_us = time_us_32();
    if (room != usb_room) {
        usb_room = room;
        usb_moved_us = now_us;
    }
    return room == CFG_TUD_CDC_TX_BUFSIZE || now_us - usb_moved_us > HELD_US;
}

static bool usb_send(const uint8_t *bytes, uint8_t length) {
    if (tud_cdc_write_available() < length) {
        return false;
    }
    (void)tud_cdc_write(bytes, length);
    return true;
}

// Both

void wire_init(void) {
    (void)uart_init(uart, BAUD);
    gpio_set_function(PIN_TXD, GPIO_FUNC_UART);
    gpio_set_function(PIN_RXD, GPIO_FUNC_UART);
    gpio_pull_up(PIN_RXD);  // an undriven line is idle
    irq_set_exclusive_handler(UART0_IRQ, on_uart);
    irq_set_enabled(UART0_IRQ, true);
    uart_set_irqs_enabled(uart, true, false);
    (void)tusb_init();
}

bool board_send(const uint8_t *bytes, uint8_t length) {
    return tud_cdc_connected() ? usb_send(bytes, length) : uart_send(bytes, length);
}

bool board_send_is_idle(void) {
    return (!tud_cdc_connected() || usb_is_idle()) && uart_is_idle();
}

// Each turn of the main loop asks until nothing comes, which moves USB on once.
int16_t board_receive(void) {
    uint8_t byte;
    if (tud_cdc_read(&byte, 1) == 1) {
        return byte;
    }
    tud_task();
    (void)tud_cdc_write_flush();
    if (received_tail == received_head) {
        return -1;
    }
    byte = received[received_tail];
    received_tail = (uint16_t)((received_tail + 1) % RECEIVED_SIZE);
    return byte;
}

uint16_t board_receive_lost(void) {
    return lost;
}
