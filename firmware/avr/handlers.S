; SPDX-License-Identifier: MIT
; The interrupt handlers, and the clock that one of them reads. In assembler, because a
; handler in C saves registers that it does not need, and its end cannot be shared: they
; take 40 % less flash and stack so.
;
; From the data-ready edge to the bytes of a sample: its handler stamps the time and
; starts the burst, the TWI handler moves its bytes (sampling.c). The UART's move bytes
; between the wire and its rings (uart.c). Timer1 is the clock, Timer0 wakes the main
; loop (clock.c).

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/twi.h>

#include "handlers.h"
#include "pins.h"

#define IO(register) _SFR_IO_ADDR(register)
#define MEM(register) _SFR_MEM_ADDR(register)

; TWCR for each kind of step; all clear TWINT, which starts it.
#define GO (_BV(TWINT) | _BV(TWEN) | _BV(TWIE))
#define GO_START (GO | _BV(TWSTA))
#define GO_ACKNOWLEDGE (GO | _BV(TWEA))
#define GO_STOP (_BV(TWINT) | _BV(TWEN) | _BV(TWSTO))
#define GO_STOP_START (GO_START | _BV(TWSTO))

; What each handler saves first and .Lleave restores: two registers, SREG, and Z.
    .macro enter
    push    r24
    in      r24, IO(SREG)
    push    r24
    push    r25
    push    r30
    push    r31
    .endm

; And X, and Z at what is shared; .Lleave_x restores it.
    .macro enter_sampling
    enter
    push    r26
    push    r27
    ldi     r30, lo8(sampling)
    ldi     r31, hi8(sampling)
    .endm

    .section .bss.clock_overflows, "aw", @nobits
; Microseconds of the last overflow of Timer1, but for their lowest byte, which is 0.
clock_overflows:
    .skip   3

    .section .text.handlers, "ax", @progbits

; A data-ready edge.
    .global DATA_READY_vect
    .type   DATA_READY_vect, @function
DATA_READY_vect:
    enter_sampling
    push    r22
    push    r23
    lds     r24, MEM(TCNT1L)
    lds     r25, MEM(TCNT1H)
    adiw    r30, SAMPLING_READY
1:  ld      r26, Z
    inc     r26
    st      Z+, r26
    breq    1b
    ldi     r30, lo8(sampling)
    ldi     r31, hi8(sampling)
    ; Missed, where a transfer is on the bus or no slot is free.
    ldd     r26, Z + SAMPLING_IS_RUNNING
    tst     r26
    brne    4f
    ld      r22, Z
    ldd     r23, Z + SAMPLING_TAKEN
    sub     r23, r22
    cpi     r23, lo8(-2)
    breq    4f
    rcall   clock_us
    ldi     r26, lo8(sampling_readings + READING_TIME)
    ldi     r27, hi8(sampling_readings + READING_TIME)
    ld      r31, Z
    lsr     r31
    brcc    2f  ; libsimavr takes this ADIW for four bytes, where it is skipped
    adiw    r26, READING_SIZE
2:  st      X+, r22
    st      X+, r23
    st      X+, r24
    st      X+, r25
    ldi     r31, hi8(sampling)
    ldd     r24, Z + SAMPLING_MISSED
    st      X+, r24
    ldd     r24, Z + SAMPLING_MISSED + 1
    st      X+, r24
    clr     r24
    std     Z + SAMPLING_MISSED, r24
    std     Z + SAMPLING_MISSED + 1, r24
    sbiw    r26, READING_SIZE
    movw    r24, r26
    rcall   sampling_begin
3:  pop     r23
    pop     r22
    rjmp    .Lleave_x
4:  ldd     r24, Z + SAMPLING_MISSED
    ldd     r25, Z + SAMPLING_MISSED + 1
    adiw    r24, 1
    breq    3b  ; it stays at 65535
    std     Z + SAMPLING_MISSED, r24
    std     Z + SAMPLING_MISSED + 1, r25
    rjmp    3b

; uint32_t board_time_us(void)
    .global board_time_us
    .type   board_time_us, @function
board_time_us:
    in      r18, IO(SREG)
    cli
    lds     r24, MEM(TCNT1L)
    lds     r25, MEM(TCNT1H)
    rcall   clock_us
    out     IO(SREG), r18
    ret

; Device time of the ticks in r25:r24, which were read from TCNT1 just now, in r25..r22;
; no other register changes. Interrupts must be off. An overflow whose handler has not
; run is known by its flag, and came before a reading from the lower half.
    .type   clock_us, @function
clock_us:
    lsr     r25
    ror     r24  ; a tick is half a microsecond
    movw    r22, r24
    sbis    IO(TIFR1), TOV1
    rjmp    1f
    sbrs    r23, 6
    ori     r23, 0x80
