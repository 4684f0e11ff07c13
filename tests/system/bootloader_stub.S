; SPDX-License-Identifier: MIT
; What a Nano's image meets of two kinds of bootloaders, for test_bootloaders.py: how
; they start it, without how they flash it. At 0x7E00, as 512 bytes of a boot section.
;
; KEEPS_FLAGS: Optiboot 7 and later, by its history and issue 97 there: MCUSR is left to
; the image. It waits for a second after an external reset, which ends by its watchdog,
; and WDRF is then cleared. A start without flags is a request to wait.
; Otherwise Optiboot 4.6 to 6.2, and Urboot: MCUSR is cleared, and its flags are in r2.
#include <avr/io.h>

#define ONE_SECOND (_BV(WDP2) | _BV(WDP1))

    .section .text
    .global main
main:
    clr     r1
    in      r24, _SFR_IO_ADDR(MCUSR)
#ifdef KEEPS_FLAGS
    tst     r24
    breq    wait
    mov     r25, r24
    andi    r25, _BV(WDRF) | _BV(EXTRF)
    cpi     r25, _BV(EXTRF)
    breq    wait
    sbrs    r24, EXTRF
    rjmp    start
    ldi     r25, ~_BV(WDRF) & 0xFF
    out     _SFR_IO_ADDR(MCUSR), r25
#else
    out     _SFR_IO_ADDR(MCUSR), r1
    sbrc    r24, EXTRF
    rjmp    wait
#endif
start:
    mov     r2, r24
    ldi     r25, _BV(WDCE) | _BV(WDE)
    sts     WDTCSR, r25
    sts     WDTCSR, r1
    jmp     0

; Its time is over when the watchdog resets.
wait:
    ldi     r25, _BV(U2X0)
    sts     UCSR0A, r25
    ldi     r25, 16             ; 115,200 baud
    sts     UBRR0L, r25
    ldi     r25, _BV(RXEN0) | _BV(TXEN0)
    sts     UCSR0B, r25
    ldi     r25, _BV(CS12) | _BV(CS10)
    sts     TCCR1B, r25
    ldi     r25, _BV(WDCE) | _BV(WDE)
    sts     WDTCSR, r25
    ldi     r25, _BV(WDE) | ONE_SECOND
    sts     WDTCSR, r25
1:  rjmp    1b
