; SPDX-License-Identifier: MIT
; The products of fixed.h, exact, column by column of bytes. Cycles, `ret` included and
; the call of 3 or 4 not: fixed_mul_q30 108, fixed_mul_q32 98, fixed_umul_q32 90.
;
; Calling convention: a arrives in r25..r22, b in r21..r18, the result leaves in
; r25..r22; r18 to r27, r30 and r31 are free to use, r1 must be zero at the return.

#define A0 r22
#define A1 r23
#define A2 r24
#define A3 r25
#define B0 r18
#define B1 r19
#define B2 r20
#define B3 r21
#define ZERO r31

; Bytes of the product. Its lowest never leaves r0; a register is taken up again as soon
; as its byte, or its factor, has done its work.
#define P1 r26
#define P2 r27
#define P3 r30
#define P4 r26
#define P5 r27

; Column k collects the products whose bytes' places add up to k, in three bytes: its
; own place, the next, and the carries. A signed column has a signed third byte: at most
; four products of 16 bits, so it is within -4..4.

    ; \x:\y:\z += product of two unsigned bytes.
    .macro add_unsigned a, b, x, y, z
    mul     \a, \b
    add     \x, r0
    adc     \y, r1
    adc     \z, ZERO
    .endm

    ; \x:\y:\z += product of a signed and an unsigned byte. mulsu leaves the sign in C
    ; and reaches r16 to r23 only.
    .macro add_signed a, b, x, y, z
    mulsu   \a, \b
    sbc     \z, ZERO
    add     \x, r0
    adc     \y, r1
    adc     \z, ZERO
    .endm

    ; Columns 0 to 2 of both signednesses. \half: half of what is added to P3.
    .macro low_columns half
    clr     ZERO
    mul     A0, B0
    mov     P1, r1
    mul     A0, B1
    clr     P2
    add     P1, r0
    adc     P2, r1
    mul     A1, B0
    add     P1, r0
    adc     P2, r1
    ldi     P3, \half
    adc     P3, P3
    mul     A0, B2
    add     P2, r0
    adc     P3, r1
    clr     P4
    adc     P4, P4
    add_unsigned A1, B1, P2, P3, P4
    add_unsigned A2, B0, P2, P3, P4
    .endm

    ; r25:r24:P5:P4:P3 = bytes 7 to 3 of the signed product plus \half * 2^25.
    .macro signed_product half
    low_columns \half
    mulsu   B3, A0
    sbc     P5, P5          ; minus the sign
    add     P3, r0
    adc     P4, r1
    adc     P5, ZERO
    mov     A0, A3          ; where mulsu reaches it
    add_signed A0, B0, P3, P4, P5
    add_unsigned A1, B2, P3, P4, P5
    add_unsigned A2, B1, P3, P4, P5

    mulsu   B3, A1
    mov     A1, A2          ; where mulsu reaches it; r24 takes byte 6
    sbc     r24, r24        ; minus the sign of the product
    sbrc    P5, 7
    dec     r24             ; and that of the column
    add     P4, r0
    adc     P5, r1
    adc     r24, ZERO
    add_signed A0, B1, P4, P5, r24
    add_unsigned A1, B2, P4, P5, r24

    mulsu   B3, A1
    sbc     r25, r25
    sbrc    r24, 7
    dec     r25
    add     P5, r0
    adc     r24, r1
    adc     r25, ZERO
    add_signed A0, B2, P5, r24, r25

    muls    A0, B3
    add     r24, r0
    adc     r25, r1
    .endm

; int32_t fixed_mul_q30(int32_t a, int32_t b): bits 61 to 30 of the product plus 2^29.
    .section .text.fixed_mul_q30, "ax", @progbits
    .global fixed_mul_q30
    .type   fixed_mul_q30, @function
fixed_mul_q30:
    signed_product 0x10
    .rept   2
    lsl     P3
    rol     P4
    rol     P5
    rol     r24
    rol     r25
    .endr
    movw    r22, P4
    clr     r1
    ret
    .size   fixed_mul_q30, . - fixed_mul_q30

; int32_t fixed_mul_q32(int32_t a, int32_t b): the high word of the product plus 2^31.
    .section .text.fixed_mul_q32, "ax", @progbits
    .global fixed_mul_q32
    .type   fixed_mul_q32, @function
