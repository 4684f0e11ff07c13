// SPDX-License-Identifier: MIT
// Small programs on a virtual AVR that measure how its hardware behaves. The host puts
// the number of one into PROBE, waits for GPIOR2 and reads numbers from RESULT.
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "probes.h"
#include "wired.h"

// Beyond the variables and below the stack: start-up code leaves it alone.
#define PROBE (*(volatile uint8_t *)PROBE_ADDRESS)
#define RESULT ((volatile uint16_t *)PROBE_RESULTS)

static volatile uint8_t count;
static uint8_t causes;  // of the reset, MCUSR

// Of Timer1, which runs.
static void delay_ticks(uint16_t ticks) {
    const uint16_t from = TCNT1;
    while ((uint16_t)(TCNT1 - from) < ticks) {
    }
}

// The two-wire interface by interrupt: START, an address, a register.

static volatile uint8_t twi_step;

ISR(TWI_vect) {
    const uint16_t time = TCNT1;
    static const uint8_t bytes[] = {0xD0, 0x75};  // the sensor for writing, WHO_AM_I
    const uint8_t step = twi_step;
    RESULT[2 * step] = time;
    RESULT[2 * step + 1] = TWSR & 0xF8;
    twi_step = (uint8_t)(step + 1);
    if (step < sizeof bytes) {
        TWDR = bytes[step];
        TCNT1 = 0;
        TWCR = (1 << TWINT) | (1 << TWEN) | (1 << TWIE);
    } else {
        TWCR = (1 << TWINT) | (1 << TWSTO) | (1 << TWEN);
    }
}

static void twi_by_interrupt(uint8_t twbr) {
    TCCR1B = 1;
    TWBR = twbr;
    sei();
    TWCR = (1 << TWINT) | (1 << TWSTA) | (1 << TWEN) | (1 << TWIE);
    while (twi_step < 3) {
    }
    cli();
}

static void twi_fast(void) {
    twi_by_interrupt(12);  // 400 kHz
}

static void twi_slow(void) {
    twi_by_interrupt(72);  // 100 kHz
}

// The same polled: a one written to TWINT clears it until the work is done.
static void twi_flag(void) {
    TCCR1B = 1;
    TWBR = 12;
    TWCR = (1 << TWINT) | (1 << TWSTA) | (1 << TWEN);
    delay_ticks(1000);
    RESULT[0] = (TWCR & (1 << TWINT)) != 0;
    TWDR = 0xD0;
    TWCR = (1 << TWINT) | (1 << TWEN);
    RESULT[1] = (TWCR & (1 << TWINT)) != 0;
    delay_ticks(1000);
    RESULT[2] = (TWCR & (1 << TWINT)) != 0;
}

static void twi_bus_held(void) {
    TCCR1B = 1;
    TWBR = 12;
    TWCR = (1 << TWINT) | (1 << TWSTA) | (1 << TWEN);
    delay_ticks(16000);
    RESULT[0] = (TWCR & (1 << TWINT)) != 0;
}

static uint8_t lines(void) {
    const uint8_t pins = LINES_PIN;
    return (uint8_t)((pins & (1 << SDA_BIT) ? LINES_SDA : 0) |
                     (pins & (1 << SCL_BIT) ? LINES_SCL : 0));
}

// A slave holds SDA; nine pulses on SCL by hand.
static void bus_lines(void) {
    RESULT[0] = lines();
    RESULT[1] = 0;
    for (uint8_t pulse = 1; pulse <= 9; pulse++) {
        LINES_DDR |= 1 << SCL_BIT;
        RESULT[2] = lines() & LINES_SCL;
        LINES_DDR &= (uint8_t) ~(1 << SCL_BIT);
        if (RESULT[1] == 0 && (lines() & LINES_SDA)) {
            RESULT[1] = pulse;
        }
    }
    RESULT[3] = lines();
}

