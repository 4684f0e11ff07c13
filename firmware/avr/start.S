; SPDX-License-Identifier: MIT
; The first instructions after the reset vector, before any C variable exists: starts
; the device clock, finds the cause of this start, sets the watchdog, paints the stack.

#include <avr/io.h>

#include "pins.h"
#include "start.h"

    .section .noinit.start, "aw", @nobits
    .global start_reset_cause
start_reset_cause:
    .skip 1
    .global start_asked
start_asked:
    .skip 2

; .init2 has set r1 to zero and the stack pointer to the end of memory, on which nothing
; lies yet. After a start without a reset (see below) all registers are as they were:
; what C sets before it enables interrupts is not repeated here.
    .section .init3, "ax", @progbits

; The device clock: Timer1 in normal mode, a tick is 8 cycles or 0.5 us. Time 0 is here.
    sts     TCNT1H, r1
    sts     TCNT1L, r1
    ldi     r24, _BV(CS11)
    sts     TCCR1B, r24

; Nothing interrupts but what C enables.
    sts     PCICR, r1
    sts     TIMSK0, r1
    sts     TIMSK2, r1
    out     _SFR_IO_ADDR(EIMSK), r1
    out     _SFR_IO_ADDR(SPCR), r1
    out     _SFR_IO_ADDR(ACSR), r1
    out     _SFR_IO_ADDR(SPMCSR), r1
    quiet_others

; The cause: the flags of MCUSR, none where a bootloader has cleared them. Of those that
; do so, some hand them over in r2; it is not read, because others leave anything there.
; No reset leaves WDIE set: then the handler of the watchdog has come here.
    in      r22, _SFR_IO_ADDR(MCUSR)
    lds     r24, WDTCSR
    sbrc    r24, WDIE
    ldi     r22, _BV(WDRF)
    look_at_bootloader
    lds     r24, start_asked
    lds     r25, start_asked + 1
    subi    r24, lo8(START_ASKED)
    sbci    r25, hi8(START_ASKED)
    brne    1f
    ldi     r22, START_SOFTWARE
1:  sts     start_reset_cause, r22
    sts     start_asked, r1

; The watchdog: 500 ms are longer than any step of the main loop, and shorter than a
; person's patience. It resets, unless the bootloader does not stop a watchdog, which
; after its reset runs on at 16 ms: each start of such a bootloader would end in the
; next reset. There the watchdog interrupts (see the end). WDIF is cleared by a one.
    ldi     r25, _BV(WDE) | START_500_MS
    cpse    r23, r1
    ldi     r25, _BV(WDIF) | _BV(WDIE) | START_500_MS
; It can only be stopped once WDRF is cleared, by two writes within four cycles
; ("Watchdog Timer").
    out     _SFR_IO_ADDR(MCUSR), r1
    wdr
    ldi     r24, _BV(WDCE) | _BV(WDE)
    sts     WDTCSR, r24
    sts     WDTCSR, r25
#if !(START_500_MS & (1 << TOV1))
#error "what the watchdog is set to has to clear TOV1, too"
#endif
    out     _SFR_IO_ADDR(TIFR1), r25

; Paints from the end of the variables to the end of memory.
    ldi     XL, lo8(_end)
    ldi     XH, hi8(_end)
    ldi     r24, STACK_PAINT
    ldi     r25, hi8(RAMEND + 1)
2:  st      X+, r24
    cpi     XL, lo8(RAMEND + 1)
    cpc     XH, r25
    brne    2b

; The watchdog's interrupt, or one that nobody enabled: then memory is not to be trusted.
; Where the watchdog resets, it ends this loop; elsewhere the image starts again.
    .section .text.start, "ax", @progbits
    .global __vector_default
__vector_default:
    lds     r24, WDTCSR
    sbrs    r24, WDIE
    rjmp    __vector_default
    jmp     __vectors
