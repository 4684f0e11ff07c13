; SPDX-License-Identifier: MIT
; What of core/math is smaller here than the compiler makes it: products, exact, column
; by column of bytes, limits, ratios, then vectors, quaternions and matrices.
; Cycles, `ret` included and the call of 3 or 4 not: fixed_mul_q30 110,
; fixed_mul_q32 103, fixed_umul_q32 139; of that a few more where a highest bit is set.
;
; Calling convention: a arrives in r25..r22, b in r21..r18, the result leaves in
; r25..r22; r18 to r27, r30 and r31 are free to use, r1 must be zero at the return.

#include <avr/io.h>

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

; Two ways into one product; P3 enters as half of what is added to it. With T set the
; result is the high word of the product, else bits 61 to 30.
    .section .text.fixed_mul_q30, "ax", @progbits

; int32_t fixed_mul_q32(int32_t a, int32_t b): the high word of the product plus 2^31.
    .global fixed_mul_q32
    .type   fixed_mul_q32, @function
fixed_mul_q32:
    ldi     P3, 0x40
    set
    rjmp    product
    .size   fixed_mul_q32, . - fixed_mul_q32

; int32_t fixed_mul_q14(int32_t value, int16_t element): the element arrives where the
; upper half of a factor does.
    .global fixed_mul_q14
    .type   fixed_mul_q14, @function
fixed_mul_q14:
    clr     B0
    clr     B1
    rjmp    fixed_mul_q30
    .size   fixed_mul_q14, . - fixed_mul_q14

; int32_t fixed_square_q30(int32_t a)
    .global fixed_square_q30
    .type   fixed_square_q30, @function
fixed_square_q30:
    movw    B0, A0
    movw    B2, A2
    rjmp    fixed_mul_q30
    .size   fixed_square_q30, . - fixed_square_q30

; int32_t fixed_mul_at(const int32_t *a, const int32_t *b): fixed_mul_q30 of both.
    .global fixed_mul_at
    .type   fixed_mul_at, @function
fixed_mul_at:
    movw    r26, r24
    movw    r30, r22
    ld      A0, X+
    ld      A1, X+
    ld      A2, X+
    ld      A3, X
    ld      B0, Z
    ldd     B1, Z+1
    ldd     B2, Z+2
    ldd     B3, Z+3
    .size   fixed_mul_at, . - fixed_mul_at

; int32_t fixed_mul_q30(int32_t a, int32_t b): bits 61 to 30 of the product plus 2^29.
    .global fixed_mul_q30
    .type   fixed_mul_q30, @function
fixed_mul_q30:
    ldi     P3, 0x10
    clt
product:
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
    adc     P3, P3
    mul     A0, B2
    add     P2, r0
    adc     P3, r1
    clr     P4
    adc     P4, P4
    add_unsigned A1, B1, P2, P3, P4
    add_unsigned A2, B0, P2, P3, P4

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
    brts    1f
    .rept   2
    lsl     P3
    rol     P4
    rol     P5
    rol     r24
    rol     r25
    .endr
1:  movw    r22, P4
    clr     r1
    ret
    .size   fixed_mul_q30, . - fixed_mul_q30

; uint32_t fixed_umul_q32(uint32_t a, uint32_t b): the high word of the product. It is
; that of the signed product, plus b where a's highest bit is set, plus a where b's is.
    .section .text.fixed_umul_q32, "ax", @progbits
    .global fixed_umul_q32
    .type   fixed_umul_q32, @function
fixed_umul_q32:
    movw    r26, B0
    movw    r30, B2
    sbrc    A3, 7
    rjmp    1f
    clr     r26
    clr     r27
    movw    r30, r26
1:  sbrs    B3, 7
    rjmp    2f
    add     r26, A0
    adc     r27, A1
    adc     r30, A2
    adc     r31, A3
2:  push    r31
    push    r30
    push    r27
    push    r26
    ldi     P3, 0
    set
    call    product
    pop     r18
    pop     r19
    pop     r20
    pop     r21
    add     r22, r18
    adc     r23, r19
    adc     r24, r20
    adc     r25, r21
    ret
    .size   fixed_umul_q32, . - fixed_umul_q32

