// SPDX-License-Identifier: MIT
// Firmware with known cycles, for tests of the profile: ten samples of work that a
// timer interrupts, and a function that two others and the interrupt handler call.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

static volatile uint8_t room[8];
volatile uint8_t ticks;

__attribute__((noinline)) void shared(void) {
    __builtin_avr_delay_cycles(300);
}

// Uses many registers and a frame, so that the compiler calls its shared prologue.
__attribute__((noinline)) void first(uint8_t depth) {
    volatile uint8_t local[4];
    for (uint8_t i = 0; i < sizeof local; i++) {
        local[i] = (uint8_t)(room[i] + depth);
    }
    __builtin_avr_delay_cycles(1000);
    shared();
    shared();
    for (uint8_t i = 0; i < sizeof local; i++) {
        room[i] = local[i];
    }
}

// Ends in a jump to shared() instead of a call.
__attribute__((noinline)) void second(void) {
    __builtin_avr_delay_cycles(500);
    shared();
}

ISR(TIMER0_COMPA_vect) {
    ticks++;
    shared();
}

int main(void) {
    TCCR1B = 1 << CS11;  // the device clock starts
    UCSR0A = 1 << U2X0;
    UBRR0L = 3;  // 500 kbaud
    UCSR0B = 1 << TXEN0;
    OCR0A = 249;
    TCCR0A = 1 << WGM01;
    TCCR0B = (1 << CS01) | (1 << CS00);  // every 16000 cycles
    TIMSK0 = 1 << OCIE0A;
    sei();
    sleep_enable();
    for (uint8_t sample = 0; sample < 10; sample++) {
        GPIOR0 = 1;
        for (uint8_t turn = 0; turn < 20; turn++) {
            first(sample);
            second();
        }
        GPIOR0 = 0;
        sleep_cpu();
    }
    UDR0 = ticks;
    for (;;) {
        sleep_cpu();
    }
}
