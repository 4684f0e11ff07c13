; SPDX-License-Identifier: MIT
; The first instructions after the reset vector, before any C variable exists: starts
; the device clock, saves the reset flags, stops the watchdog, paints the stack.

#include <avr/io.h>

#include "start.h"

    .section .noinit.start_reset_flags, "aw", @nobits
    .global start_reset_flags
start_reset_flags:
    .skip 1

; .init2 has set r1 to zero and the stack pointer to the end of memory, on which nothing
; lies yet. r2 is as the bootloader left it.
    .section .init3, "ax", @progbits

; The device clock: Timer1 in normal mode, a tick is 8 cycles or 0.5 us. Time 0 is here.
    ldi     r24, _BV(CS11)
    sts     TCCR1B, r24

; Optiboot clears the flags and hands them over in r2. Other bootloaders clear them and
; leave anything there; what has a bit above the four flags is not taken for them.
    in      r24, _SFR_IO_ADDR(MCUSR)
    cpse    r24, r1
    rjmp    1f
    mov     r24, r2
    cpi     r24, 1 << (WDRF + 1)
    brlo    1f
    clr     r24
1:  sts     start_reset_flags, r24

; After a watchdog reset the watchdog runs on at 16 ms. It can only be stopped once WDRF
; is cleared, by two writes within four cycles ("Watchdog Timer").
    out     _SFR_IO_ADDR(MCUSR), r1
    wdr
    ldi     r24, _BV(WDCE) | _BV(WDE)
    sts     WDTCSR, r24
    sts     WDTCSR, r1

; Paints from the end of the variables to the end of memory.
    ldi     XL, lo8(_end)
    ldi     XH, hi8(_end)
    ldi     r24, STACK_PAINT
    ldi     r25, hi8(RAMEND + 1)
2:  st      X+, r24
    cpi     XL, lo8(RAMEND + 1)
    cpc     XH, r25
    brne    2b