; int32_t fixed_times(int32_t value, uint16_t factor)
    .section .text.fixed_times, "ax", @progbits
    .global fixed_times
    .type   fixed_times, @function
fixed_times:
    movw    r26, r20
    movw    r18, r22
    movw    r20, r24
    jmp     __muluhisi3     ; r26 times r21..r18
    .size   fixed_times, . - fixed_times

    .section .text.fixed_clamp, "ax", @progbits

; int32_t fixed_clamp_high(int32_t value, int16_t limit_high): it arrives where the upper
; half of a limit does.
    .global fixed_clamp_high
    .type   fixed_clamp_high, @function
fixed_clamp_high:
    clr     r18
    clr     r19
    .size   fixed_clamp_high, . - fixed_clamp_high

; int32_t fixed_clamp(int32_t value, int32_t limit). Leaves r30 and r31.
    .global fixed_clamp
    .type   fixed_clamp, @function
fixed_clamp:
    cp      r18, r22
    cpc     r19, r23
    cpc     r20, r24
    cpc     r21, r25
    brlt    1f
    com     r21
    com     r20
    com     r19
    neg     r18
    sbci    r19, 0xFF
    sbci    r20, 0xFF
    sbci    r21, 0xFF
    cp      r22, r18
    cpc     r23, r19
    cpc     r24, r20
    cpc     r25, r21
    brge    2f
1:  movw    r22, r18
    movw    r24, r20
2:  ret
    .size   fixed_clamp, . - fixed_clamp

; void fixed_add_clamped(int32_t step, int32_t limit, int32_t *sum)
    .global fixed_add_clamped
    .type   fixed_add_clamped, @function
fixed_add_clamped:
    movw    r30, r16
    rcall   add_sum
    rcall   fixed_clamp
    rjmp    store_sum
    .size   fixed_add_clamped, . - fixed_add_clamped

; void fixed_add_clamped_high(int32_t step, int16_t limit_high, int32_t *sum)
    .global fixed_add_clamped_high
    .type   fixed_add_clamped_high, @function
fixed_add_clamped_high:
    movw    r30, r18
    rcall   add_sum
    rcall   fixed_clamp_high
    rjmp    store_sum
    .size   fixed_add_clamped_high, . - fixed_add_clamped_high

; void fixed_add_product(int32_t value, int16_t element, int32_t *sum)
    .global fixed_add_product
    .type   fixed_add_product, @function
fixed_add_product:
    mov     r0, B2
    or      r0, B3
    breq    1f
    push    B0
    push    B1
    call    fixed_mul_q14
    pop     r31
    pop     r30
    rcall   add_sum
    rjmp    store_sum
1:  ret
    .size   fixed_add_product, . - fixed_add_product

; void fixed_subtract(int32_t step, int32_t *sum)
    .global fixed_subtract
    .type   fixed_subtract, @function
fixed_subtract:
    com     r25
    com     r24
    com     r23
    neg     r22
    sbci    r23, 0xFF
    sbci    r24, 0xFF
    sbci    r25, 0xFF
    .size   fixed_subtract, . - fixed_subtract

; void fixed_add(int32_t step, int32_t *sum)
    .global fixed_add
    .type   fixed_add, @function
fixed_add:
    movw    r30, r20
    rcall   add_sum
store_sum:
    st      Z, r22
    std     Z+1, r23
    std     Z+2, r24
    std     Z+3, r25
    ret
add_sum:
    ld      r0, Z
    add     r22, r0
    ldd     r0, Z+1
    adc     r23, r0
    ldd     r0, Z+2
    adc     r24, r0
    ldd     r0, Z+3
    adc     r25, r0
    ret
    .size   fixed_add, . - fixed_add

; q2_30_t fixed_ratio(uint32_t numerator, uint32_t denominator): long division, a bit a
; round. The remainder is below the denominator, which is at most 2^31, before each
; doubling. The quotient gathers inverted, behind two bits of which the upper one ends
; the division when it leaves.
    .section .text.fixed_ratio, "ax", @progbits
    .global fixed_ratio
    .type   fixed_ratio, @function
fixed_ratio:
    ldi     r30, 3
    clr     r31
    clr     r26
    clr     r27
