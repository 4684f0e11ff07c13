// SPDX-License-Identifier: MIT
// USART0 as an asynchronous UART (data sheet 20): a byte's time follows from the
// registers at its start; a transmit buffer beside the shift register; a receive FIFO
// of two bytes. Replaces simavr's UART, which counts a parity bit that is not there,
// latches the rate early and has no buffer.
#include <simavr/avr_uart.h>
#include <string.h>

#include "machine.h"

enum {
    RXC = 1 << 7,
    TXC = 1 << 6,
    UDRE = 1 << 5,
    DOR = 1 << 3,
    U2X = 1 << 1,
    MPCM = 1 << 0,
    RXEN = 1 << 4,
    TXEN = 1 << 3,
    UCSZ2 = 1 << 2,
    UPM = 0x30,
    USBS = 1 << 3,
    FIFO_ROOM = 3,
};

// Data sheet 20.3.1.
static unsigned bit_cycles(const avr_t *avr) {
    const unsigned rate =
        ((avr->data[REG_UBRR0H] & 0x0FU) << 8) | avr->data[REG_UBRR0L];
    return (rate + 1U) * ((avr->data[REG_UCSR0A] & U2X) ? 8U : 16U);
}

// Data sheet 20.4: bits of a frame.
static unsigned byte_cycles(const avr_t *avr) {
    const uint8_t control = avr->data[REG_UCSR0C];
    unsigned bits = 1U + 5U + ((control >> 1) & 3U) + 1U;
    bits += (avr->data[REG_UCSR0B] & UCSZ2) ? 1U : 0U;
    bits += (control & UPM) ? 1U : 0U;
    bits += (control & USBS) ? 1U : 0U;
    return bits * bit_cycles(avr);
}

static void emit(struct machine *machine, uint64_t cycle, uint8_t byte) {
    if (machine->on_byte != NULL) {
        machine->on_byte(machine->context, cycle, byte);
    }
}

static avr_cycle_count_t on_sent(avr_t *avr, avr_cycle_count_t when, void *param) {
    struct machine *machine = param;
    struct machine_uart *uart = &machine->uart;
    emit(machine, when, uart->shift);
    uart->baud = MACHINE_HZ / bit_cycles(avr);
    if (uart->is_full) {
        uart->shift = uart->buffer;
        uart->is_full = false;
        avr->data[REG_UCSR0A] |= UDRE;
        machine_poll_interrupts(machine);
        return when + byte_cycles(avr);
    }
    uart->is_shifting = false;
    avr->data[REG_UCSR0A] |= TXC;
    machine_poll_interrupts(machine);
    return 0;
}

static void write_udr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)address;
    struct machine *machine = param;
    struct machine_uart *uart = &machine->uart;
    if (!(avr->data[REG_UCSR0B] & TXEN) || uart->is_full) {
        return;  // data sheet 20.11.1: ignored while UDRE is 0
    }
    if (uart->is_shifting) {
        uart->buffer = value;
        uart->is_full = true;
        avr->data[REG_UCSR0A] &= (uint8_t)~UDRE;
        return;
    }
    uart->shift = value;
    uart->is_shifting = true;
    avr_cycle_timer_register(avr, byte_cycles(avr), on_sent, machine);
}

static uint8_t read_udr(avr_t *avr, avr_io_addr_t address, void *param) {
    struct machine_uart *uart = &((struct machine *)param)->uart;
    const uint8_t value = uart->received[0];
    if (uart->received_count > 0) {
        uart->received_count--;
        memmove(uart->received, uart->received + 1, FIFO_ROOM - 1);
    }
    avr->data[REG_UCSR0A] &= (uint8_t)~DOR;
    if (uart->received_count == 0) {
        avr->data[REG_UCSR0A] &= (uint8_t)~RXC;
    }
    avr->data[address] = value;
    return value;
}

static void write_ucsra(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)param;
    uint8_t now = avr->data[address];
    now = (uint8_t)((now & ~(U2X | MPCM)) | (value & (U2X | MPCM)));
    if (value & TXC) {
        now &= (uint8_t)~TXC;
    }
    avr->data[address] = now;
}