1:  lds     r24, clock_overflows
    add     r23, r24
    lds     r24, clock_overflows + 1
    lds     r25, clock_overflows + 2
    brcc    2f
    adiw    r24, 1
2:  ret

    .global TIMER1_OVF_vect
    .type   TIMER1_OVF_vect, @function
TIMER1_OVF_vect:
    push    r24
    in      r24, IO(SREG)
    push    r24
    lds     r24, clock_overflows
    subi    r24, 0x80
    sts     clock_overflows, r24
    lds     r24, clock_overflows + 1
    sbci    r24, 0xFF
    sts     clock_overflows + 1, r24
    lds     r24, clock_overflows + 2
    sbci    r24, 0xFF
    sts     clock_overflows + 2, r24
    pop     r24
    out     IO(SREG), r24
    pop     r24
    reti

    .global TIMER0_COMPA_vect
    .type   TIMER0_COMPA_vect, @function
TIMER0_COMPA_vect:
    push    r24
    ldi     r24, 1
    sts     idle_has_work, r24
    pop     r24
    reti

; void sampling_begin(uint8_t *bytes): starts a transfer as `burst` has it. Interrupts
; must be off. Changes r24, r25, r30 and r31.
    .global sampling_begin
    .type   sampling_begin, @function
sampling_begin:
    ldi     r30, lo8(sampling)
    ldi     r31, hi8(sampling)
    std     Z + SAMPLING_CURSOR, r24
    std     Z + SAMPLING_CURSOR + 1, r25
    ldd     r24, Z + SAMPLING_LENGTH
    std     Z + SAMPLING_REMAINING, r24
    lds     r24, MEM(TCNT1L)
    lds     r25, MEM(TCNT1H)
    std     Z + SAMPLING_BEGUN, r24
    std     Z + SAMPLING_BEGUN + 1, r25
    ldi     r24, 1
    std     Z + SAMPLING_IS_RUNNING, r24
#ifdef SAMPLING_TWO_BURSTS
    ldi     r24, 0
    std     Z + SAMPLING_IS_SECOND, r24
#endif
    ; The STOP of the burst before may still be on its way; the START then follows it.
    lds     r24, MEM(TWCR)
    andi    r24, _BV(TWSTO)
    ori     r24, GO_START
    sts     MEM(TWCR), r24
    ret

; TWSR is the status, because its prescaler bits are 0 ("Transmission Modes"). X is the
; cursor.
    .global TWI_vect
    .type   TWI_vect, @function
TWI_vect:
    enter_sampling
    ldd     r26, Z + SAMPLING_CURSOR
    ldd     r27, Z + SAMPLING_CURSOR + 1
    lds     r24, MEM(TWSR)
    cpi     r24, TW_MR_DATA_ACK  ; first, because it is by far the most frequent
    brne    3f
    lds     r24, MEM(TWDR)
    st      X+, r24
    ldd     r24, Z + SAMPLING_REMAINING
    dec     r24
    std     Z + SAMPLING_REMAINING, r24
; The last byte gets no acknowledge, so that the device lets go of SDA.
1:  cpi     r24, 1
    ldi     r24, GO
    breq    2f
    ldi     r24, GO_ACKNOWLEDGE
2:  sts     MEM(TWCR), r24
    std     Z + SAMPLING_CURSOR, r26
    std     Z + SAMPLING_CURSOR + 1, r27
.Lleave_x:
    pop     r27
    pop     r26
    rjmp    .Lleave

3:  cpi     r24, TW_MT_SLA_ACK
    breq    .Lsend_register
    brlo    .Lsend_address
    cpi     r24, TW_MT_DATA_ACK
    breq    .Lgo_on
    cpi     r24, TW_MR_SLA_ACK
    breq    .Lfirst_is_next
    cpi     r24, TW_MR_DATA_NACK
    breq    .Llast_has_come
    cpi     r24, TW_MT_SLA_NACK
    breq    .Lrefused
    cpi     r24, TW_MT_DATA_NACK
    breq    .Lrefused
    cpi     r24, TW_MR_SLA_NACK
    breq    .Lrefused

; Lost arbitration, or a START or STOP that is not ours: with one master something else
; drives the wires.
.Lstuck:
    ldi     r25, FAILURE_STUCK
    ldi     r24, 0
    rjmp    4f
.Lrefused:
    ldi     r25, FAILURE_NACK
    ldi     r24, GO_STOP
4:  std     Z + SAMPLING_FAILURE, r25
5:  sts     MEM(TWCR), r24
    pop     r27
    pop     r26
; The main loop has work.
.Lwork:
    ldi     r24, 1
    sts     idle_has_work, r24