1:  sub     r22, r18
    sbc     r23, r19
    sbc     r24, r20
    sbc     r25, r21
    brcc    2f
    add     r22, r18
    adc     r23, r19
    adc     r24, r20
    adc     r25, r21        ; carries
2:  rol     r30
    rol     r31
    rol     r26
    rol     r27
    brcs    3f
    lsl     r22
    rol     r23
    rol     r24
    rol     r25
    rjmp    1b
3:  movw    r22, r30
    movw    r24, r26
    com     r22
    com     r23
    com     r24
    com     r25
    ret
    .size   fixed_ratio, . - fixed_ratio

; uint16_t fixed_sqrt(uint32_t x): digit by digit as on paper. Each of 16 rounds takes two
; bits of x into the remainder, r20..r18, and takes off twice the root's bits and a 1,
; where it can.
    .section .text.fixed_sqrt, "ax", @progbits
    .global fixed_sqrt
    .type   fixed_sqrt, @function
fixed_sqrt:
    clr     r18
    clr     r19
    clr     r20
    movw    r26, r18        ; the root
    ldi     r21, 16
1:  rcall   3f
    rcall   3f
    lsl     r26
    rol     r27
    movw    r30, r26
    clr     r0
    sec
    rol     r30
    rol     r31
    rol     r0
    sub     r18, r30
    sbc     r19, r31
    sbc     r20, r0
    inc     r26
    brcc    2f              ; of the subtraction: inc leaves the carry
    dec     r26
    add     r18, r30
    adc     r19, r31
    adc     r20, r0
2:  dec     r21
    brne    1b
    movw    r24, r26
    ret
3:  lsl     r22
    rol     r23
    rol     r24
    rol     r25
    rol     r18
    rol     r19
    rol     r20
    ret
    .size   fixed_sqrt, . - fixed_sqrt

    ; A constant to r21..r18.
    .macro load number
    ldi     r18, lo8(\number)
    ldi     r19, hi8(\number)
    ldi     r20, hlo8(\number)
    ldi     r21, hhi8(\number)
    .endm

; q2_30_t fixed_rsqrt(uint32_t x): a line within 8.7 % on [1/4, 1), then three times
; Newton's y(3 - xy^2)/2, as the portable twin explains. r15..r12 hold x, r11..r8 y.
    .section .text.fixed_rsqrt, "ax", @progbits
    .global fixed_rsqrt
    .type   fixed_rsqrt, @function
fixed_rsqrt:
    call    save
    movw    r12, r22
    movw    r14, r24
    load    1306743800
    call    fixed_umul_q32
    load    2289217568
    ldi     r16, 3
1:  rcall   take_off
    call    fixed_umul_q32  ; y^2
    movw    r18, r12
    movw    r20, r14
    call    fixed_umul_q32  ; x y^2
    lsl     r22
    rol     r23
    rol     r24
    rol     r25
    load    1610612736
    rcall   less
    movw    r22, r8
    movw    r24, r10
    call    fixed_umul_q32
    ldi     r17, 2
2:  lsl     r22
    rol     r23
    rol     r24
    rol     r25
    dec     r17
    brne    2b
    movw    r18, r22
    movw    r20, r24
    clr     r22
    clr     r23
    movw    r24, r22
    dec     r16
    brne    1b
    rcall   take_off
    clr     r26
    jmp     restore

; y = r21..r18 - r25..r22, held below 2^31; leaves it there, too.
take_off:
    rcall   less
    sbrs    r21, 7
    rjmp    1f
    load    0x7FFFFFFF
1:  movw    r8, r18
    movw    r10, r20
    movw    r22, r18
    movw    r24, r20
    ret
less:
    sub     r18, r22
    sbc     r19, r23
    sbc     r20, r24
    sbc     r21, r25
    ret
    .size   fixed_rsqrt, . - fixed_rsqrt

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