fixed_mul_q32:
    signed_product 0x40
    movw    r22, P4
    clr     r1
    ret
    .size   fixed_mul_q32, . - fixed_mul_q32

; uint32_t fixed_umul_q32(uint32_t a, uint32_t b): the high word of the product.
    .section .text.fixed_umul_q32, "ax", @progbits
    .global fixed_umul_q32
    .type   fixed_umul_q32, @function
fixed_umul_q32:
    low_columns 0
    mul     A0, B3
    add     P3, r0
    adc     P4, r1
    clr     P5
    adc     P5, P5
    add_unsigned A1, B2, P3, P4, P5
    add_unsigned A2, B1, P3, P4, P5
    add_unsigned A3, B0, P3, P4, P5

    mul     A1, B3
    add     P4, r0
    adc     P5, r1
    clr     A0              ; bytes 6 and 7 take the places of a0 and a1
    adc     A0, A0
    add_unsigned A2, B2, P4, P5, A0
    add_unsigned A3, B1, P4, P5, A0

    mul     A2, B3
    add     P5, r0
    adc     A0, r1
    clr     A1
    adc     A1, A1
    add_unsigned A3, B2, P5, A0, A1

    mul     A3, B3
    add     r0, A0
    adc     r1, A1
    movw    r24, r0
    movw    r22, P4
    clr     r1
    ret
    .size   fixed_umul_q32, . - fixed_umul_q32

; One term of a dot product: r23..r18 += *X+ (32 bits) * *Z+ (16 bits), modulo 2^48. The
; bytes multiply as unsigned; a negative factor then takes the other off, shifted.
#define FACTOR r16
#define NAUGHT r17

    .section .text.fixed_dot3_q14, "ax", @progbits
add_term:
    ld      r24, Z+
    ld      r25, Z+
    ld      FACTOR, X+
    mul     FACTOR, r24
    add     r18, r0
    adc     r19, r1
    adc     r20, NAUGHT
    adc     r21, NAUGHT
    adc     r22, NAUGHT
    adc     r23, NAUGHT
    mul     FACTOR, r25
    add     r19, r0
    adc     r20, r1
    adc     r21, NAUGHT
    adc     r22, NAUGHT
    adc     r23, NAUGHT
    ld      FACTOR, X+
    mul     FACTOR, r24
    add     r19, r0
    adc     r20, r1
    adc     r21, NAUGHT
    adc     r22, NAUGHT
    adc     r23, NAUGHT
    mul     FACTOR, r25
    add     r20, r0
    adc     r21, r1
    adc     r22, NAUGHT
    adc     r23, NAUGHT
    ld      FACTOR, X+
    mul     FACTOR, r24
    add     r20, r0
    adc     r21, r1
    adc     r22, NAUGHT
    adc     r23, NAUGHT
    mul     FACTOR, r25
    add     r21, r0
    adc     r22, r1
    adc     r23, NAUGHT
    ld      FACTOR, X+
    mul     FACTOR, r24
    add     r21, r0
    adc     r22, r1
    adc     r23, NAUGHT
    mul     FACTOR, r25
    add     r22, r0
    adc     r23, r1
    sbrs    FACTOR, 7
    rjmp    1f
    sub     r22, r24
    sbc     r23, r25
1:  sbrs    r25, 7
    ret
    sbiw    r26, 4
    ld      r0, X+
    sub     r20, r0
    ld      r0, X+
    sbc     r21, r0
    ld      r0, X+
    sbc     r22, r0
    ld      r0, X+
    sbc     r23, r0
    ret

; int32_t fixed_dot3_q14(const int32_t v[3], const int16_t m[3]): bits 45 to 14 of the
; sum of products plus 2^13. v arrives in r25:r24, m in r23:r22.
    .global fixed_dot3_q14
    .type   fixed_dot3_q14, @function
fixed_dot3_q14:
    push    r16
    push    r17
    movw    r26, r24
    movw    r30, r22
    clr     NAUGHT
    clr     r18
    ldi     r19, 0x20       ; 2^13
    clr     r20
    clr     r21
    movw    r22, r20
    rcall   add_term
    rcall   add_term
    rcall   add_term
    .rept   2
    lsl     r19
    rol     r20
    rol     r21
    rol     r22
    rol     r23
    .endr
    movw    r24, r22
    movw    r22, r20
    clr     r1
    pop     r17
    pop     r16
    ret
    .size   fixed_dot3_q14, . - fixed_dot3_q14
