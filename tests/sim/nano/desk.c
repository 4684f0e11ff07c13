// SPDX-License-Identifier: MIT
// Firmware for tests of the virtual Nano: it sends the cause of its reset, echoes
// bytes, reports the button, and obeys the commands below.
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdbool.h>

enum {
    COMMAND_EEPROM = 0xE0,    // write 4 bytes, 0xA0 to 0xA3, to addresses 8 to 11
    COMMAND_WILD = 0xE1,      // read an address without memory
    COMMAND_DEEP = 0xE2,      // use 300 bytes of stack
    COMMAND_ASLEEP = 0xE3,    // sleep with interrupts off
    COMMAND_WORK = 0xE4,      // mark 1000 cycles of work
    COMMAND_SAMPLES = 0xE6,   // take 100 samples at 200 Hz, 40000 cycles of work each
    COMMAND_TOO_MUCH = 0xE7,  // the same with 88000 cycles, more than there are
    COMMAND_FLOOD = 0xE5,     // send 60000 bytes without pauses
};

static void send(uint8_t byte) {
    while (!(UCSR0A & (1 << UDRE0))) {
    }
    UDR0 = byte;
}

static void write_eeprom(void) {
    for (uint8_t i = 0; i < 4; i++) {
        EEAR = (uint16_t)(8 + i);
        EEDR = (uint8_t)(0xA0 + i);
        EECR |= 1 << EEMPE;
        EECR |= 1 << EEPE;
        while (EECR & (1 << EEPE)) {
        }
    }
}

static void twi_go(uint8_t control) {
    TWCR = (uint8_t)(control | (1 << TWINT) | (1 << TWEN));
    while (!(TWCR & (1 << TWINT))) {
    }
}

static void twi_send(uint8_t byte) {
    TWDR = byte;
    twi_go(0);
}

static void twi_stop(void) {
    TWCR = (1 << TWINT) | (1 << TWSTO) | (1 << TWEN);
    while (TWCR & (1 << TWSTO)) {
    }
}

static void set_register(uint8_t reg, uint8_t value) {
    twi_go(1 << TWSTA);
    twi_send(0xD0);
    twi_send(reg);
    twi_send(value);
    twi_stop();
}

static void take_samples(bool too_much) {
    TWBR = 12;
    set_register(26, 1);  // CONFIG: DLPF on
    set_register(25, 4);  // SMPLRT_DIV: 200 Hz
    set_register(56, 1);  // INT_ENABLE: data ready
    EICRA = (1 << ISC01) | (1 << ISC00);
    EIFR = 1 << INTF0;
    for (uint8_t sample = 0; sample < 100; sample++) {
        while (!(EIFR & (1 << INTF0))) {
        }
        EIFR = 1 << INTF0;
        twi_go(1 << TWSTA);
        twi_send(0xD0);
        twi_send(59);
        twi_go(1 << TWSTA);
        twi_send(0xD1);
        for (uint8_t i = 0; i < 14; i++) {
            twi_go(i < 13 ? 1 << TWEA : 0);
        }
        twi_stop();
        GPIOR0 = 1;
        if (too_much) {
            __builtin_avr_delay_cycles(88000);
        } else {
            __builtin_avr_delay_cycles(40000);
        }
        GPIOR0 = 0;
    }
    set_register(56, 0);
}

static void go_deep(void) {
    volatile uint8_t room[300];
    for (uint16_t i = 0; i < sizeof room; i++) {
        room[i] = (uint8_t)i;
    }
}

static void obey(uint8_t byte) {
    switch (byte) {
    case COMMAND_EEPROM:
        write_eeprom();
        break;
    case COMMAND_WILD:
        (void)*(volatile uint8_t *)0x4000;
        break;
    case COMMAND_DEEP:
        go_deep();
        break;
    case COMMAND_ASLEEP:
        sleep_enable();
        sleep_cpu();
        break;
    case COMMAND_WORK:
        GPIOR0 = 1;
        __builtin_avr_delay_cycles(999);  // the OUT below takes one more
        GPIOR0 = 0;
        break;
    case COMMAND_SAMPLES:
    case COMMAND_TOO_MUCH:
        take_samples(byte == COMMAND_TOO_MUCH);
        break;
    case COMMAND_FLOOD:
        for (uint16_t i = 0; i < 60000; i++) {
            send((uint8_t)(i % 251 + 1));
        }
        break;
    default:
        send(byte);
        return;
    }
    send(0);
}

int main(void) {
    TCCR1B = 1 << CS11;
    const uint8_t causes = MCUSR;
    MCUSR = 0;
    PORTD |= 1 << PD3;
    UCSR0A = 1 << U2X0;
    UBRR0L = 3;  // 500 kbaud
    UCSR0C = (1 << UCSZ01) | (1 << UCSZ00);
    UCSR0B = (1 << RXEN0) | (1 << TXEN0);
    send('R');
    send(causes);
    send(0);
    uint8_t was = PIND & (1 << PD3);
    for (;;) {
        if (UCSR0A & (1 << RXC0)) {
            obey(UDR0);
        }
        const uint8_t is = PIND & (1 << PD3);
        if (is != was) {
            was = is;
            send(is ? 'U' : 'D');
        }
    }
}