; Products of quaternions and vectors, as quat.h describes them. A sum of products adds
; up in r7..r3, in 64ths of a step: of each product the bytes 7 to 3, without what the
; pairs of bytes add whose places add up to less than two.
#define SUM0 r3
#define SUM1 r4
#define SUM2 r5
#define SUM3 r6
#define SUM4 r7
#define NIL r2          /* holds 0 */
#define OTHER r8        /* the pair that points at b; Y points at a */
#define I r10           /* offsets: of the row's component, and of the two that follow */
#define J r11
#define K r12
#define OUT r14         /* a pair */

    ; \x:\y:\z += product of two unsigned bytes.
    .macro plus a, b, x, y, z
    mul     \a, \b
    add     \x, r0
    adc     \y, r1
    adc     \z, NIL
    .endm

    ; The same of a signed byte and an unsigned one.
    .macro plus_signed a, b, x, y, z
    mulsu   \a, \b
    sbc     \z, NIL
    add     \x, r0
    adc     \y, r1
    adc     \z, NIL
    .endm

    ; The same of the first in its column, where \z is still to be made: it takes the
    ; signs of \y, the third byte of the column before, and of the product.
    .macro plus_signed_first a, b, x, y, z
    mulsu   \a, \b
    sbc     \z, \z
    sbrc    \y, 7
    dec     \z
    add     \x, r0
    adc     \y, r1
    adc     \z, NIL
    .endm

    .section .text.quat_multiply, "ax", @progbits

; Called first: saves what C wants back, as compiled functions do. libgcc's code pushes
; all such registers, makes room for X bytes on the stack and goes on at Z, which is
; where this was called from: within the lowest 128 KB, where EIND is 0.
save:
#ifdef __AVR_3_BYTE_PC__
    pop     r31
#endif
    pop     r31
    pop     r30
    clr     r26
    clr     r27
    jmp     __prologue_saves__

; Takes the arguments a, b and out, of which the last two are vectors: they begin where
; a quaternion has its x.
take_vectors:
    movw    r26, r22
    sbiw    r26, 4
    movw    OTHER, r26
    movw    r26, r20
    sbiw    r26, 4
    rjmp    1f

; The same of quaternions.
take:
    movw    OTHER, r22
    movw    r26, r20
1:  movw    OUT, r26
    movw    r28, r24
    clr     NIL
    ; The row of z; rows go z, y, x.
    ldi     r24, 12
    mov     I, r24
    ldi     r24, 4
    mov     J, r24
    ldi     r24, 8
    mov     K, r24
    ret

; Gives back r26 bytes of the stack, and what C wants back.
restore:
    clr     r1
    in      r28, _SFR_IO_ADDR(SPL)
    in      r29, _SFR_IO_ADDR(SPH)
    add     r28, r26
    adc     r29, r1
    ldi     r30, 18         ; registers
    jmp     __epilogue_restores__

; On to the row before; Z is set behind that of x.
next_row:
    mov     r24, K
    mov     K, J
    mov     J, I
    mov     I, r24
    cpi     r24, 12
    ret

; The sum is 0, and the half of a step in r24 for rounding.
clear:
    mov     SUM0, r24
    clr     SUM1
    clr     SUM2
    movw    SUM3, SUM1
    ret

; The sum takes the row's component of the cross product of a and b.
cross:
    mov     r30, J
    mov     r26, K
    clt
    rcall   term
    mov     r30, K
    mov     r26, J
    set

; The sum takes a[r30] * b[r26], less it where T is set.
term:
    add     r30, r28
    mov     r31, r29
    adc     r31, NIL
    ld      r16, Z
    ldd     r17, Z+1
    ldd     r18, Z+2
    ldd     r19, Z+3
    add     r26, r8
    mov     r27, r9
    adc     r27, NIL
    ld      r20, X+
    ld      r21, X+
    ld      r22, X+
    ld      r23, X
    ; Columns 2 to 6 of bytes. A signed one has a signed third byte.
    mul     r16, r22
    movw    r30, r0
    clr     r24
    plus r17, r21, r30, r31, r24
    plus r18, r20, r30, r31, r24
    mulsu   r23, r16
    sbc     r25, r25
    add     r31, r0
    adc     r24, r1
    adc     r25, NIL
    plus_signed r19, r20, r31, r24, r25
    plus r17, r22, r31, r24, r25
    plus r18, r21, r31, r24, r25
    plus_signed_first r23, r17, r24, r25, r26
    plus_signed r19, r21, r24, r25, r26
    plus r18, r22, r24, r25, r26
    plus_signed_first r23, r18, r25, r26, r27
    plus_signed r19, r22, r25, r26, r27
    muls    r19, r23
    add     r26, r0
    adc     r27, r1
    brts    1f
    add     SUM0, r31
    adc     SUM1, r24
    adc     SUM2, r25
    adc     SUM3, r26
    adc     SUM4, r27
    ret
