// SPDX-License-Identifier: MIT
// A firmware to try the virtual Nano with: says how it was reset, sends bytes back,
// reports the button, and does what some bytes ask for.
#include <avr/io.h>
#include <avr/sleep.h>

enum {
    COMMAND_EEPROM = 0xE0,  // write 4 bytes, 0xA0 to 0xA3, to addresses 8 to 11
    COMMAND_WILD = 0xE1,    // read where nothing is
    COMMAND_DEEP = 0xE2,    // use 300 bytes of stack
    COMMAND_ASLEEP = 0xE3,  // sleep with interrupts off
    COMMAND_WORK = 0xE4,    // mark 1000 cycles of work
    COMMAND_FLOOD = 0xE5,   // send 60000 bytes as fast as the line goes
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
        __builtin_avr_delay_cycles(999);  // and 1 for the OUT that ends it
        GPIOR0 = 0;
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