static void write_ucsrb(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    struct machine *machine = param;
    avr->data[address] = value;
    if (!(value & RXEN)) {
        machine->uart.received_count = 0;
        avr->data[REG_UCSR0A] &= (uint8_t) ~(RXC | DOR);
    }
    machine_poll_interrupts(machine);
}

// The byte at the head of the line has arrived completely.
static avr_cycle_count_t on_received(avr_t *avr, avr_cycle_count_t when, void *param) {
    struct machine *machine = param;
    struct machine_uart *uart = &machine->uart;
    const uint8_t byte = line_take(&uart->line);
    if (!(avr->data[REG_UCSR0B] & RXEN)) {
        uart->deaf++;
    } else if (uart->received_count == FIFO_ROOM) {
        uart->overruns++;
        avr->data[REG_UCSR0A] |= DOR;
    } else {
        uart->received[uart->received_count++] = byte;
        avr->data[REG_UCSR0A] |= RXC;
        machine_poll_interrupts(machine);
    }
    if (uart->line.count == 0) {
        uart->is_receiving = false;
        return 0;
    }
    const uint64_t from = line_next(&uart->line);
    return (from > when ? from : when) + byte_cycles(avr);
}

static void begin_receiving(struct machine *machine) {
    struct machine_uart *uart = &machine->uart;
    avr_t *avr = machine->avr;
    if (uart->line.count == 0) {
        return;
    }
    const uint64_t from = line_next(&uart->line);
    const uint64_t wait = from > avr->cycle ? from - avr->cycle : 0;
    uart->is_receiving = true;
    avr_cycle_timer_register(avr, wait + byte_cycles(avr), on_received, machine);
}

static bool is_own(const struct machine *machine) {
    return machine_fixes(machine, FIX_UART_BYTE_TIME) &&
           machine_fixes(machine, FIX_UART_DOUBLE_BUFFER) &&
           machine_fixes(machine, FIX_UART_BAUD_ORDER) &&
           machine_fixes(machine, FIX_UART_POLLING);
}

bool machine_send(struct machine *machine, uint64_t from_cycle, uint8_t byte) {
    struct machine_uart *uart = &machine->uart;
    if (!line_put(&uart->line, from_cycle, byte)) {
        return false;
    }
    if (!uart->is_receiving) {
        begin_receiving(machine);
    }
    return true;
}

static void on_stock_byte(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    struct machine *machine = param;
    emit(machine, machine_now(machine), (uint8_t)value);
}

void uart_init(struct machine *machine) {
    if (!is_own(machine)) {
        avr_irq_register_notify(
            avr_io_getirq(machine->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
            on_stock_byte, machine);
        return;
    }
    avr_t *avr = machine->avr;
    machine_take(machine, REG_UDR0, write_udr, read_udr, NULL);
    machine_take(machine, REG_UCSR0A, write_ucsra, NULL, NULL);
    machine_take(machine, REG_UCSR0B, write_ucsrb, NULL, NULL);
    // Plain storage from here on.
    static const uint16_t plain[] = {REG_UCSR0C, REG_UBRR0L, REG_UBRR0H};
    for (size_t i = 0; i < sizeof plain / sizeof *plain; i++) {
        avr->io[AVR_DATA_TO_IO(plain[i])].w.c = NULL;
    }
    avr->io[AVR_DATA_TO_IO(REG_UCSR0A)].r.c = NULL;
    avr->io[AVR_DATA_TO_IO(REG_UCSR0B)].r.c = NULL;
}

void uart_reset(struct machine *machine) {
    if (!is_own(machine)) {
        return;
    }
    struct machine_uart *uart = &machine->uart;
    avr_t *avr = machine->avr;
    uart->is_shifting = false;
    uart->is_full = false;
    uart->received_count = 0;
    avr->data[REG_UCSR0A] = UDRE;
    avr->data[REG_UCSR0B] = 0;
    avr->data[REG_UCSR0C] = 0x06;
    avr->data[REG_UBRR0L] = 0;
    avr->data[REG_UBRR0H] = 0;
    begin_receiving(machine);
}

void uart_free(struct machine *machine) {
    line_free(&machine->uart.line);
}