static bool twi_write(uint8_t reg, uint8_t value) {
    const uint8_t bytes[] = {0xD0, reg, value};
    TWCR = (1 << TWINT) | (1 << TWSTA) | (1 << TWEN);
    for (uint8_t i = 0; i < sizeof bytes; i++) {
        for (uint16_t tries = 0; !(TWCR & (1 << TWINT)); tries++) {
            if (tries == 2000) {
                return false;
            }
        }
        TWDR = bytes[i];
        TWCR = (1 << TWINT) | (1 << TWEN);
    }
    for (uint16_t tries = 0; !(TWCR & (1 << TWINT)); tries++) {
        if (tries == 2000) {
            return false;
        }
    }
    TWCR = (1 << TWINT) | (1 << TWSTO) | (1 << TWEN);
    return true;
}

// Interrupts

// Counts what Timer1 says at its first instruction.
ISR(TIMER0_COMPA_vect, ISR_NAKED) {
    __asm__ volatile("push r24\n\t"
                     "lds r24, %0\n\t"
                     "sts %1, r24\n\t"
                     "pop r24\n\t"
                     "reti\n" ::"n"(_SFR_MEM_ADDR(TCNT1L)),
                     "n"(PROBE_RESULTS + 2));
}

// SEI, one instruction, then the interrupt that has been waiting.
static void interrupt_entry(void) {
    RESULT[1] = 0;
    OCR0A = 10;
    TIMSK0 = 1 << OCIE0A;
    TCCR0B = 1;
    while (!(TIFR0 & (1 << OCF0A))) {
    }
    TCCR0B = 0;
    TCCR1B = 1;
    uint8_t before;
    __asm__ volatile("lds %0, %1\n\t"
                     "sei\n\t"
                     "nop\n\t"
                     "nop\n\t"
                     "nop\n\t"
                     "cli\n"
                     : "=r"(before)
                     : "n"(_SFR_MEM_ADDR(TCNT1L)));
    RESULT[0] = before;
}

ISR(READY_vect) {
    count++;
}

static void edge_on_ready(void) {
    READY_SENSE = (1 << ISC01) | (1 << ISC00);
    WIRED_PORT &= (uint8_t) ~(1 << READY_BIT);
    WIRED_DDR |= 1 << READY_BIT;
    WIRED_PORT |= 1 << READY_BIT;
}

// An edge while the interrupt is off is remembered.
static void interrupt_flags(void) {
    edge_on_ready();
    RESULT[0] = EIFR >> READY & 1;
    sei();
    EIMSK = 1 << READY;
    __asm__ volatile("nop\n\tnop\n");
    cli();
    RESULT[1] = count;
    RESULT[2] = EIFR >> READY & 1;
}

// Unless it is told to be forgotten.
static void external_flag(void) {
    edge_on_ready();
    EIFR = 1 << READY;
    RESULT[0] = EIFR >> READY & 1;
    sei();
    EIMSK = 1 << READY;
    __asm__ volatile("nop\n\tnop\n");
    cli();
    RESULT[1] = count;
}

// UART: the host looks at when bytes leave

static void send_six(void) {
    for (uint8_t i = 0; i < 6; i++) {
        while (!(UCSR0A & (1 << UDRE0))) {
        }
        UDR0 = (uint8_t)(0x31 + i);
    }
    while (!(UCSR0A & (1 << TXC0))) {
    }
}

static void uart_on(void) {
    UCSR0A = 1 << U2X0;
    UCSR0C = (1 << UCSZ01) | (1 << UCSZ00);
    UBRR0H = 0;
    UBRR0L = 3;  // 500 kbaud
    UCSR0B = (1 << TXEN0) | (1 << RXEN0);
}

static void uart_send(void) {
    uart_on();
    send_six();
}

static void uart_baud_order(void) {
    UBRR0H = 0;
    UBRR0L = 3;
    UCSR0B = (1 << TXEN0) | (1 << RXEN0);
    UCSR0C = (1 << UCSZ01) | (1 << UCSZ00);
    UCSR0A = 1 << U2X0;
    send_six();
}

static void uart_double_buffer(void) {
    uart_on();
    TCCR1B = 1;
    for (uint8_t i = 0; i < 3; i++) {
        TCNT1 = 0;
        UDR0 = i;
        while (!(UCSR0A & (1 << UDRE0))) {
        }
        RESULT[i] = TCNT1;
    }
}

static void uart_polling(void) {
    uart_on();
    for (uint16_t i = 0; i < 30000; i++) {
        (void)UCSR0A;
    }
}