1:  sub     SUM0, r31
    sbc     SUM1, r24
    sbc     SUM2, r25
    sbc     SUM3, r26
    sbc     SUM4, r27
    ret

; Doubles the sum; the result is in the bytes from SUM1 on once it was doubled twice.
twice_twice:
    rcall   twice
twice:
    lsl     SUM0
    rol     SUM1
    rol     SUM2
    rol     SUM3
    rol     SUM4
    ret

; void quat_multiply(const struct quat *a, const struct quat *b, struct quat *out)
    .global quat_multiply
    .type   quat_multiply, @function
quat_multiply:
    rcall   save
    rcall   take
1:  ldi     r24, 0x20
    rcall   clear
    rcall   cross
    mov     r30, I          ; the row's component of a times w of b, and of b times w of a
    clr     r26
    clt
    rcall   term
    clr     r30
    mov     r26, I
    rcall   term
    rcall   twice_twice
    push    SUM4
    push    SUM3
    push    SUM2
    push    SUM1
    rcall   next_row
    brne    1b
    ldi     r24, 0x20       ; w: the product of both less those of all others
    rcall   clear
    set
2:  mov     r30, I
    mov     r26, I
    rcall   term
    ldi     r24, 4
    sub     I, r24
    brne    2b
    clr     r30
    clr     r26
    clt
    rcall   term
    rcall   twice_twice
    movw    r26, OUT
    st      X+, SUM1
    st      X+, SUM2
    st      X+, SUM3
    st      X+, SUM4
pop_vector:
    ldi     r24, 12
3:  pop     r0
    st      X+, r0
    dec     r24
    brne    3b
    clr     r26
    rjmp    restore
    .size   quat_multiply, . - quat_multiply

; void matrix_turn(const struct matrix *matrix, const int32_t v[3], int32_t out[3])
    .global matrix_turn
    .type   matrix_turn, @function
matrix_turn:
    rcall   save
    rcall   take
    adiw    r28, 12         ; the last row
1:  movw    r24, OTHER
    movw    r22, r28
    call    fixed_dot3_q14
    push    r25
    push    r24
    push    r23
    push    r22
    sbiw    r28, 6
    ldi     r24, 4
    sub     I, r24          ; 12, as `take` set it, then 8, 4 and 0
    brne    1b
    movw    r26, OUT
    rjmp    pop_vector
    .size   matrix_turn, . - matrix_turn

; void quat_rotate(const struct quat *q, const struct vector *v, struct vector *out)
    .global quat_rotate
    .type   quat_rotate, @function
quat_rotate:
    rcall   save
    rcall   take_vectors
    push    r22             ; v, for the end
    push    r23
1:  ldi     r24, 0x10       ; t = 2 u x v
    rcall   clear
    rcall   cross
    rcall   twice
    rcall   twice_twice
    push    SUM4
    push    SUM3
    push    SUM2
    push    SUM1
    rcall   next_row
    brne    1b
    in      r30, _SFR_IO_ADDR(SPL)
    in      r31, _SFR_IO_ADDR(SPH)
    movw    OTHER, r30      ; the byte below t
    ldi     r24, 3
    sub     r8, r24
    sbc     r9, NIL
2:  ldi     r24, 0x20       ; v + w t + u x t
    rcall   clear
    rcall   cross
    clr     r30
    mov     r26, I
    clt
    rcall   term
    rcall   twice_twice
    in      r30, _SFR_IO_ADDR(SPL)
    in      r31, _SFR_IO_ADDR(SPH)
    ldd     r27, Z+13
    ldd     r26, Z+14
    ldi     r24, 4
    mov     r30, I
    sub     r30, r24
    add     r26, r30
    adc     r27, NIL
    ld      r20, X+
    ld      r21, X+
    ld      r22, X+
    ld      r23, X+
    movw    r26, OUT
    add     r26, I
    adc     r27, NIL
    add     r20, SUM1
    st      X+, r20
    adc     r21, SUM2
    st      X+, r21
    adc     r22, SUM3
    st      X+, r22
    adc     r23, SUM4
    st      X+, r23
    rcall   next_row
    brne    2b
    ldi     r26, 14         ; t, and the address of v
    rjmp    restore
    .size   quat_rotate, . - quat_rotate