.Lleave:
    pop     r31
    pop     r30
    pop     r25
    pop     r24
    out     IO(SREG), r24
    pop     r24
    reti

; After a START, to write, after a repeated one, which differs in bit 4, to read.
.Lsend_address:
    cpi     r24, TW_START
    brlo    .Lstuck
    bst     r24, 4
    ldd     r24, Z + SAMPLING_ADDRESS
#ifdef SAMPLING_TWO_BURSTS
    ldd     r25, Z + SAMPLING_IS_SECOND
    sbrc    r25, 0
    ldd     r24, Z + SAMPLING_SECOND_ADDRESS
#endif
    lsl     r24
    bld     r24, 0
    rjmp    .Lsend
.Lsend_register:
    ldd     r24, Z + SAMPLING_REG
#ifdef SAMPLING_TWO_BURSTS
    ldd     r25, Z + SAMPLING_IS_SECOND
    sbrc    r25, 0
    ldd     r24, Z + SAMPLING_SECOND_REG
#endif
.Lsend:
    sts     MEM(TWDR), r24
    ldi     r24, GO
    rjmp    2b
; The register was taken, or a byte that was written.
.Lgo_on:
    ldd     r25, Z + SAMPLING_IS_WRITE
    ldi     r24, GO_START
    sbrs    r25, 0
    rjmp    2b
    ldd     r25, Z + SAMPLING_REMAINING
    subi    r25, 1
    brlo    .Ldone
    std     Z + SAMPLING_REMAINING, r25
    ld      r24, X+
    rjmp    .Lsend
.Lfirst_is_next:
    ldd     r24, Z + SAMPLING_REMAINING
    rjmp    1b
.Llast_has_come:
    ldd     r24, Z + SAMPLING_REMAINING
    cpi     r24, 1
    brne    .Lstuck
    lds     r24, MEM(TWDR)
    st      X+, r24
#ifdef SAMPLING_TWO_BURSTS
    ldd     r24, Z + SAMPLING_IS_SECOND
    tst     r24
    brne    .Ldone
    ldd     r25, Z + SAMPLING_SECOND_LENGTH
    tst     r25
    breq    .Ldone
    ldi     r24, 1
    std     Z + SAMPLING_IS_SECOND, r24
    std     Z + SAMPLING_REMAINING, r25
    ldi     r24, GO_STOP_START
    rjmp    2b
#endif
.Ldone:
    ld      r24, Z
    inc     r24
    st      Z, r24
    ldi     r24, 0
    std     Z + SAMPLING_IS_RUNNING, r24
    ldi     r24, GO_STOP
    rjmp    5b

    .global WIRE_SENT_vect
    .type   WIRE_SENT_vect, @function
WIRE_SENT_vect:
    enter
    lds     r25, uart_sending_tail
    mov     r30, r25
    ldi     r31, 0
    subi    r30, lo8(-(uart_sending))
    sbci    r31, hi8(-(uart_sending))
    ld      r24, Z
    sts     MEM(UDR0), r24
    ; Clears TXC0: it is set when this byte has left.
    ldi     r24, _BV(U2X0) | _BV(TXC0)
    sts     MEM(UCSR0A), r24
    inc     r25
    cpi     r25, SENDING_SIZE
    brne    1f
    ldi     r25, 0
1:  sts     uart_sending_tail, r25
    lds     r24, uart_sending_head
    cpse    r24, r25
    rjmp    .Lleave
    ldi     r24, UART_ENABLED
    sts     MEM(UCSR0B), r24
    rjmp    .Lleave

    .global WIRE_RECEIVED_vect
    .type   WIRE_RECEIVED_vect, @function
WIRE_RECEIVED_vect:
    enter
    lds     r24, MEM(UCSR0A)  ; valid until UDR0 is read
    lds     r25, MEM(UDR0)
    sbrc    r24, DOR0
    rcall   .Lcount_lost
    lds     r30, uart_received_head
    lds     r24, uart_received_tail
    sub     r24, r30
    cpi     r24, lo8(-RECEIVED_SIZE)
    breq    1f
    mov     r24, r30
    inc     r24
    sts     uart_received_head, r24
    andi    r30, RECEIVED_SIZE - 1
    ldi     r31, 0
    subi    r30, lo8(-(uart_received))
    sbci    r31, hi8(-(uart_received))
    st      Z, r25
    rjmp    .Lwork
1:  rcall   .Lcount_lost
    rjmp    .Lleave
; A received byte was lost. Changes Z.
.Lcount_lost:
    lds     r30, uart_received_lost
    lds     r31, uart_received_lost + 1
    adiw    r30, 1
    sts     uart_received_lost, r30
    sts     uart_received_lost + 1, r31
    ret