// Five bytes on the wire and nobody reads: three are kept, in order.
static void uart_receive(void) {
    uart_on();
    TCCR1B = 1;
    RESULT[8] = 1;  // the host sends now
    while (!(UCSR0A & (1 << RXC0))) {
    }
    const uint16_t first = TCNT1;
    (void)UDR0;
    while (!(UCSR0A & (1 << RXC0))) {
    }
    RESULT[0] = TCNT1 - first;
    delay_ticks(4 * 320 + 100);
    RESULT[1] = (UCSR0A & (1 << DOR0)) != 0;
    for (uint8_t i = 2; i < 6; i++) {
        RESULT[i] = (UCSR0A & (1 << RXC0)) ? UDR0 : 0xFFFF;
    }
}

// Sleep

ISR(TIMER1_OVF_vect) {
    count++;
}

static void sleep_long(void) {  // 8 overflows of 262 ms
    TIMSK1 = 1 << TOIE1;
    TCCR1B = (1 << CS11) | (1 << CS10);
    SMCR = 0;  // idle: the clocks run on
    sleep_enable();
    sei();
    while (count < 8) {
        sleep_cpu();
    }
    cli();
}

// EEPROM

static void eeprom_time(void) {
    TCCR1B = 1 << CS11;  // 0.5 us a tick
    EEAR = 5;
    EEDR = 0x5A;
    TCNT1 = 0;
    EECR |= 1 << EEMPE;
    EECR |= 1 << EEPE;
    while (EECR & (1 << EEPE)) {
    }
    RESULT[0] = TCNT1;
    EEAR = 5;
    EECR |= 1 << EERE;
    RESULT[1] = EEDR;
    EEAR = 6;
    EECR |= 1 << EERE;
    RESULT[2] = EEDR;
}

ISR(EE_READY_vect) {
    EECR &= (uint8_t) ~(1 << EERIE);
    count++;
}

static void eeprom_ready(void) {
    sei();
    EECR |= 1 << EERIE;
    __asm__ volatile("nop\n\tnop\n");
    cli();
    RESULT[0] = count;
}

// Timers

static void timer_preload(void) {
    TCNT1 = 0x1234;
    RESULT[0] = TCNT1;
    TCCR1B = 1;
    RESULT[1] = TCNT1;
    TCNT0 = 0x42;
    TCCR0B = 1;
    RESULT[2] = TCNT0;
    TCCR0B = 0;
    RESULT[3] = TCNT0;
    TCCR0B = 1;
    RESULT[4] = TCNT0;
}

static void timer_compare(void) {
    TCCR1B = 1;
    delay_ticks(5000);
    const uint16_t before = TCNT1;
    OCR1A = 0x8000;
    OCR1B = 0x9000;
    RESULT[0] = TCNT1 - before;
}

// Resets

static void watchdog_reset(void) {
    if (causes & (1 << WDRF)) {
        RESULT[1] = causes;
        READY_SENSE = (1 << ISC01) | (1 << ISC00);
        EIMSK = 1 << READY;
        TCCR1B = 1 << CS11;
        sei();
        delay_ticks(40000);  // 20 ms: the sensor gives 500 edges a second
        cli();
        RESULT[2] = count;
        return;
    }
    TWBR = 12;
    TCCR1B = 1;
    bool good = twi_write(26, 1);  // CONFIG: DLPF on, 1 kHz
    delay_ticks(200);
    good = twi_write(25, 1) && good;  // SMPLRT_DIV: 500 Hz
    delay_ticks(200);
    good = twi_write(56, 1) && good;  // INT_ENABLE: data ready
    RESULT[0] = good;
    wdt_enable(WDTO_15MS);
    for (;;) {
    }
}

// The watchdog's modes, over three starts.

static volatile uint8_t timeouts;

ISR(WDT_vect) {
    timeouts++;
}

static void set_watchdog(uint8_t control) {
    wdt_reset();
    WDTCSR = (1 << WDCE) | (1 << WDE);
    WDTCSR = control;
}

static void delay_40_ms(void) {
    delay_ticks(2500);
}