; void vector_cross(const struct vector *a, const struct vector *b, struct vector *out)
    .global vector_cross
    .type   vector_cross, @function
vector_cross:
    rcall   save
    rcall   take_vectors
    sbiw    r28, 4
1:  mov     r30, J
    mov     r26, K
    rcall   multiply
    movw    r4, r22
    movw    r6, r24
    mov     r30, K
    mov     r26, J
    rcall   multiply
    sub     r4, r22
    sbc     r5, r23
    sbc     r6, r24
    sbc     r7, r25
    movw    r26, OUT
    add     r26, I
    adc     r27, NIL
    st      X+, r4
    st      X+, r5
    st      X+, r6
    st      X, r7
    rcall   next_row
    brne    1b
    clr     r26
    rjmp    restore
    .size   vector_cross, . - vector_cross

; fixed_mul_q30(a[r30], b[r26])
multiply:
    add     r30, r28
    mov     r31, r29
    adc     r31, NIL
    ld      r22, Z
    ldd     r23, Z+1
    ldd     r24, Z+2
    ldd     r25, Z+3
    add     r26, r8
    mov     r27, r9
    adc     r27, NIL
    ld      r18, X+
    ld      r19, X+
    ld      r20, X+
    ld      r21, X
    jmp     fixed_mul_q30

; uint32_t vector_square_q32(const struct vector *v): of each axis the magnitude, which is
; unsigned.
    .global vector_square_q32
    .type   vector_square_q32, @function
vector_square_q32:
    set
    rjmp    sum_of_products
    .size   vector_square_q32, . - vector_square_q32

; int32_t vector_square_q30(const struct vector *v)
    .global vector_square_q30
    .type   vector_square_q30, @function
vector_square_q30:
    movw    r22, r24
    .size   vector_square_q30, . - vector_square_q30

; int32_t vector_dot(const struct vector *a, const struct vector *b)
    .global vector_dot
    .type   vector_dot, @function
vector_dot:
    clt
sum_of_products:
    rcall   save
    movw    r14, r24
    movw    r12, r22
    clr     r4
    clr     r5
    movw    r6, r4
    ldi     r16, 3
    clr     r17
    bld     r17, 0
1:  movw    r26, r14
    ld      r22, X+
    ld      r23, X+
    ld      r24, X+
    ld      r25, X+
    movw    r14, r26
    sbrc    r17, 0
    rjmp    2f
    movw    r26, r12
    ld      r18, X+
    ld      r19, X+
    ld      r20, X+
    ld      r21, X+
    movw    r12, r26
    call    fixed_mul_q30
    rjmp    3f
2:  call    fixed_magnitude
    movw    r18, r22
    movw    r20, r24
    call    fixed_umul_q32
3:  add     r4, r22
    adc     r5, r23
    adc     r6, r24
    adc     r7, r25
    dec     r16
    brne    1b
    movw    r22, r4
    movw    r24, r6
    clr     r26
    rjmp    restore
    .size   vector_dot, . - vector_dot

; void vector_subtract(const struct vector *a, const struct vector *b, struct vector *out)
    .global vector_subtract
    .type   vector_subtract, @function
vector_subtract:
    push    r28
    push    r29
    movw    r26, r24
    movw    r30, r22
    movw    r28, r20
    ldi     r18, 3
1:  ldi     r19, 4
    clc
2:  ld      r24, X+
    ld      r0, Z+
    sbc     r24, r0
    st      Y+, r24
    dec     r19             ; leaves the carry
    brne    2b
    dec     r18
    brne    1b
    pop     r29
    pop     r28
    ret
    .size   vector_subtract, . - vector_subtract

; void vector_scale(const struct vector *v, q2_30_t gain, struct vector *out)
    .global vector_scale
    .type   vector_scale, @function
vector_scale:
    clt
    rjmp    each_axis
    .size   vector_scale, . - vector_scale

; void vector_clamp(const struct vector *v, int32_t limit, struct vector *out)
    .global vector_clamp
    .type   vector_clamp, @function
vector_clamp:
    set
each_axis:
    rcall   save
    movw    r14, r24        ; v, the number and out
    movw    r12, r22
    movw    r10, r20
    movw    r28, r18
    ldi     r16, 3
    clr     r17
    bld     r17, 0
1:  movw    r26, r14
    ld      r22, X+
    ld      r23, X+
    ld      r24, X+
    ld      r25, X+
    movw    r14, r26
    movw    r18, r10
    movw    r20, r12
    sbrs    r17, 0
    call    fixed_mul_q30
    sbrc    r17, 0
    call    fixed_clamp
    st      Y+, r22
    st      Y+, r23
    st      Y+, r24
    st      Y+, r25
    dec     r16
    brne    1b
    clr     r26
    rjmp    restore
    .size   vector_clamp, . - vector_clamp

; void matrix_from_quat(const struct quat *q, struct matrix *out): in each of three
; rounds the components i, j and k are x, y, z, then y, z, x, then z, x, y.
#define W r14
#define IN_I r8
#define IN_J r10
#define IN_K r12

    .global matrix_from_quat
    .type   matrix_from_quat, @function
matrix_from_quat:
    rcall   save
    movw    r30, r24
    movw    r16, r22
    ldi     r20, 4
1:  ld      r22, Z+         ; a component as q1_15, 1 and -1 held a step short of them
    ld      r23, Z+
    ld      r24, Z+
    ld      r25, Z+
    bst     r25, 7
    rcall   upper_half
    ldi     r18, 0x80
    cp      r24, r1
    cpc     r25, r18
    brne    2f
    ldi     r24, 1
    brts    2f
    ldi     r24, 0xFF
    ldi     r25, 0x7F
2:  movw    W, IN_I
    movw    IN_I, IN_J
    movw    IN_J, IN_K
    movw    IN_K, r24
    dec     r20
    brne    1b
    ldi     r20, 3
    mov     r7, r20
3:  movw    r18, IN_J       ; (i, i): 1 - 2 (j j + k k)
    movw    r26, IN_J
    call    __mulhisi3
    movw    r2, r22
    movw    r4, r24
    movw    r18, IN_K
    movw    r26, IN_K
    call    __mulhisi3
    rcall   upper_half_of_sum
    ldi     r18, 0
    ldi     r19, 0x40
    sub     r18, r24
    sbc     r19, r25
    movw    r30, r16
    st      Z, r18
    std     Z+1, r19
    movw    r18, IN_I       ; (i, j): 2 (i j - w k), and (j, i): 2 (i j + w k)
    movw    r26, IN_J
    call    __mulhisi3
    movw    r2, r22
    movw    r4, r24
    movw    r18, W
    movw    r26, IN_K
    call    __mulhisi3
    movw    r18, r22
    movw    r20, r24
    rcall   upper_half_of_sum
    movw    r26, r24
    movw    r22, r2
    movw    r24, r4
    sub     r22, r18
    sbc     r23, r19
    sbc     r24, r20
    sbc     r25, r21
    rcall   upper_half
    dec     r7
    breq    4f
    std     Z+2, r24
    std     Z+3, r25
    std     Z+6, r26
    std     Z+7, r27
    movw    r18, IN_I
    movw    IN_I, IN_J
    movw    IN_J, IN_K
    movw    IN_K, r18
    ldi     r18, 8
    add     r16, r18
    adc     r17, r1
    rjmp    3b
4:  sbiw    r30, 12         ; Z is at (2, 2): (0, 2)
    st      Z, r26
    std     Z+1, r27
    std     Z+8, r24        ; (2, 0)
    std     Z+9, r25
    clr     r26
    rjmp    restore
    .size   matrix_from_quat, . - matrix_from_quat

; The upper half of r25..r22, or of its sum with r5..r2, doubled, rounded.
upper_half_of_sum:
    add     r22, r2
    adc     r23, r3
    adc     r24, r4
    adc     r25, r5
upper_half:
    lsl     r22
    rol     r23
    rol     r24
    rol     r25
    subi    r23, 0x80
    sbci    r24, 0xFF
    sbci    r25, 0xFF
    ret