static void watchdog_modes(void) {
    TCCR1B = 1 << CS12;  // 16 us a tick
    if (causes == (1 << PORF)) {
        MCUSR = 0;
        set_watchdog(1 << WDIE);
        sei();
        delay_40_ms();
        cli();
        RESULT[0] = timeouts;
        delay_40_ms();
        WDTCSR = (1 << WDIE) | (1 << WDP2);  // without the timed sequence
        RESULT[1] = WDTCSR;
        sei();
        set_watchdog((1 << WDIE) | (1 << WDE));
        timeouts = 0;
        RESULT[8] = 1;  // the host measures the time to the reset
        while (timeouts == 0) {
        }
        RESULT[2] = WDTCSR;
        for (;;) {
        }
    }
    MCUSR = 0xFF;  // sets none
    if (causes == (1 << WDRF)) {
        RESULT[3] = WDTCSR;
        set_watchdog(0);
        RESULT[4] = WDTCSR;
        RESULT[8] = 2;  // the host pulls the reset pin now
        for (;;) {
        }
    }
    RESULT[5] = MCUSR;
    RESULT[6] = WDTCSR;
    MCUSR = 0;
    set_watchdog(0);
    RESULT[7] = WDTCSR;
    delay_40_ms();
}

static void reset_cause(void) {
    RESULT[RESULT[8]] = causes;
    RESULT[8]++;
}

// Inputs

static uint16_t convert(uint8_t channel) {
    ADMUX = (1 << REFS0) | channel;
    ADCSRA = (1 << ADEN) | (1 << ADSC) | 7;
    while (ADCSRA & (1 << ADSC)) {
    }
    return ADC;
}

static void analog(void) {
    for (uint8_t i = 0; i < 8; i++) {
        RESULT[i] = convert(7);
    }
    RESULT[8] = convert(BANDGAP);  // 1.1 V against 5 V
}

static void button(void) {
    WIRED_PORT |= 1 << BUTTON_BIT;
    RESULT[0] = WIRED_PIN >> BUTTON_BIT & 1;
    RESULT[8] = 1;  // the host presses now
    TCCR1B = 1;
    delay_ticks(2000);
    WIRED_PORT |= 1 << BUTTON_BIT;
    RESULT[1] = WIRED_PIN >> BUTTON_BIT & 1;
}

// Not in RAM: start-up would take longer by its copy.
static void (*const programs[])(void) PROGMEM = {
    [PROBE_TWI_FAST] = twi_fast,
    [PROBE_TWI_SLOW] = twi_slow,
    [PROBE_TWI_FLAG] = twi_flag,
    [PROBE_TWI_BUS_HELD] = twi_bus_held,
    [PROBE_BUS_LINES] = bus_lines,
    [PROBE_INTERRUPT_ENTRY] = interrupt_entry,
    [PROBE_INTERRUPT_FLAGS] = interrupt_flags,
    [PROBE_EXTERNAL_FLAG] = external_flag,
    [PROBE_UART_SEND] = uart_send,
    [PROBE_UART_DOUBLE_BUFFER] = uart_double_buffer,
    [PROBE_UART_BAUD_ORDER] = uart_baud_order,
    [PROBE_UART_POLLING] = uart_polling,
    [PROBE_UART_RECEIVE] = uart_receive,
    [PROBE_SLEEP] = sleep_long,
    [PROBE_EEPROM_TIME] = eeprom_time,
    [PROBE_EEPROM_READY] = eeprom_ready,
    [PROBE_TIMER_PRELOAD] = timer_preload,
    [PROBE_TIMER_COMPARE] = timer_compare,
    [PROBE_WATCHDOG_RESET] = watchdog_reset,
    [PROBE_WATCHDOG_MODES] = watchdog_modes,
    [PROBE_RESET_CAUSE] = reset_cause,
    [PROBE_ANALOG] = analog,
    [PROBE_BUTTON] = button,
};

int main(void) {
    causes = MCUSR;
    if (PROBE != PROBE_RESET_CAUSE && PROBE != PROBE_WATCHDOG_MODES) {
        MCUSR = 0;
        wdt_disable();
    }
    if (PROBE > 0 && PROBE < sizeof programs / sizeof *programs) {
        ((void (*)(void))pgm_read_ptr(&programs[PROBE]))();
    }
    GPIOR2 = PROBE_DONE;
    for (;;) {
    }
}
